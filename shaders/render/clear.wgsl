// Clears a layer (no face, farthest depth) in the tiles in which the previous layer has a face.
// Stale data of earlier layers in other tiles is harmless, because nothing lies behind it. This is
// a draw, so that the GPU can skip it with indirect arguments.

#import lib/tet
#import lib/tiles

// The previous layer, and for the layers of its parity the last one that has a face in each tile.
@group(0) @binding(next) var before: texture_2d<u32>;
@group(0) @binding(next) var<storage, read> last: array<u32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    if index < 3u {
        return fullscreen(index);
    }
    let tile = tile_of_vertex(index, textureDimensions(before));
    return select(CULLED_POSITION, tile.corner, last[tile.number] == tile.layer);
}

@fragment
fn fragment() -> @location(0) vec2<u32> {
    return vec2(0u, NONE);
}
