// Depth peeling, one layer: for each pixel, the nearest boundary face behind the previous layer in
// the order (depth, face), which neither loses nor duplicates touching or coincident faces.

#import lib/array
#import lib/view
#import lib/tet
#import lib/ray_projection
#each reads #import terms/TERM
#import lib/face
#import lib/tiles

// Whether this is the first layer, which has no previous one.
override FIRST_LAYER: bool = false;
// Opacity at which a pixel needs no further layers (early ray termination).
override PEEL_OPACITY_CUTOFF: f32 = 0.9995;

// Depth bits and 4 tet + face of the previous layer.
@group(0) @binding(next) var before: texture_2d<u32>;
// Accumulated result of the previous layers.
@group(0) @binding(next) var gathered: texture_2d<f32>;
// Draw arguments that depend on this layer, 8 words per layer of this parity.
@group(0) @binding(next) var<storage, read_write> arguments: array<atomic<u32>>;
// For the layers of this parity, the last one that has a face in each tile.
@group(0) @binding(next) var<storage, read_write> last: array<atomic<u32>>;
@group(0) @binding(next) var<uniform> params: View;

struct Corner {
    @invariant @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) face: u32,
    @location(1) @interpolate(flat) layer: u32,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Corner {
    // Layer k draws vertices k n .. (k + 1) n of an n-vertex boundary, which identifies k.
    let layer = index / params.corners;
    let corner = index - layer * params.corners;
    // Each fragment writes its own depth.
    if BACK_FACES {
        let face = corner / 3u;
        return Corner(vec4(face_of(face).corners[corner % 3u], 0.5, 1.0), face, layer);
    }
    let cover = cover_at(corner);
    return Corner(vec4(bitcast<vec2<f32>>(cover.xy), 0.5, 1.0), cover.z, layer);
}

struct RayStart {
    // Depth bits and 4 tet + face.
    @location(0) key: vec2<u32>,
    @builtin(frag_depth) depth: f32,
}

@fragment
fn fragment(corner: Corner) -> RayStart {
    let pixel = vec2<u32>(corner.position.xy);
    let ids = face_ids(corner.face);
    var nearer = vec2(0u, NONE);
    if !FIRST_LAYER {
        nearer = textureLoad(before, pixel, 0).xy;
        // If the previous layer found nothing, this layer finds nothing. The face of the previous
        // layer is excluded by number, independent of depth rounding.
        if nearer.y == NONE || ids.w == nearer.y {
            discard;
        }
    }
    let frame = ray_frame(params, corner.position.xy);
    let met = intersect_face(projected_at(ids.x).xyz, projected_at(ids.y).xyz, projected_at(ids.z).xyz, ids, frame);
    if !met.found {
        discard;
    }
    let depth = clamp(depth_of_z(params, met.z), 0.0, 1.0);
    if !FIRST_LAYER {
        let nearer_depth = bitcast<f32>(nearer.x);
        let behind = depth < nearer_depth || (depth == nearer_depth && ids.w > nearer.y);
        if !behind || textureLoad(gathered, pixel, 0).a > PEEL_OPACITY_CUTOFF {
            discard;
        }
        let slot = (corner.layer >> 1u) * 8u;
        atomicStore(&arguments[slot + 1u], 1u);
        atomicStore(&arguments[slot + 5u], 1u);
        atomicStore(&last[tile_at(pixel, textureDimensions(before))], corner.layer);
    }
    return RayStart(vec2(bitcast<u32>(depth), ids.w), depth);
}
