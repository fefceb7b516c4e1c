// Transfer function without pre-integration: colour and extinction in one line of texels, sampled
// at points of each segment. Depths are lengths times the largest extinction, times log2(e).
#term table

// Samples per segment.
override SAMPLES: u32 = 1u;

@group(0) @binding(next) var table: texture_2d_array<f32>;
@group(0) @binding(next) var smooth_sampler: sampler;

// Returns the premultiplied colour and opacity of a segment between table coordinates s0 (front)
// and s1. There is only one transfer function, so `row` is ignored.
fn segment(s0: f32, s1: f32, depth: f32, row: u32) -> vec4<f32> {
    var seen = vec4(0.0);
    for (var i = 0u; i < SAMPLES; i++) {
        let s = mix(s0, s1, (f32(i) + 0.5) / f32(SAMPLES));
        let found = textureSampleLevel(table, smooth_sampler, vec2(s, 0.5), 0, 0.0);
        let alpha = 1.0 - exp2(-found.a * depth / f32(SAMPLES));
        seen += (1.0 - seen.a) * vec4(found.rgb * alpha, alpha);
    }
    return seen;
}
