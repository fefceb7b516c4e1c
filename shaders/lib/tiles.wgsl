// Screen tiles, for passes restricted to the tiles in which a layer has a face.
//
// The vertices of layer k > 0 start at 6 k n, six for each of the n tiles; the first three form one
// full-screen triangle, of layer 0.

#import lib/fullscreen

// Tile size in pixels; must match `render::depth_peeling`.
const TILE_SIZE: u32 = 16u;
const CULLED_POSITION: vec4<f32> = vec4(2.0, 2.0, 0.0, 1.0);

struct Tile {
    number: u32,
    layer: u32,
    // In clip space.
    corner: vec4<f32>,
}

fn tile_grid(size: vec2<u32>) -> vec2<u32> {
    return (size + TILE_SIZE - 1u) / TILE_SIZE;
}

// Returns the tile of a pixel in an image of this size.
fn tile_at(pixel: vec2<u32>, size: vec2<u32>) -> u32 {
    let tile = pixel / TILE_SIZE;
    return tile.y * tile_grid(size).x + tile.x;
}

fn tile_of_vertex(index: u32, size: vec2<u32>) -> Tile {
    let across = tile_grid(size);
    let all = across.x * across.y;
    let number = (index / 6u) % all;
    let tile = vec2(number % across.x, number / across.x);
    // Two triangles: corners 0 1 2 and 3 2 1.
    let k = index % 6u;
    let corner = select(k, 6u - k, k > 2u);
    let pixel = min(TILE_SIZE * (tile + vec2(corner & 1u, corner >> 1u)), size);
    let share = vec2<f32>(pixel) / vec2<f32>(size);
    return Tile(number, index / (6u * all), vec4(2.0 * share.x - 1.0, 1.0 - 2.0 * share.y, 0.0, 1.0));
}
