// From what the layers gathered to the caller's picture. The last layer that ran, odd or even,
// tells in which of the two textures the sum stands.

#import lib/fullscreen

// Whether what was gathered is a scalar in red, where alpha is not 0: shown grey.
override PROJECTED: bool = false;

struct Resolve {
    background: vec4<f32>,
    // Peeled layers recorded, and the first pixel of the target.
    layers: u32,
}

@group(0) @binding(0) var even: texture_2d<f32>;
@group(0) @binding(1) var odd: texture_2d<f32>;
@group(0) @binding(2) var<storage, read> even_arguments: array<u32>;
@group(0) @binding(3) var<storage, read> odd_arguments: array<u32>;
@group(0) @binding(4) var<uniform> params: Resolve;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) last: u32,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Corner {
    var last = 0u;
    for (var layer = 1u; layer < params.layers; layer++) {
        let slot = (layer >> 1u) * 8u + 1u;
        var ran = 0u;
        if (layer & 1u) == 1u {
            ran = odd_arguments[slot];
        } else {
            ran = even_arguments[slot];
        }
        if ran == 0u {
            break;
        }
        last = layer;
    }
    return Corner(fullscreen(index), last);
}

@fragment
fn fragment(corner: Corner) -> @location(0) vec4<f32> {
    let pixel = vec2<u32>(corner.position.xy);
    var sum: vec4<f32>;
    if (corner.last & 1u) == 1u {
        sum = textureLoad(odd, pixel, 0);
    } else {
        sum = textureLoad(even, pixel, 0);
    }
    if PROJECTED {
        sum = select(vec4(0.0), vec4(sum.rrr, 1.0), sum.a > 0.0);
    }
    return sum + (1.0 - sum.a) * params.background;
}
