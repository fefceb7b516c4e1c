// Integrals of the transfer function over the scalar: colour times extinction, extinction, and the
// moment that accounts for self-occlusion within a segment. CPU reference:
// `render::table::integrals`. Needs `table_at` of the importing term: the texel of a point, in two
// rows per transfer function, C and P, then Q.
//
// Table coordinates are points; depths are lengths times the largest extinction, times log2(e).

// Whether segments may be so deep that they need subdivision.
override PIECES: bool = true;
// The largest colour component, if above 1; colours are stored relative to it.
override MAX_COLOUR: f32 = 1.0;

// Number of intervals between the points of scalars 0 and 1.
const INTERVALS: f32 = 4094.0;
// Fixed-point scale: differences are exact, modulo 2^32.
const FIXED_POINT_SCALE: f32 = 2147483000.0;
// P(b) - P(a), relative to the largest extinction, below which rounding corrupts the moment.
const MIN_DEPTH: f32 = 1e-3;
// Maximum depth per look-up, and maximum number of subdivisions of a segment.
const MAX_DEPTH_PER_LOOKUP: f32 = 1.5;
const MAX_PIECES: f32 = 256.0;
// Opacity at which integration stops (early termination).
const INTEGRATION_CUTOFF: f32 = 0.9995;

// Integrates from point a to point b of a segment whose optical depth per point is `depth` at the
// largest extinction; `at_a` and `at_b` are the table entries at its ends.
fn integrate_interval(a: i32, b: i32, at_a: vec4<u32>, at_b: vec4<u32>, depth: f32, row: u32) -> vec4<f32> {
    let sum = vec4<f32>(bitcast<vec4<i32>>(at_b - at_a));
    let alpha = 1.0 - exp2(-sum.a * depth);
    let over = select(1.0 / sum.a, 0.0, sum.a == 0.0);
    var colour = sum.rgb * over;
    let moments = table_at(b, 2u * row + 1u).rgb - table_at(a, 2u * row + 1u).rgb;
    let moment = vec3<f32>(bitcast<vec3<i32>>(moments)) - sum.rgb * (f32(at_a.a) / FIXED_POINT_SCALE);
    // To first order in its depth t the mean colour is c + t (c / 2 - moment); at large t the
    // correction for a linear colour is 6 / t of that.
    let t = sum.a * depth * 0.6931472;
    let clear = sum.a * (1.0 / FIXED_POINT_SCALE) / MIN_DEPTH;
    let trust = clear * clear / (1.0 + clear * clear);
    let bend = 0.5 * colour - moment * (FIXED_POINT_SCALE * over * over);
    colour = clamp(colour + bend * (trust * t * inverseSqrt(1.0 + t * t / 36.0)), vec3(0.0), vec3(1.0));
    return vec4(colour * (MAX_COLOUR * alpha), alpha);
}

// Returns the premultiplied colour and opacity of a segment between table coordinates s0 (front)
// and s1, with transfer function `row`.
fn segment(s0: f32, s1: f32, depth: f32, row: u32) -> vec4<f32> {
    let a = i32(s0 + 0.5);
    var b = i32(s1 + 0.5);
    // A nearly constant scalar is represented by the interval that contains it.
    b = select(b, a + select(-1, 1, s1 >= f32(a)), a == b);
    let at_a = table_at(a, 2u * row);
    let at_b = table_at(b, 2u * row);
    let depth_a_point = depth * (INTERVALS / FIXED_POINT_SCALE) / f32(b - a);
    if !PIECES {
        return integrate_interval(a, b, at_a, at_b, depth_a_point, row);
    }
    var pieces = 1;
    var to = b;
    var at_to = at_b;
    let t = f32(bitcast<i32>(at_b.a - at_a.a)) * depth_a_point;
    if t > MAX_DEPTH_PER_LOOKUP {
        pieces = min(i32(ceil(min(t / MAX_DEPTH_PER_LOOKUP, MAX_PIECES))), abs(b - a));
        to = a + (b - a) / pieces;
        at_to = table_at(to, 2u * row);
    }
    // One loop for whole and subdivided segments: with a path for each, a GPU needs registers for both.
    var seen = vec4(0.0);
    var from_ = a;
    var at_from = at_a;
    var i = 1;
    loop {
        seen += (1.0 - seen.a) * integrate_interval(from_, to, at_from, at_to, depth_a_point, row);
        if (i >= pieces) | (seen.a >= INTEGRATION_CUTOFF) {
            break;
        }
        i += 1;
        from_ = to;
        at_from = at_to;
        to = a + (b - a) * i / pieces;
        at_to = table_at(to, 2u * row);
    }
    return seen;
}
