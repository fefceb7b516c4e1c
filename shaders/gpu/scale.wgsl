// result = factor · input. The smallest possible pass, used by the tests of the pass mechanism.

#import lib/array

struct Scale {
    items: u32,
    factor: f32,
}

@group(0) @binding(0) var input: texture_2d<f32>;
@group(0) @binding(1) var result: texture_storage_2d<rgba32float, write>;
@group(0) @binding(2) var<uniform> params: Scale;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.items {
        return;
    }
    textureStore(result, array_texel(i), params.factor * textureLoad(input, array_texel(i), 0));
}
