// Implicit Euler, final update once Δv is known: v' = v + Δv, x' = x + h v'.

#import lib/array
#import lib/status

struct AdvanceParams {
    nodes: u32,
    dt: f32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
@group(0) @binding(2) var masses: texture_2d<f32>;
// Δv: in the first texture after an even number of iterations, otherwise in the second.
@group(0) @binding(3) var even: texture_2d<f32>;
@group(0) @binding(4) var odd: texture_2d<f32>;
@group(0) @binding(5) var<storage, read> status: Status;
@group(0) @binding(6) var next_positions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var next_velocities: texture_storage_2d<rgba32float, write>;
@group(0) @binding(8) var<uniform> params: AdvanceParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes || status.failed != 0u || status.solving != 0u {
        return;
    }
    let x = textureLoad(positions, array_texel(i), 0);
    let v = textureLoad(velocities, array_texel(i), 0);
    let free = textureLoad(masses, array_texel(i), 0).y != 0.0;
    var w = vec3(0.0);
    if free {
        w = v.xyz;
        if status.iterations != 0u {
            if (status.iterations & 1u) == 0u {
                w += textureLoad(even, array_texel(i), 0).xyz;
            } else {
                w += textureLoad(odd, array_texel(i), 0).xyz;
            }
        }
    }
    textureStore(next_positions, array_texel(i), vec4(x.xyz + params.dt * w, x.w));
    textureStore(next_velocities, array_texel(i), vec4(w, v.w));
}
