// The look-up of a segment in the table. Needs `table`, `smooth_sampler` and `params: View` of the
// shader that imports it.

// The table: 0 = slices of mean colour and mean extinction, 1 = the paper's volume of colour and
// opacity. Both are layers of one array; depths are lengths times the largest extinction, times
// log2(e). 2 = no integration: a line of colour and extinction, looked up at points.
override TABLE: u32 = 0u;
// Those points, in a segment.
override SAMPLES: u32 = 1u;
// Slices: 2^OCTAVE_BITS to an octave of depth, the first octave beginning at 2^FIRST_OCTAVE; the
// last slice serves all that is longer.
const OCTAVE_BITS: u32 = 2u;
const FIRST_OCTAVE: i32 = -5;
// Volume: segments longer than params.reach, the depth of its last layer, are looked up in pieces.
const MOST_PIECES: f32 = 65536.0;

// A ray this opaque is not followed further.
override OPAQUE: f32 = 0.9995;

// Colour (premultiplied) and opacity of a segment between table coordinates s0 (front) and s1.
fn segment(s0: f32, s1: f32, depth: f32) -> vec4<f32> {
    if TABLE == 0u {
        // The upper bits of a float are its logarithm, linear between powers of two.
        let bin = i32(bitcast<u32>(depth) >> (23u - OCTAVE_BITS)) - ((127 + FIRST_OCTAVE) << OCTAVE_BITS);
        let slice = clamp(bin, 0, i32(params.layers) - 1);
        let mean = textureSampleLevel(table, smooth_sampler, vec2(s0, s1), slice, 0.0);
        let alpha = 1.0 - exp2(-mean.a * depth);
        return vec4(mean.rgb * alpha, alpha);
    }
    if TABLE == 2u {
        var seen = vec4(0.0);
        for (var i = 0u; i < SAMPLES; i++) {
            let s = mix(s0, s1, (f32(i) + 0.5) / f32(SAMPLES));
            let found = textureSampleLevel(table, smooth_sampler, vec2(s, 0.5), 0, 0.0);
            let alpha = 1.0 - exp2(-found.a * depth / f32(SAMPLES));
            seen += (1.0 - seen.a) * vec4(found.rgb * alpha, alpha);
        }
        return seen;
    }
    let pieces = clamp(ceil(depth / params.reach), 1.0, MOST_PIECES);
    let layer = clamp(depth / (pieces * params.reach), 0.0, 1.0) * f32(params.layers - 1u);
    let below = i32(min(layer, f32(params.layers) - 2.0));
    var sum = vec4(0.0);
    for (var i = 0.0; i < pieces && sum.a < OPAQUE; i += 1.0) {
        let s = mix(vec2(s0), vec2(s1), vec2(i, i + 1.0) / pieces);
        let shorter = textureSampleLevel(table, smooth_sampler, s, below, 0.0);
        let longer = textureSampleLevel(table, smooth_sampler, s, below + 1, 0.0);
        sum += (1.0 - sum.a) * mix(shorter, longer, layer - f32(below));
    }
    return sum;
}
