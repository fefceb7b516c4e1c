// One peeled layer: for each pixel, the nearest boundary face behind the layer before, in the
// order (depth, face), which neither loses nor doubles touching or coincident faces.

#import lib/array
#import lib/view
#import lib/tet

// The first layer has none before it.
override FIRST: bool = false;
// A pixel this opaque needs no further layers; above 1 to peel them all.
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
    @location(0) @interpolate(flat) code: u32,
    @location(1) @interpolate(flat) layer: u32,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Corner {
    // Layer k draws vertices k n .. (k + 1) n of an n-vertex boundary, and so learns k.
    let layer = index / params.corners;
    let corner = index - layer * params.corners;
    let face = textureLoad(boundary, at(corner / 3u), 0);
    let q = textureLoad(projected, at(face[corner % 3u]), 0);
    return Corner(to_clip(params, q.xyz), face.w, layer);
}

@fragment
fn fragment(corner: Corner) -> @location(0) vec2<u32> {
    let z = corner.position.z;
    if !FIRST {
        let pixel = vec2<u32>(corner.position.xy);
        let last = textureLoad(before, pixel, 0).xy;
        let last_z = bitcast<f32>(last.x);
        let behind = z < last_z || (z == last_z && corner.code > last.y);
        // Where the layer before found nothing, this one finds nothing.
        if last.y == NONE || !behind || textureLoad(gathered, pixel, 0).a > ENOUGH {
            discard;
        }
        let slot = (corner.layer >> 1u) * 8u;
        atomicStore(&arguments[slot + 1u], 1u);
        atomicStore(&arguments[slot + 5u], 1u);
    }
    return vec2(bitcast<u32>(z), corner.code);
}
