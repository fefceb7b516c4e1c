// Copies the nodes of one body into the merged node array of several. CPU reference:
// `Bodies::positions`.

#import lib/array

struct Place {
    // Transform from the body's frame to the common frame: translation, and scale in w.
    to_whole: vec4<f32>,
    nodes: u32,
}

@group(0) @binding(0) var body: texture_2d<f32>;
@group(0) @binding(1) var places: texture_2d<u32>;
@group(0) @binding(2) var positions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(3) var<uniform> params: Place;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes {
        return;
    }
    let p = textureLoad(body, array_texel(i), 0).xyz;
    let place = textureLoad(places, array_texel(i), 0).x;
    textureStore(positions, array_texel(place), vec4(params.to_whole.w * p + params.to_whole.xyz, 1.0));
}
