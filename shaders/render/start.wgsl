// One peeled layer: for each pixel, the nearest boundary face behind the layer before, in the
// order (depth, face), which neither loses nor doubles touching or coincident faces.
//
// A rasteriser moves vertices onto a grid of, usually, 256ths of a pixel: at a silhouette it may
// miss a face that the walk finds its way out by, and so lose what lies behind. Faces are
// therefore drawn a little larger, and each fragment decides by the walk's own sign tests.

#import lib/array
#import lib/view
#import lib/tet
#import lib/sight

// The first layer has none before it.
override FIRST: bool = false;
// Faces that show their back, instead of those that show their front.
override BACK: bool = false;
// A pixel this opaque needs no further layers.
override ENOUGH: f32 = 0.9995;
// By how much the edges of faces are moved out, and how far corners may move with them, in pixels.
const MARGIN: f32 = 0.02;
const MOST_MARGIN: f32 = 0.5;

@group(0) @binding(0) var projected: texture_2d<f32>;
// Nodes of each boundary face, counter-clockwise from outside, and 4 tet + face; sorted by that.
@group(0) @binding(1) var boundary: texture_2d<u32>;
// Depth bits and 4 tet + face of the layer before.
@group(0) @binding(2) var before: texture_2d<u32>;
// What the layers before gathered.
@group(0) @binding(3) var gathered: texture_2d<f32>;
// Draw arguments that depend on this layer, 8 words a layer of this parity.
@group(0) @binding(4) var<storage, read_write> arguments: array<atomic<u32>>;
@group(0) @binding(5) var<uniform> params: View;

struct Corner {
    @invariant @builtin(position) position: vec4<f32>,
    // The face's nodes, their ids and its code, the same at its three corners.
    @location(0) @interpolate(flat) a: vec3<f32>,
    @location(1) @interpolate(flat) b: vec3<f32>,
    @location(2) @interpolate(flat) c: vec3<f32>,
    @location(3) @interpolate(flat) ids: vec4<u32>,
    @location(4) @interpolate(flat) layer: u32,
}

// A point of clip space in pixels.
fn in_pixels(p: vec4<f32>) -> vec2<f32> {
    return p.xy / (p.w * params.pixel);
}

// How far corner p moves, between corners q and r of a counter-clockwise triangle, for its edges
// to move outwards by the margin.
fn push(p: vec2<f32>, q: vec2<f32>, r: vec2<f32>) -> vec2<f32> {
    let to = q - p;
    let from_ = p - r;
    let n = vec2(to.y, -to.x) * inverseSqrt(max(dot(to, to), 1e-20));
    let m = vec2(from_.y, -from_.x) * inverseSqrt(max(dot(from_, from_), 1e-20));
    return (n + m) * (MARGIN / max(1.0 + dot(n, m), 1e-6));
}

// A triangle that holds all points within the margin of triangle s, counter-clockwise or nearly
// flat. Where a corner is so sharp that it would move far, a box about the triangle is held
// instead, in half a box of twice the size: too much is drawn, and the sign tests sort it out.
fn enlarged(s: array<vec2<f32>, 3>) -> array<vec2<f32>, 3> {
    let moved = array(push(s[0], s[1], s[2]), push(s[1], s[2], s[0]), push(s[2], s[0], s[1]));
    let most = max(dot(moved[0], moved[0]), max(dot(moved[1], moved[1]), dot(moved[2], moved[2])));
    if most <= MOST_MARGIN * MOST_MARGIN {
        return array(s[0] + moved[0], s[1] + moved[1], s[2] + moved[2]);
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
    let low = vec2(min(u.x, min(u.y, u.z)), min(v.x, min(v.y, v.z))) - MARGIN;
    let size = 2.0 * (vec2(max(u.x, max(u.y, u.z)), max(v.x, max(v.y, v.z))) + MARGIN - low);
    let corner = s[0] + low.x * along + low.y * across;
    return array(corner, corner + size.x * along, corner + size.y * across);
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Corner {
    // Layer k draws vertices k n .. (k + 1) n of an n-vertex boundary, and so learns k.
    let layer = index / params.corners;
    let corner = index - layer * params.corners;
    var face = textureLoad(boundary, at(corner / 3u), 0);
    if BACK {
        // Counter-clockwise as seen from inside.
        face = face.xzyw;
    }
    let q = array(
        textureLoad(projected, at(face.x), 0).xyz,
        textureLoad(projected, at(face.y), 0).xyz,
        textureLoad(projected, at(face.z), 0).xyz,
    );
    let k = corner % 3u;
    var p = array(to_clip(params, q[0]), to_clip(params, q[1]), to_clip(params, q[2]));
    var position = p[k];
    // The clipper deals with faces that reach behind the eye.
    if min(p[0].w, min(p[1].w, p[2].w)) > 0.0 {
        let s = array(in_pixels(p[0]), in_pixels(p[1]), in_pixels(p[2]));
        let u = s[1] - s[0];
        let v = s[2] - s[0];
        let area = u.x * v.y - u.y * v.x;
        if area < -MARGIN * (abs(u.x) + abs(u.y) + abs(v.x) + abs(v.y)) {
            // Clearly turned away: out of sight.
            position = vec4(0.0, 0.0, 2.0, 1.0);
        } else {
            // Depth is each fragment's own.
            let corners = enlarged(s);
            position = vec4(corners[k] * params.pixel, 0.5, 1.0);
        }
    }
    return Corner(position, q[0], q[1], q[2], face, layer);
}

struct Start {
    // Depth bits and 4 tet + face.
    @location(0) key: vec2<u32>,
    @builtin(frag_depth) depth: f32,
}

@fragment
fn fragment(corner: Corner) -> Start {
    let pixel = vec2<u32>(corner.position.xy);
    let ids = corner.ids;
    var last = vec2(0u, NONE);
    if !FIRST {
        last = textureLoad(before, pixel, 0).xy;
        // Where the layer before found nothing, this one finds nothing; and it is not the same.
        if last.y == NONE || ids.w == last.y {
            discard;
        }
    }
    let sight = sight_at(params, corner.position.xy);
    let a = off_ray(corner.a, sight);
    let b = off_ray(corner.b, sight);
    let c = off_ray(corner.c, sight);
    let w = vec3(cross2(b, c), cross2(c, a), cross2(a, b));
    let sum = w.x + w.y + w.z;
    if !(inside(w.x, ids.y, ids.z) && inside(w.y, ids.z, ids.x) && inside(w.z, ids.x, ids.y)) || !(sum > 0.0) {
        discard;
    }
    let z = dot(w, vec3(corner.a.z, corner.b.z, corner.c.z)) / sum;
    let depth = clamp(depth_of_z(params, z), 0.0, 1.0);
    if z < params.near {
        discard;
    }
    if !FIRST {
        let last_depth = bitcast<f32>(last.x);
        let behind = depth < last_depth || (depth == last_depth && ids.w > last.y);
        if !behind || textureLoad(gathered, pixel, 0).a > ENOUGH {
            discard;
        }
        let slot = (corner.layer >> 1u) * 8u;
        atomicStore(&arguments[slot + 1u], 1u);
        atomicStore(&arguments[slot + 5u], 1u);
    }
    return Start(vec2(bitcast<u32>(depth), ids.w), depth);
}
