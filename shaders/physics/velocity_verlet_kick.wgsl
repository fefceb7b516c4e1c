// Velocity Verlet, second half: v' = v + ½h (a + a'), with the acceleration at the new positions.

#import lib/array
#import lib/status

struct KickParams {
    nodes: u32,
    kick: f32,
}

@group(0) @binding(0) var velocities: texture_2d<f32>;
// v + h a
@group(0) @binding(1) var predicted_velocities: texture_2d<f32>;
@group(0) @binding(2) var forces: texture_2d<f32>;
@group(0) @binding(3) var masses: texture_2d<f32>;
@group(0) @binding(4) var<storage, read> status: Status;
@group(0) @binding(5) var next_velocities: texture_storage_2d<rgba32float, write>;
@group(0) @binding(6) var<uniform> params: KickParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes || status.failed != 0u {
        return;
    }
    let p = textureLoad(predicted_velocities, array_texel(i), 0);
    let v = textureLoad(velocities, array_texel(i), 0);
    let mass = textureLoad(masses, array_texel(i), 0);
    let free = mass.y != 0.0;
    let a = mass.y * textureLoad(forces, array_texel(i), 0).xyz;
    let next = select(vec3(0.0), 0.5 * (v.xyz + p.xyz), free) + params.kick * a;
    textureStore(next_velocities, array_texel(i), vec4(next, p.w));
}
