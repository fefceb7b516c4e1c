// What a walk gathers along its ray: composited colour, length, a scalar, or counts. Needs `table`,
// `smooth_sampler` and `params: View` of the shader that imports it.

#import lib/shade

// What is gathered.
override MODE: u32 = 0u;
const COMPOSITE: u32 = 0u;
const THICKNESS: u32 = 1u;
// Tets passed, whether there were any, and how often the ray begins.
const STATISTICS: u32 = 2u;
// The largest scalar, the least, and the mean over the length: in red, and of the mean in green the
// length so far. Alpha is a half where there is any: what is opaque is looked for no further.
const MAXIMUM: u32 = 3u;
const MINIMUM: u32 = 4u;
const MEAN: u32 = 5u;

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

// A stretch of a ray inside one tet, as either walk hands it on.
struct Segment {
    // Table coordinates at its front and its back.
    s: vec2<f32>,
    // In the unit of the mode: depth as above, or length in file units.
    length: f32,
    // In light: the factor on its colour, and what is added to it.
    shade: vec2<f32>,
}

// Its colour and opacity, in light.
fn seen_in_light(part: Segment) -> vec4<f32> {
    let seen = segment(part.s.x, part.s.y, part.length);
    if LIT {
        return vec4(min(part.shade.x * seen.rgb + part.shade.y * seen.a, vec3(seen.a)), seen.a);
    }
    return seen;
}

// Adds a segment to what the ray has gathered.
fn gather(sum: vec4<f32>, part: Segment) -> vec4<f32> {
    if MODE == COMPOSITE {
        return sum + (1.0 - sum.a) * seen_in_light(part);
    }
    if MODE == THICKNESS {
        return vec4(sum.r + part.length, 0.0, 0.0, 0.0);
    }
    if MODE == MAXIMUM || MODE == MINIMUM || MODE == MEAN {
        return projected_scalar(sum, part);
    }
    return vec4(sum.r + 1.0, sum.gba);
}

// The scalar is linear in a segment: it is largest and least at the ends, and its mean is theirs.
fn projected_scalar(sum: vec4<f32>, part: Segment) -> vec4<f32> {
    let s = clamp(part.s, vec2(0.0), vec2(1.0));
    let first = sum.a == 0.0;
    if MODE == MAXIMUM {
        return vec4(max(max(s.x, s.y), select(sum.r, 0.0, first)), 0.0, 0.0, 0.5);
    }
    if MODE == MINIMUM {
        return vec4(min(min(s.x, s.y), select(sum.r, 1.0, first)), 0.0, 0.0, 0.5);
    }
    let length = sum.g + part.length;
    let share = select(0.5, part.length / length, length > 0.0);
    return vec4(mix(sum.r, 0.5 * (s.x + s.y), select(share, 1.0, first)), length, 0.0, 0.5);
}

// The same behind what comes: the segment lies in front of everything gathered.
fn gather_in_front(sum: vec4<f32>, part: Segment) -> vec4<f32> {
    if MODE == COMPOSITE {
        let front = seen_in_light(part);
        return front + (1.0 - front.a) * sum;
    }
    return gather(sum, part);
}

// Counts a way through the mesh that begins: at a front face, or at an eye inside.
fn begun(sum: vec4<f32>) -> vec4<f32> {
    return select(sum, vec4(sum.r, 1.0, sum.b + 1.0, sum.a), MODE == STATISTICS);
}

fn is_opaque(sum: vec4<f32>) -> bool {
    return MODE == COMPOSITE && sum.a > OPAQUE;
}
