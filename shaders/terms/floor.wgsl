// Penalty floor: pushes back nodes below a plane with the energy E = ½ m ω² d², d the penetration
// depth. CPU reference: `physics::model::floor`.
//
// Parameters of a floor: its normal and its offset along it; ω².
#term node

fn floor_depth(slot: u32, x: vec3<f32>) -> f32 {
    let plane = node_terms[2u * slot];
    return plane.w - dot(plane.xyz, x);
}

// Returns the force on a node of mass m at x; w is the energy.
fn floor_force(slot: u32, m: f32, x: vec3<f32>) -> vec4<f32> {
    let depth = max(floor_depth(slot, x), 0.0);
    let stiffness = m * node_terms[2u * slot + 1u].x;
    return vec4(stiffness * depth * node_terms[2u * slot].xyz, 0.5 * stiffness * depth * depth);
}

// Returns the stiffness block −∂f/∂x: its diagonal, and xy, xz, yz.
fn floor_block(slot: u32, m: f32, x: vec3<f32>) -> NodeBlock {
    let below = floor_depth(slot, x) > 0.0;
    let stiffness = select(0.0, m * node_terms[2u * slot + 1u].x, below);
    let n = node_terms[2u * slot].xyz;
    return NodeBlock(stiffness * n * n, stiffness * n.xxy * n.yzz);
}
