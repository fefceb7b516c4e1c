// Initial velocities of the nodes of rigid bodies for each start candidate: they follow the rigid
// motion computed by `physics/rigid_start`.
#term rigid

#import lib/rigid

// Six texels per body: see `physics/rigid_start`.
@group(0) @binding(next) var rigid_motions: texture_2d<f32>;

// Returns the velocity over the step of node i for start candidate `choice`; w if the node belongs
// to no rigid body.
fn rigid_velocity(i: u32, choice: u32, dt: f32, w: vec3<f32>) -> vec3<f32> {
    let arm = textureLoad(rigid_arms, array_texel(i), 0);
    if arm.w == 0.0 || choice == 0u {
        return w;
    }
    let b = u32(arm.w) - 1u;
    let anchor = textureLoad(rigid_shapes, array_texel(4u * b), 0).xyz;
    let r = quat_rotate(textureLoad(rigid_motions, array_texel(6u * b + 1u), 0), arm.xyz - anchor);
    let shift = textureLoad(rigid_motions, array_texel(6u * b + 2u * choice), 0).xyz;
    let turn = textureLoad(rigid_motions, array_texel(6u * b + 2u * choice + 1u), 0);
    return (shift + rotation_displacement(turn, r)) / dt;
}

#for physics/implicit_euler_start
// The selected start candidate.
@group(0) @binding(next) var<storage, read_write> rigid_choice: array<u32>;
