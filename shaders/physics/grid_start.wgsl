// Computes the previous positions of all particles from their velocities: x₋₁ = x - h v, or
// rescales the previous displacement to a new time step.

#import lib/array

struct StartParams {
    count: u32,
    // x₋₁' = x - ratio (x - x₋₁) - h v
    ratio: f32,
    h: f32,
    _pad0: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var previous: texture_2d<f32>;
@group(0) @binding(2) var velocities: texture_2d<f32>;
@group(0) @binding(3) var particles: texture_2d<u32>;
@group(0) @binding(4) var out_previous: texture_storage_2d<rgba32float, write>;
@group(0) @binding(5) var<uniform> params: StartParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let n = invocation_index(id, groups);
    if n >= params.count {
        return;
    }
    let i = textureLoad(particles, array_texel(n), 0).x;
    let x = textureLoad(positions, array_texel(i), 0);
    let before = textureLoad(previous, array_texel(i), 0).xyz;
    let v = textureLoad(velocities, array_texel(i), 0).xyz;
    textureStore(out_previous, array_texel(i), vec4(x.xyz - params.ratio * (x.xyz - before) - params.h * v, x.w));
}
