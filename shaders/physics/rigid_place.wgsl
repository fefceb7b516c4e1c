// Places the nodes of rigid bodies at the poses computed by `physics/rigid_fit`.

#import lib/rigid_members

@group(0) @binding(0) var rest: texture_2d<f32>;
@group(0) @binding(1) var motions: texture_2d<f32>;
@group(0) @binding(2) var positions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(3) var velocities: texture_storage_2d<rgba32float, write>;
@group(0) @binding(4) var<uniform> params: RigidParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let k = invocation_index(id, groups);
    if k >= params.members {
        return;
    }
    let i = textureLoad(members, array_texel(k), 0).x;
    let arm = textureLoad(rigid_arms, array_texel(i), 0);
    let b = u32(arm.w) - 1u;
    let r = arm.xyz - textureLoad(rigid_shapes, array_texel(4u * b), 0).xyz;
    let shift = textureLoad(motions, array_texel(6u * b), 0).xyz;
    let turn = textureLoad(motions, array_texel(6u * b + 1u), 0);
    let speed = textureLoad(motions, array_texel(6u * b + 2u), 0).xyz;
    let spin = textureLoad(motions, array_texel(6u * b + 3u), 0).xyz;
    let u = shift + rotation_displacement(turn, r);
    textureStore(positions, array_texel(i), vec4(textureLoad(rest, array_texel(i), 0).xyz + u, 1.0));
    textureStore(velocities, array_texel(i), vec4(speed + cross(spin, quat_rotate(turn, r)), 0.0));
}
