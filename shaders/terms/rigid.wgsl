// Nodes of rigid bodies where a step may start from: they go where their body does, which
// `physics/rigid_start` found for each start.
#term rigid

#import lib/rigid

// Six texels a body: see `physics/rigid_start`.
@group(0) @binding(next) var rigid_motions: texture_2d<f32>;

// The velocity over the step of node i with a start, w if it is of no body.
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
// The start that was taken.
@group(0) @binding(next) var<storage, read_write> rigid_choice: array<u32>;
