// Picks the first triangle of a list that one ray hits, from either side, with the hit position. It
// uses the same arithmetic as the ray starts, so that the pick matches the pixel. CPU reference:
// `render::closest_hit`.
//
// Three passes over the same bindings: depth, triangle, position.

#import lib/array
#import lib/view
#import lib/ray_projection

// 0: the smallest z. 1: the first triangle at that z. 2: weights, position and nearest corner in
// it.
override PASS: u32 = 0u;
// Stride in texels between consecutive positions.
override TRIANGLES_PER_INVOCATION: u32 = 1u;
// Tolerance in units in the last place for the same z computed in two passes.
const ROUNDING: u32 = 4u;

struct Pick {
    view: View,
    pixel: vec2<f32>,
    triangles: u32,
    _pad: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
// Three corners per triangle.
@group(0) @binding(1) var triangles: texture_2d<u32>;
// Nearest z, as an order-preserving unsigned key; triangle; weights; position; nearest corner.
@group(0) @binding(2) var<storage, read_write> found: array<atomic<u32>, 9>;
@group(0) @binding(3) var<uniform> params: Pick;

fn position(i: u32) -> vec3<f32> {
    return textureLoad(positions, array_texel(TRIANGLES_PER_INVOCATION * i), 0).xyz;
}

// Returns an unsigned key with the same order as z.
fn depth_key(z: f32) -> u32 {
    let bits = bitcast<u32>(z);
    return bits ^ select(0x80000000u, 0xffffffffu, (bits & 0x80000000u) != 0u);
}

struct Hit {
    weights: vec3<f32>,
    z: f32,
    found: bool,
}

fn intersect(corners: vec3<u32>) -> Hit {
    let qa = to_camera(params.view, position(corners.x));
    let qb = to_camera(params.view, position(corners.y));
    let qc = to_camera(params.view, position(corners.z));
    let frame = ray_frame(params.view, params.pixel);
    let a = project_to_ray_plane(qa, frame);
    let b = project_to_ray_plane(qb, frame);
    let c = project_to_ray_plane(qc, frame);
    let w = vec3(cross2(b, c), cross2(c, a), cross2(a, b));
    let sum = w.x + w.y + w.z;
    let front = edge_test(w.x, corners.y, corners.z) && edge_test(w.y, corners.z, corners.x)
        && edge_test(w.z, corners.x, corners.y);
    let back = edge_test(-w.x, corners.z, corners.y) && edge_test(-w.y, corners.x, corners.z)
        && edge_test(-w.z, corners.y, corners.x);
    let weights = w / sum;
    let z = dot(weights, vec3(qa.z, qb.z, qc.z));
    return Hit(weights, z, select(back, front, sum > 0.0) && abs(sum) > 0.0 && z >= params.view.near);
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if PASS == 2u {
        let nearest = atomicLoad(&found[1]);
        if i == 0u && nearest < params.triangles {
            write_result(textureLoad(triangles, array_texel(nearest), 0).xyz);
        }
        return;
    }
    if i >= params.triangles {
        return;
    }
    let hit = intersect(textureLoad(triangles, array_texel(i), 0).xyz);
    if !hit.found {
        return;
    }
    if PASS == 0u {
        atomicMin(&found[0], depth_key(hit.z));
    } else if depth_key(hit.z) - atomicLoad(&found[0]) <= ROUNDING {
        atomicMin(&found[1], i);
    }
}

fn write_result(corners: vec3<u32>) {
    let w = intersect(corners).weights;
    let p = array(position(corners.x), position(corners.y), position(corners.z));
    let place = w.x * p[0] + w.y * p[1] + w.z * p[2];
    var nearest = 0u;
    for (var k = 1u; k < 3u; k++) {
        if distance(p[k], place) < distance(p[nearest], place) {
            nearest = k;
        }
    }
    for (var k = 0u; k < 3u; k++) {
        atomicStore(&found[2u + k], bitcast<u32>(w[k]));
        atomicStore(&found[5u + k], bitcast<u32>(place[k]));
    }
    atomicStore(&found[8], nearest);
}
