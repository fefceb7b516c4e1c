// The paper's table: colour and opacity of segments, a volume of which the third axis is depth, as
// layers of one array. Needs `params: View` of the shader that imports it.
//
// Depths are lengths times the largest extinction, times log2(e).
#term table

// Segments longer than params.reach, the depth of the last layer, are looked up in pieces.
const MOST_PIECES: f32 = 65536.0;

// At this opacity no further piece is looked up.
override INTEGRATION_CUTOFF: f32 = 0.9995;

@group(0) @binding(next) var table: texture_2d_array<f32>;
@group(0) @binding(next) var smooth_sampler: sampler;

// Colour (premultiplied) and opacity of a segment between table coordinates s0 (front) and s1; of
// the first transfer function: there is one.
fn segment(s0: f32, s1: f32, depth: f32, row: u32) -> vec4<f32> {
    let pieces = clamp(ceil(depth / params.table_max_depth), 1.0, MOST_PIECES);
    let layer = clamp(depth / (pieces * params.table_max_depth), 0.0, 1.0) * f32(params.layers - 1u);
    let below = i32(min(layer, f32(params.layers) - 2.0));
    var sum = vec4(0.0);
    for (var i = 0.0; i < pieces && sum.a < INTEGRATION_CUTOFF; i += 1.0) {
        let s = mix(vec2(s0), vec2(s1), vec2(i, i + 1.0) / pieces);
        let shorter = textureSampleLevel(table, smooth_sampler, s, below, 0.0);
        let longer = textureSampleLevel(table, smooth_sampler, s, below + 1, 0.0);
        sum += (1.0 - sum.a) * mix(shorter, longer, layer - f32(below));
    }
    return sum;
}
