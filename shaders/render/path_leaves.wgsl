// Boxes around the boundary faces: the leaves of the tree of lib/path_boxes.

#import lib/array

const LEAF_FACES: u32 = 4u;

struct Leaves {
    faces: u32,
    leaves: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var boundary: texture_2d<u32>;
@group(0) @binding(2) var<storage, read_write> boxes: array<vec4<f32>>;
@group(0) @binding(3) var<uniform> params: Leaves;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let leaf = invocation_index(id, groups);
    if leaf >= params.leaves {
        return;
    }
    // An empty leaf keeps reversed corners, which no ray meets.
    var low = vec3(1e30);
    var high = vec3(-1e30);
    let first = leaf * LEAF_FACES;
    for (var k = first; k < min(first + LEAF_FACES, params.faces); k++) {
        let face = textureLoad(boundary, array_texel(k), 0);
        for (var corner = 0u; corner < 3u; corner++) {
            let p = textureLoad(positions, array_texel(face[corner]), 0).xyz;
            low = min(low, p);
            high = max(high, p);
        }
    }
    let i = params.leaves + leaf;
    boxes[2u * i] = vec4(low, 0.0);
    boxes[2u * i + 1u] = vec4(high, 0.0);
}
