// Shared code of the explicit integrators: the state, its forces, and the output state.

#import lib/array
#import lib/status

struct MoveParams {
    nodes: u32,
    // The time step, and the time by which the velocity is advanced.
    dt: f32,
    kick: f32,
    _pad0: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
@group(0) @binding(2) var forces: texture_2d<f32>;
@group(0) @binding(3) var masses: texture_2d<f32>;
@group(0) @binding(4) var<storage, read> status: Status;
@group(0) @binding(5) var next_positions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(6) var next_velocities: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var<uniform> params: MoveParams;

// Returns the acceleration of node i; zero for a pinned node, whose inverse mass is zero.
fn acceleration(i: u32) -> vec3<f32> {
    return textureLoad(masses, array_texel(i), 0).y * textureLoad(forces, array_texel(i), 0).xyz;
}

// Stores the next state of node i, displaced by `step`; a pinned node stays at rest.
fn store(i: u32, x: vec4<f32>, step: vec3<f32>, v: vec4<f32>) {
    let free = textureLoad(masses, array_texel(i), 0).y != 0.0;
    textureStore(next_positions, array_texel(i), vec4(x.xyz + select(vec3(0.0), step, free), x.w));
    textureStore(next_velocities, array_texel(i), vec4(select(vec3(0.0), v.xyz, free), v.w));
}
