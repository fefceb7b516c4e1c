// Bilinear interpolation without a filtering sampler.

// Samples `texels` at continuous texel coordinates (0 is the first texel's centre), clamped.
fn bilinear(texels: texture_2d<f32>, size: u32, where_: vec2<f32>) -> vec4<f32> {
    let p = clamp(where_, vec2(0.0), vec2(f32(size - 1u)));
    let i = min(vec2<u32>(p), vec2(size - 2u));
    let f = p - vec2<f32>(i);
    let low = mix(textureLoad(texels, i, 0), textureLoad(texels, i + vec2(1u, 0u), 0), f.x);
    let high = mix(textureLoad(texels, i + vec2(0u, 1u), 0), textureLoad(texels, i + vec2(1u, 1u), 0), f.x);
    return mix(low, high, f.y);
}
