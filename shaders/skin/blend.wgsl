// Composites one skin layer and the part of the volume in front of it behind all nearer layers.
//
// The volume is ray cast from the eye to this layer each time. With V the premultiplied colour and
// opacity up to a layer, the contribution of the volume between two layers is the difference of
// their V, attenuated by the nearer skins only. This is exact and needs no division.

// Whether this is the last layer: opaque objects behind the skins, and the final image.
override LAST_LAYER: bool = false;
// Whether this is the first layer.
override FIRST_LAYER: bool = false;

struct Blend {
    background: vec4<f32>,
}

// Accumulated colour, and transmittance of the skins so far.
@group(0) @binding(0) var before: texture_2d<f32>;
// The volume up to the previous layer, and up to this one.
@group(0) @binding(1) var volume_before: texture_2d<f32>;
@group(0) @binding(2) var volume: texture_2d<f32>;
// The layer, with premultiplied colour.
@group(0) @binding(3) var layer: texture_2d<f32>;
@group(0) @binding(4) var<uniform> params: Blend;

#import lib/fullscreen

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return fullscreen(index);
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<u32>(position.xy);
    var sum = vec4(0.0, 0.0, 0.0, 1.0);
    var near = vec4(0.0);
    if !FIRST_LAYER {
        sum = textureLoad(before, pixel, 0);
        near = textureLoad(volume_before, pixel, 0);
    }
    let far = textureLoad(volume, pixel, 0);
    let skin = textureLoad(layer, pixel, 0);
    let colour = sum.rgb + sum.a * (far.rgb - near.rgb + (1.0 - far.a) * skin.rgb);
    let through = sum.a * (1.0 - skin.a);
    if LAST_LAYER {
        let rest = through * (1.0 - far.a);
        return vec4(colour, 1.0 - rest) + rest * params.background;
    }
    return vec4(colour, through);
}
