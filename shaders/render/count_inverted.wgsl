// Counts inverted and degenerate tets, only when a report is requested.

#import lib/array

struct Count {
    tets: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var nodes: texture_2d<u32>;
@group(0) @binding(2) var<storage, read_write> count: array<atomic<u32>, 1>;
@group(0) @binding(3) var<uniform> params: Count;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let t = invocation_index(id, groups);
    if t >= params.tets {
        return;
    }
    let ids = textureLoad(nodes, array_texel(t), 0);
    let v = textureLoad(positions, array_texel(ids.x), 0).xyz;
    let a = textureLoad(positions, array_texel(ids.y), 0).xyz - v;
    let b = textureLoad(positions, array_texel(ids.z), 0).xyz - v;
    let c = textureLoad(positions, array_texel(ids.w), 0).xyz - v;
    if !(dot(a, cross(b, c)) > 0.0) {
        atomicAdd(&count[0], 1u);
    }
}
