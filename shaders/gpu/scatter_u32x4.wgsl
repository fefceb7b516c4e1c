// Scatters items into an array: item places[k] becomes items[k].

#import lib/array

struct ScatterParams {
    items: u32,
}

@group(0) @binding(0) var<storage, read> places: array<u32>;
@group(0) @binding(1) var<storage, read> items: array<vec4<u32>>;
@group(0) @binding(2) var result: texture_storage_2d<rgba32uint, write>;
@group(0) @binding(3) var<uniform> params: ScatterParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let k = invocation_index(id, groups);
    if k >= params.items {
        return;
    }
    textureStore(result, array_texel(places[k]), items[k]);
}
