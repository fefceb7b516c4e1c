// Compacts the covering triangles of the potentially visible boundary faces, in face order: once
// per image for all layers, in parallel.
//
// Two passes over the same bindings, with gpu/bitmask_prefix_sum between them: visibility, then
// output.

#import lib/array
#import lib/view
#import lib/tet
#import lib/ray_projection

// 0: writes the visibility bitmask, 32 faces per invocation. 1: writes their corners.
override PASS: u32 = 0u;

@group(0) @binding(0) var projected: texture_2d<f32>;
@group(0) @binding(1) var boundary: texture_2d<u32>;
// For every 32 faces: the bitmask of drawn faces, and the number drawn before them.
@group(0) @binding(2) var<storage, read_write> marks: array<u32>;
// Three per face: the bits of x and y in clip space with w = 1, and the face number.
@group(0) @binding(3) var covers: texture_storage_2d<rgba32uint, write>;
@group(0) @binding(4) var<uniform> params: View;

fn projected_at(i: u32) -> vec4<f32> {
    return textureLoad(projected, array_texel(i), 0);
}

fn boundary_at(i: u32) -> vec4<u32> {
    return textureLoad(boundary, array_texel(i), 0);
}

#import lib/face

// Whether the face is partly inside the image.
fn is_visible(face: Face) -> bool {
    let low = min(face.corners[0], min(face.corners[1], face.corners[2]));
    let high = max(face.corners[0], max(face.corners[1], face.corners[2]));
    return all(low <= vec2(1.0)) && all(high >= vec2(-1.0));
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let faces = params.corners / 3u;
    let run = invocation_index(id, groups);
    if 32u * run >= faces {
        return;
    }
    if PASS == 0u {
        var mask = 0u;
        for (var k = 0u; k < min(32u, faces - 32u * run); k++) {
            mask |= u32(is_visible(face_of(32u * run + k))) << k;
        }
        marks[2u * run] = mask;
        return;
    }
    var mask = marks[2u * run];
    var place = 3u * marks[2u * run + 1u];
    while mask != 0u {
        let i = 32u * run + countTrailingZeros(mask);
        let face = face_of(i);
        for (var k = 0u; k < 3u; k++) {
            textureStore(covers, array_texel(place + k), vec4(bitcast<vec2<u32>>(face.corners[k]), i, 0u));
        }
        place += 3u;
        mask &= mask - 1u;
    }
}
