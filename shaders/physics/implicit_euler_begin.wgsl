// Implicit Euler, the linear system of a step (Baraff & Witkin; equation 9 of Tejada & Ertl): (M −
// h ∂f/∂v − h² K̃) Δv = h (f + h K̃ v), K̃ the Jacobian modified so that the matrix is positive
// definite.
//
// Springs are linearised at the start of the step. Finite elements are linearised at the selected
// initial guess, whose positions and velocities v are the input: the right side is then M (v₀ − v)
// + h f, and the unknown is the change of v.

#import lib/cg
#import lib/material_contribution
#each matter #import terms/TERM
#any node #import lib/node_terms
#each node #import terms/TERM
#each contact #import terms/TERM

struct BeginParams {
    nodes: u32,
    dt: f32,
    // h α, for mass-proportional damping with the force −α m v.
    drag: f32,
    // With tools: the first row of `preconditioner` that stores the right side, which conjugate
    // gradients overwrite elsewhere.
    right: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
@group(0) @binding(2) var masses: texture_2d<f32>;
@group(0) @binding(3) var forces: texture_2d<f32>;
@group(0) @binding(4) var<storage, read> status: Status;
// Two texels per node: the inverse of its diagonal block (block Jacobi). After those of all nodes,
// with nodal terms, two more per node: h² times their contribution to its block. Then, with tools,
// one: the right side. They share one texture because browsers bind at most four storage textures.
@group(0) @binding(5) var preconditioner: texture_storage_2d<rgba32float, write>;
@group(0) @binding(6) var residual: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var preconditioned: texture_storage_2d<rgba32float, write>;
// Per workgroup: r·z and mean diagonal entries; with tools, the squared contact forces that scale
// the residual, and the number of points that penetrate too deeply.
@group(0) @binding(8) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> scalars: CgScalars;
@group(0) @binding(10) var<uniform> params: BeginParams;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    if status.failed != 0u || status.solving != 0u {
        return;
    }
    let h = params.dt;
    var sum = vec4(0.0);
    for (var t = id.x; t < params.nodes; t += groups.x * WORKGROUP) {
        let i = row_of(t).x;
        let x = textureLoad(positions, array_texel(i), 0).xyz;
        let v = textureLoad(velocities, array_texel(i), 0).xyz;
        let mass = textureLoad(masses, array_texel(i), 0).xy;
#each matter         let gathered = TERM_system(t, mass.x, x, v, h);
        var kv = gathered.ahead;
        // The diagonal block: xx, yy, zz and xy, xz, yz.
        var diagonal = gathered.diagonal;
        var mixed = gathered.mixed;
#any node         var block = NodeBlock(vec3(0.0), vec3(0.0));
#any node         var one = block;
#each node         one = TERM_block(INDEX, mass.x, x); block.diagonal += one.diagonal; block.mixed += one.mixed;
#any node         let b0 = h * h * vec4(block.diagonal.x, block.mixed.xy, block.diagonal.y);
#any node         let b1 = h * h * vec4(block.mixed.z, block.diagonal.z, 0.0, 0.0);
#any node         textureStore(preconditioner, array_texel(2u * (params.nodes + i)), b0);
#any node         textureStore(preconditioner, array_texel(2u * (params.nodes + i) + 1u), b1);
#any node         diagonal += vec3(b0.x, b0.w, b1.y);
#any node         mixed += vec3(b0.yz, b1.x);
#any node         kv -= sym_mul(b0, b1, gathered.motion) / (h * h);
#each contact         let pressed = TERM_block(i);
#each contact         diagonal += vec3(pressed[0].x, pressed[0].w, pressed[1].y);
#each contact         mixed += vec3(pressed[0].yz, pressed[1].x);
        var r = vec3(0.0);
        var a0 = vec4(0.0);
        var a1 = vec4(0.0);
        if mass.y != 0.0 {
            r = h * (textureLoad(forces, array_texel(i), 0).xyz + h * kv);
        }
        // Nodes of rigid bodies have no independent motion: see `physics/rigid_precondition`.
        if mass.y > 0.0 {
            // Scaled by its largest entry, so that the determinant stays in range.
            let scale = max(max(diagonal.x, diagonal.y), diagonal.z);
            let c = diagonal / scale;
            let m = mixed / scale;
            let xx = c.y * c.z - m.z * m.z;
            let xy = m.y * m.z - m.x * c.z;
            let xz = m.x * m.z - m.y * c.y;
            let yy = c.x * c.z - m.y * m.y;
            let yz = m.x * m.y - c.x * m.z;
            let zz = c.x * c.y - m.x * m.x;
            let determinant = c.x * xx + m.x * xy + m.y * xz;
            if determinant > 1e-6 {
                let inverse = 1.0 / (determinant * scale);
                a0 = vec4(xx, xy, xz, yy) * inverse;
                a1 = vec4(yz, zz, 0.0, 0.0) * inverse;
            } else {
                // For a nearly singular block only the diagonal is inverted.
                a0 = vec4(1.0 / diagonal.x, 0.0, 0.0, 1.0 / diagonal.y);
                a1 = vec4(0.0, 1.0 / diagonal.z, 0.0, 0.0);
            }
        }
        let z = sym_mul(a0, a1, r);
        textureStore(residual, array_texel(i), vec4(r, 0.0));
        textureStore(preconditioned, array_texel(i), vec4(z, 0.0));
        textureStore(preconditioner, array_texel(2u * i), a0);
        textureStore(preconditioner, array_texel(2u * i + 1u), a1);
        let weight = select(0.0, (diagonal.x + diagonal.y + diagonal.z) / 3.0, mass.y > 0.0);
        sum += vec4(dot(r, z), weight, 0.0, 0.0);
#each contact         let push = TERM_force(i);
#each contact         if any(push.xyz != vec3(0.0)) {
#each contact             let others = textureLoad(forces, array_texel(i), 0).xyz - push.xyz;
#each contact             let both = dot(push.xyz, sym_mul(a0, a1, push.xyz)) + dot(others, sym_mul(a0, a1, others));
#each contact             sum.z += h * h * both;
#each contact         }
#each contact         sum.w += push.w;
#each contact         textureStore(preconditioner, array_texel(params.right + i), vec4(r, 0.0));
    }
    let total = reduce(sum, lane);
    if lane == 0u {
        partials[group.x] = total;
    }
    if id.x == 0u {
        scalars = CgScalars(0.0, 0.0, 0.0, 0u, 0u, 0u, 0u, 0u);
    }
}
