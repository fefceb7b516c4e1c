// The boundary faces as the tree of lib/path_boxes has them, and the boxes around them: its leaves.

#import lib/array

const LEAF_FACES: u32 = 4u;

struct Leaves {
    faces: u32,
    leaves: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var boundary: texture_2d<u32>;
@group(0) @binding(2) var<storage, read_write> boxes: array<vec4<f32>>;
@group(0) @binding(3) var faces: texture_storage_2d<rgba32float, write>;
@group(0) @binding(4) var<uniform> params: Leaves;

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
    for (var k = first; k < first + LEAF_FACES; k++) {
        // No ray meets a face without sides either.
        var face = vec4(0u);
        var p: array<vec3<f32>, 3>;
        if k < params.faces {
            face = textureLoad(boundary, array_texel(k), 0);
            for (var corner = 0u; corner < 3u; corner++) {
                p[corner] = textureLoad(positions, array_texel(face[corner]), 0).xyz;
                low = min(low, p[corner]);
                high = max(high, p[corner]);
            }
        }
        textureStore(faces, array_texel(3u * k), vec4(p[0], bitcast<f32>(face.w)));
        textureStore(faces, array_texel(3u * k + 1u), vec4(p[1] - p[0], 0.0));
        textureStore(faces, array_texel(3u * k + 2u), vec4(p[2] - p[0], 0.0));
    }
    let i = params.leaves + leaf;
    boxes[2u * i] = vec4(low, 0.0);
    boxes[2u * i + 1u] = vec4(high, 0.0);
}
