// The nodes of rigid bodies where `physics/rigid_fit` has put these.

#import lib/rigid_members

@group(0) @binding(0) var rest: texture_2d<f32>;
@group(0) @binding(1) var motions: texture_2d<f32>;
@group(0) @binding(2) var positions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(3) var velocities: texture_storage_2d<rgba32float, write>;
@group(0) @binding(4) var<uniform> params: RigidParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let k = item(id, groups);
    if k >= params.members {
        return;
    }
    let i = textureLoad(members, at(k), 0).x;
    let arm = textureLoad(rigid_arms, at(i), 0);
    let b = u32(arm.w) - 1u;
    let r = arm.xyz - textureLoad(rigid_shapes, at(4u * b), 0).xyz;
    let shift = textureLoad(motions, at(6u * b), 0).xyz;
    let turn = textureLoad(motions, at(6u * b + 1u), 0);
    let speed = textureLoad(motions, at(6u * b + 2u), 0).xyz;
    let spin = textureLoad(motions, at(6u * b + 3u), 0).xyz;
    let u = shift + turn_shift(turn, r);
    textureStore(positions, at(i), vec4(textureLoad(rest, at(i), 0).xyz + u, 1.0));
    textureStore(velocities, at(i), vec4(speed + cross(spin, turned(turn, r)), 0.0));
}
