// Velocity Verlet, second half: v' = v½ + ½h a', with the acceleration at the new positions.

#import lib/array
#import lib/status

struct KickParams {
    nodes: u32,
    kick: f32,
}

@group(0) @binding(0) var half_velocities: texture_2d<f32>;
@group(0) @binding(1) var forces: texture_2d<f32>;
@group(0) @binding(2) var masses: texture_2d<f32>;
@group(0) @binding(3) var<storage, read> status: Status;
@group(0) @binding(4) var next_velocities: texture_storage_2d<rgba32float, write>;
@group(0) @binding(5) var<uniform> params: KickParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = item(id, groups);
    if i >= params.nodes || status.failed != 0u {
        return;
    }
    let v = textureLoad(half_velocities, at(i), 0);
    let a = textureLoad(masses, at(i), 0).y * textureLoad(forces, at(i), 0).xyz;
    textureStore(next_velocities, at(i), vec4(v.xyz + params.kick * a, v.w));
}
