// Ray accumulation: composited colour, length, a scalar, or counts. Needs lib/array, `segment` of a
// table, `Ray` and `BACKWARD_TRAVERSAL` of lib/walk_frame, and `params: View`.

#import lib/shade
#import lib/sections
#import lib/xray

// Whether each region has its own transfer function: a row of the table.
override HAS_REGIONS: bool = false;
// Row value of hidden tets, and the flag of rows in which scans are fully transparent.
const HIDDEN: u32 = 0xffffu;
const TRANSPARENT_FLAG: u32 = 0x8000u;
// Whether scans replace the scalar.
override HAS_SCANS: bool = false;
// Opacity at which a ray is terminated early.
override OPACITY_CUTOFF: f32 = 0.9995;

// Table row of each tet, if HAS_REGIONS.
@group(0) @binding(next) var rows: texture_2d<u32>;

// The accumulated quantity.
override INTEGRAND: u32 = 0u;
const COMPOSITE: u32 = 0u;
const THICKNESS: u32 = 1u;
// Number of tets traversed, whether there were any, and number of ray entries.
const STATISTICS: u32 = 2u;
// Largest scalar, smallest scalar, and mean over the length: in red; for the mean, green holds the
// length so far. Alpha is 0.5 once there is a value, which is below the early-termination limit.
const MAXIMUM: u32 = 3u;
const MINIMUM: u32 = 4u;
const MEAN: u32 = 5u;
// Line integral of X-ray attenuation.
const XRAY: u32 = 6u;

// Sample on a ray.
struct RaySample {
    // Camera-space z.
    z: f32,
    // Table coordinate.
    s: f32,
    // If LIGHTING: gradient of the scalar, in the local frame.
    gradient: vec3<f32>,
    // If SHADOWS: fraction of light that reaches the sample.
    bright: f32,
    // If USE_REST_POSITIONS: rest position, in the local frame.
    rest: vec3<f32>,
}

// Interpolates from a (u = 0) to b (u = 1).
fn lerp_sample(a: RaySample, b: RaySample, u: f32) -> RaySample {
    return RaySample(mix(a.z, b.z, u), mix(a.s, b.s, u), mix(a.gradient, b.gradient, u), mix(a.bright, b.bright, u), mix(a.rest, b.rest, u));
}

// Segment of a ray inside one tet.
struct Segment {
    front: RaySample,
    back: RaySample,
    tet: u32,
}

// Returns the length of a segment in the unit of the mode: optical depth, or length in file units.
fn length_of(part: Segment, ray: Ray) -> f32 {
    return (part.back.z - part.front.z) * ray.scale;
}

// Accumulates a segment: behind the existing sum, or in front of it in a backward traversal.
fn accumulate_segment(sum: vec4<f32>, whole: Segment, ray: Ray) -> vec4<f32> {
    var row = 0u;
    if HAS_REGIONS & (INTEGRAND != STATISTICS) {
        row = textureLoad(rows, array_texel(whole.tet), 0).x;
        if row == HIDDEN {
            return sum;
        }
    }
    if INTEGRAND == COMPOSITE {
        var seen: vec4<f32>;
        if HAS_SCANS {
#any scan             seen = scans_seen(whole, row, ray, select(sum.a, 0.0, BACKWARD_TRAVERSAL));
        } else if (CLIP_PLANE_COUNT + SLICE_COUNT + ISOSURFACE_COUNT > 0u) | !DRAW_VOLUME {
            seen = shade_segment(whole, row, ray);
        } else {
            seen = shade_lit_segment(whole, row, ray);
        }
        return select(sum + (1.0 - sum.a) * seen, seen + (1.0 - seen.a) * sum, BACKWARD_TRAVERSAL);
    }
    var part = whole;
    if (CLIP_PLANE_COUNT > 0u) & (INTEGRAND != STATISTICS) {
        let range = unclipped_range(whole, ray);
        if range.x >= range.y {
            return sum;
        }
        part = sub_segment(whole, range);
    }
    if INTEGRAND == THICKNESS {
        return vec4(sum.r + length_of(part, ray), 0.0, 0.0, 0.0);
    }
    if INTEGRAND == XRAY {
        let dense = density_ratio(part.tet);
#any scan         if HAS_SCANS { return vec4(sum.r + dense * scans_attenuation(part, ray), 0.0, 0.0, 0.0); }
        return vec4(sum.r + dense * mean_attenuation(part.front.s, part.back.s) * length_of(part, ray), 0.0, 0.0, 0.0);
    }
    if INTEGRAND == MAXIMUM || INTEGRAND == MINIMUM || INTEGRAND == MEAN {
#any scan         if HAS_SCANS { return scans_projected(sum, part, ray); }
        return projected_scalar(sum, part, ray);
    }
    return vec4(sum.r + 1.0, sum.gba);
}

// Returns the lit colour and opacity of a segment.
fn shade_lit_segment(part: Segment, row: u32, ray: Ray) -> vec4<f32> {
    let seen = segment(part.front.s, part.back.s, length_of(part, ray), row);
    if LIGHTING {
        var gradient = 0.5 * (part.front.gradient + part.back.gradient);
#any scan         if seen.a <= 0.0 { return seen; }
#any scan         gradient = scan_gradient(0u, 0.5 * (part.front.rest + part.back.rest));
        var light = shade(gradient, ray.lights);
        if SHADOWS {
            light *= 0.5 * (part.front.bright + part.back.bright);
        }
        return vec4(min(light.x * seen.rgb + light.y * seen.a, vec3(seen.a)), seen.a);
    }
    return seen;
}

// The scalar is linear in a segment: its extremes are at the ends, and its mean is theirs.
fn projected_scalar(sum: vec4<f32>, part: Segment, ray: Ray) -> vec4<f32> {
    let s = clamp(vec2(part.front.s, part.back.s), vec2(0.0), vec2(1.0));
    let first = sum.a == 0.0;
    if INTEGRAND == MAXIMUM {
        return vec4(max(max(s.x, s.y), select(sum.r, 0.0, first)), 0.0, 0.0, 0.5);
    }
    if INTEGRAND == MINIMUM {
        return vec4(min(min(s.x, s.y), select(sum.r, 1.0, first)), 0.0, 0.0, 0.5);
    }
    let own = length_of(part, ray);
    let length = sum.g + own;
    let share = select(0.5, own / length, length > 0.0);
    return vec4(mix(sum.r, 0.5 * (s.x + s.y), select(share, 1.0, first)), length, 0.0, 0.5);
}

// Counts the start of a ray through the mesh: at a front face, or at an eye inside.
fn initial_accumulator(sum: vec4<f32>) -> vec4<f32> {
    return select(sum, vec4(sum.r, 1.0, sum.b + 1.0, sum.a), INTEGRAND == STATISTICS);
}

// Whether the ray is opaque (early ray termination). A backward traversal never terminates early,
// because later segments are in front.
fn is_terminated(sum: vec4<f32>) -> bool {
    return (INTEGRAND == COMPOSITE) & !BACKWARD_TRAVERSAL & (sum.a > OPACITY_CUTOFF);
}
