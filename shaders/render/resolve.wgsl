// Writes the accumulated layers to the output image. The parity of the last layer in a tile selects
// the texture that holds its result.

#import lib/tiles

// Whether the accumulated value is a scalar in red, valid where alpha is not 0: shown as grey.
override PROJECTION_MODE: bool = false;

struct Resolve {
    background: vec4<f32>,
    // Maximum number of layers.
    layers: u32,
}

@group(0) @binding(0) var even: texture_2d<f32>;
@group(0) @binding(1) var odd: texture_2d<f32>;
// For even and for odd layers, the last one that has a face in each tile.
@group(0) @binding(2) var<storage, read> even_layers: array<u32>;
@group(0) @binding(3) var<storage, read> odd_layers: array<u32>;
@group(0) @binding(4) var<uniform> params: Resolve;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return fullscreen(index);
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<u32>(position.xy);
    let tile = tile_at(pixel, textureDimensions(even));
    let last = min(max(even_layers[tile], odd_layers[tile]), params.layers - 1u);
    var sum: vec4<f32>;
    if (last & 1u) == 1u {
        sum = textureLoad(odd, pixel, 0);
    } else {
        sum = textureLoad(even, pixel, 0);
    }
    if PROJECTION_MODE {
        sum = select(vec4(0.0), vec4(sum.rrr, 1.0), sum.a > 0.0);
    }
    return sum + (1.0 - sum.a) * params.background;
}
