// Draws a texture over the whole viewport.

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var smooth_sampler: sampler;

// Whether the target expects linear light.
override LINEAR: f32 = 0.0;

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) at: vec2f,
}

@vertex
fn corner(@builtin(vertex_index) index: u32) -> Corner {
    let at = vec2f(f32((index << 1u) & 2u), f32(index & 2u));
    return Corner(vec4f(2.0 * at.x - 1.0, 1.0 - 2.0 * at.y, 0.0, 1.0), at);
}

@fragment
fn pixel(seen: Corner) -> @location(0) vec4f {
    let colour = textureSampleLevel(picture, smooth_sampler, seen.at, 0.0);
    if LINEAR == 0.0 {
        return colour;
    }
    let low = colour.rgb / 12.92;
    let high = pow((colour.rgb + 0.055) / 1.055, vec3f(2.4));
    return vec4f(select(high, low, colour.rgb <= vec3f(0.04045)), colour.a);
}

// For a texture of the same size as the target.
@fragment
fn same_pixel(seen: Corner) -> @location(0) vec4f {
    return textureLoad(picture, vec2u(seen.position.xy), 0);
}
