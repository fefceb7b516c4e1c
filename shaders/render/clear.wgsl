// An empty layer: no face, farthest depth, in the tiles in which the layer before has any. What is left of
// earlier layers in others does no harm: behind it nothing was found. A draw, so that it can be left out
// on the GPU.

#import lib/tet
#import lib/tiles

// The layer before, and of the layers of its parity the last that has a face in each tile.
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
