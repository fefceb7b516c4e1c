// One level of the tree of lib/path_boxes: each box contains those of its children.

#import lib/array

struct Level {
    // First node of the level, which is also their number.
    first: u32,
}

@group(0) @binding(0) var<storage, read_write> boxes: array<vec4<f32>>;
@group(0) @binding(1) var<uniform> params: Level;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let k = invocation_index(id, groups);
    if k >= params.first {
        return;
    }
    let i = params.first + k;
    boxes[2u * i] = min(boxes[4u * i], boxes[4u * i + 2u]);
    boxes[2u * i + 1u] = max(boxes[4u * i + 1u], boxes[4u * i + 3u]);
}
