// Conservative rasterisation of boundary faces: every ray that hits a face gets a fragment of it,
// which then decides by the sign tests of the traversal. Needs `projected_at` of a node,
// `boundary_at` of a face and `params: View` of the importing shader, and lib/array, lib/view,
// lib/tet, lib/ray_projection.

// Whether back faces are drawn instead of front faces.
override BACK_FACES: bool = false;

// Outward offset of face edges, in pixels.
//
// A rasteriser snaps corners to a grid before it computes coverage. Vulkan guarantees 16 steps per
// pixel (subPixelPrecisionBits of 4) and leaves rounding or truncation open, so a corner moves by
// at most d = √2/16 = 0.0884 pixels. That suffices: let K be the face, T the drawn triangle and T'
// the snapped triangle. A convex set contains another if its support function is nowhere smaller.
// Each corner moves by at most d, so h_T' >= h_T - d; T contains everything within the margin of K,
// so h_T >= h_K + margin. With margin >= d, T' contains K, and with it the centre of each pixel
// that K covers. The remainder of an eighth covers rays that pass beside the centre
// (PIXEL_OFFSET in render/view.rs, 0.003), and rounding in 32 bits (under 0.02 below FAR).
const COVER_MARGIN: f32 = 0.125;
// Maximum corner displacement due to the offset, in pixels.
const MAX_CORNER_OFFSET: f32 = 4.0;
// Corners farther than this from the image centre, in pixels, are rounded too coarsely.
const MAX_PIXEL_COORDINATE: f32 = 16384.0;
// Corners closer to the eye plane than this, in local units, count as behind it; nothing that close
// is visible (NEAR in render/view.rs is ten times as large).
const EYE_PLANE_EPSILON: f32 = 1e-6;
// Faces turned away by more than this, in pixels per pixel of edge length, fail the sign tests.
const EDGE_ON_SINE: f32 = 0.02;

struct Face {
    // Nodes counter-clockwise as seen from the eye, and 4 tet + face.
    ids: vec4<u32>,
    // Node positions in camera space.
    nodes: array<vec3<f32>, 3>,
    // Corners of the triangle to draw, in clip space with w = 1.
    corners: array<vec2<f32>, 3>,
}

// Returns the nodes of boundary face `index`, and its code.
fn face_ids(index: u32) -> vec4<u32> {
    let ids = boundary_at(index);
    // Counter-clockwise as seen from inside.
    return select(ids, ids.xzyw, BACK_FACES);
}

// Returns boundary face `index` with its covering triangle.
fn face_of(index: u32) -> Face {
    let ids = face_ids(index);
    let q = array(projected_at(ids.x).xyz, projected_at(ids.y).xyz, projected_at(ids.z).xyz);
    let drawn = cover_triangle(array(to_clip(params, q[0]), to_clip(params, q[1]), to_clip(params, q[2])));
    return Face(ids, q, array(drawn[0] * params.pixel, drawn[1] * params.pixel, drawn[2] * params.pixel));
}

// Returns a triangle, in pixels from the image centre, that contains everything within the margin
// of the visible part of the triangle with clip-space corners p.
fn cover_triangle(p: array<vec4<f32>, 3>) -> array<vec2<f32>, 3> {
    if min(p[0].w, min(p[1].w, p[2].w)) <= EYE_PLANE_EPSILON {
        return clip_to_view(p);
    }
    let s = array(in_pixels(p[0]), in_pixels(p[1]), in_pixels(p[2]));
    let reach = max(abs(s[0]), max(abs(s[1]), abs(s[2])));
    if !(max(reach.x, reach.y) < MAX_PIXEL_COORDINATE) {
        return clip_to_view(p);
    }
    let u = s[1] - s[0];
    let v = s[2] - s[0];
    let area = u.x * v.y - u.y * v.x;
    if area < -EDGE_ON_SINE * (abs(u.x) + abs(u.y) + abs(v.x) + abs(v.y)) {
        return empty_triangle();
    }
    return enlarged(s, area);
}

// Converts clip-space position p to pixels.
fn in_pixels(p: vec4<f32>) -> vec2<f32> {
    return p.xy / (p.w * params.pixel);
}

fn empty_triangle() -> array<vec2<f32>, 3> {
    let outside = vec2(4.0) / params.pixel;
    return array(outside, outside, outside);
}

// Returns a right triangle that contains the box of this size at `corner`, aligned with `along`.
fn half_box(corner: vec2<f32>, along: vec2<f32>, size: vec2<f32>) -> array<vec2<f32>, 3> {
    let across = vec2(-along.y, along.x);
    return array(corner, corner + 2.0 * size.x * along, corner + 2.0 * size.y * across);
}

// As `cover_triangle`, for a triangle not far outside the image. If a corner is so sharp that it
// would move far, or the triangle is degenerate, its bounding box is covered instead; the sign
// tests reject the excess.
fn enlarged(s: array<vec2<f32>, 3>, area: f32) -> array<vec2<f32>, 3> {
    // Outward normals of the edges from corner k to the next.
    let n = array(edge_offset(s[0], s[1]), edge_offset(s[1], s[2]), edge_offset(s[2], s[0]));
    // A corner moves by the margin times √(2 / open).
    let open = vec3(1.0 + dot(n[2], n[0]), 1.0 + dot(n[0], n[1]), 1.0 + dot(n[1], n[2]));
    let least = 2.0 * (COVER_MARGIN / MAX_CORNER_OFFSET) * (COVER_MARGIN / MAX_CORNER_OFFSET);
    if area > 0.0 && min(open.x, min(open.y, open.z)) > least {
        return array(
            s[0] + (n[2] + n[0]) * (COVER_MARGIN / open.x),
            s[1] + (n[0] + n[1]) * (COVER_MARGIN / open.y),
            s[2] + (n[1] + n[2]) * (COVER_MARGIN / open.z),
        );
    }
    var longest = s[1] - s[0];
    for (var k = 1u; k < 3u; k++) {
        let edge = s[(k + 1u) % 3u] - s[k];
        if dot(edge, edge) > dot(longest, longest) {
            longest = edge;
        }
    }
    let along = select(vec2(1.0, 0.0), longest * inverseSqrt(dot(longest, longest)), dot(longest, longest) > 1e-20);
    let across = vec2(-along.y, along.x);
    let u = vec3(0.0, dot(s[1] - s[0], along), dot(s[2] - s[0], along));
    let v = vec3(0.0, dot(s[1] - s[0], across), dot(s[2] - s[0], across));
    let low = vec2(min(u.x, min(u.y, u.z)), min(v.x, min(v.y, v.z))) - COVER_MARGIN;
    let high = vec2(max(u.x, max(u.y, u.z)), max(v.x, max(v.y, v.z))) + COVER_MARGIN;
    return half_box(s[0] + low.x * along + low.y * across, along, high - low);
}

fn edge_offset(a: vec2<f32>, b: vec2<f32>) -> vec2<f32> {
    let edge = b - a;
    return vec2(edge.y, -edge.x) * inverseSqrt(max(dot(edge, edge), 1e-20));
}

// Returns a cover of the on-screen bounding box of the potentially visible part of a triangle that
// extends far outside the image or behind the eye.
fn clip_to_view(p: array<vec4<f32>, 3>) -> array<vec2<f32>, 3> {
    // One pixel more than half the image in each direction.
    let edge = 1.0 / params.pixel + 1.0;
    var low = edge;
    var high = -edge;
    for (var k = 0u; k < 3u; k++) {
        let a = p[k];
        let b = p[(k + 1u) % 3u];
        if a.w > EYE_PLANE_EPSILON {
            let s = in_pixels(a);
            low = min(low, s - 1.0);
            high = max(high, s + 1.0);
        }
        if (a.w > EYE_PLANE_EPSILON) != (b.w > EYE_PLANE_EPSILON) {
            // The intersection of this side with the eye plane lies outside the image, unless it is
            // directly in front of the eye.
            let x = mix(a.xy, b.xy, (a.w - EYE_PLANE_EPSILON) / (a.w - b.w));
            let slack = EYE_PLANE_EPSILON + 1e-6 * (abs(a.xy) + abs(b.xy));
            low = select(low, -edge, x < slack);
            high = select(high, edge, x > -slack);
        }
    }
    low = max(low, -edge);
    high = min(high, edge);
    if low.x >= high.x || low.y >= high.y {
        return empty_triangle();
    }
    return half_box(low, vec2(1.0, 0.0), high - low);
}

// Intersection of a ray with a face.
struct Hit {
    z: f32,
    // Whether the ray hits the drawn side of the face, in front of the near plane.
    found: bool,
}

fn intersect_face(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, ids: vec4<u32>, frame: RayFrame) -> Hit {
    let p = project_to_ray_plane(a, frame);
    let q = project_to_ray_plane(b, frame);
    let r = project_to_ray_plane(c, frame);
    let w = vec3(cross2(q, r), cross2(r, p), cross2(p, q));
    let sum = w.x + w.y + w.z;
    let inner = edge_test(w.x, ids.y, ids.z) && edge_test(w.y, ids.z, ids.x) && edge_test(w.z, ids.x, ids.y);
    let z = dot(w, vec3(a.z, b.z, c.z)) / sum;
    return Hit(z, inner && sum > 0.0 && z >= params.near);
}
