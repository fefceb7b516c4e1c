// One peeled layer: for each pixel, the nearest boundary face behind the layer before, in the
// order (depth, face), which neither loses nor doubles touching or coincident faces.

#import lib/array
#import lib/view
#import lib/tet
#import lib/sight
#import lib/face

// The first layer has none before it.
override FIRST: bool = false;
// A pixel this opaque needs no further layers.
override ENOUGH: f32 = 0.9995;

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

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Corner {
    // Layer k draws vertices k n .. (k + 1) n of an n-vertex boundary, and so learns k.
    let layer = index / params.corners;
    let corner = index - layer * params.corners;
    let face = face_of(corner / 3u);
    // Depth is each fragment's own.
    let position = vec4(face.corners[corner % 3u], 0.5, 1.0);
    return Corner(position, face.nodes[0], face.nodes[1], face.nodes[2], face.ids, layer);
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
    let met = hit(corner.a, corner.b, corner.c, ids, sight_at(params, corner.position.xy));
    if !met.found {
        discard;
    }
    let depth = clamp(depth_of_z(params, met.z), 0.0, 1.0);
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
