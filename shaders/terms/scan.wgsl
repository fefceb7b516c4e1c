// Image volumes (scans) attached to the body, sampled in texels at the rest position of each ray
// point. CPU reference: `render::scan`. Needs `corner_at` of the importing shader.
#term scan

#for render/walk_vertices render/walk_planes render/shadow_fill render/path
// Number of scans, and whether any of them is a label volume.
override SCAN_COUNT: u32 = 1u;
override LABELS: bool = false;

struct Scan {
    // Maps a rest position in the local frame to texels: dot(axis.xyz, place) + axis.w along each
    // axis.
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
    // Number of texels along each axis; w is the first texel in the texture, along z.
    size: vec4<f32>,
    // Normalised value: look.x texel + look.y. z is its row of the table; w is 1 for a label
    // volume.
    look: vec4<f32>,
}

// Label numbers are stored as multiples of 1 / MAX_LABELS.
const MAX_LABELS: f32 = 1024.0;

// The scans stacked along z: values from -1 to 1 over their range, or label numbers.
@group(0) @binding(next) var scan: texture_3d<f32>;
@group(0) @binding(next) var scan_sampler: sampler;
@group(0) @binding(next) var<storage, read> scans: array<Scan>;

fn texel_of(k: u32, rest: vec3<f32>) -> vec3<f32> {
    let s = scans[k];
    return vec3(dot(s.x.xyz, rest) + s.x.w, dot(s.y.xyz, rest) + s.y.w, dot(s.z.xyz, rest) + s.z.w);
}

fn has_labels(k: u32) -> bool {
    return LABELS & (scans[k].look.w > 0.5);
}

// Whether texel position p is inside scan k, including the outer half of its outermost texels.
fn is_inside(k: u32, p: vec3<f32>) -> bool {
    return all(p >= vec3(-0.5)) && all(p <= scans[k].size.xyz - 0.5);
}

// Returns the normalised value at texel position p: trilinear, clamped to the outermost centres.
fn normalised_value(k: u32, p: vec3<f32>) -> f32 {
    let size = scans[k].size;
    let q = clamp(p, vec3(0.0), size.xyz - 1.0) + 0.5 + vec3(0.0, 0.0, size.w);
    let texel = textureSampleLevel(scan, scan_sampler, q / vec3<f32>(textureDimensions(scan)), 0.0).x;
    return clamp(scans[k].look.x * texel + scans[k].look.y, 0.0, 1.0);
}

// Returns the label number at texel position p.
fn label_at(k: u32, p: vec3<f32>) -> u32 {
    let size = scans[k].size;
    let q = clamp(floor(p + 0.5), vec3(0.0), size.xyz - 1.0) + vec3(0.0, 0.0, size.w);
    return u32(MAX_LABELS * textureLoad(scan, vec3<i32>(q), 0).x + 0.5);
}

#for render/shadow_fill
// Returns the total extinction of all scans at a rest position, relative to the largest.
fn scans_extinction(rest: vec3<f32>, row: u32) -> f32 {
    var sum = 0.0;
    for (var k = 0u; k < SCAN_COUNT; k++) {
        let p = texel_of(k, rest);
        if !is_inside(k, p) {
            continue;
        }
        let own = select(u32(scans[k].look.z), row, k == 0u);
        if has_labels(k) {
            sum += textureLoad(colours, array_texel(u32(scans[k].look.z) * COLOUR_LUT_SIZE + label_at(k, p)), 0).w;
        } else {
            let nearest = u32(normalised_value(k, p) * f32(COLOUR_LUT_SIZE - 1u) + 0.5);
            sum += textureLoad(colours, array_texel(own * COLOUR_LUT_SIZE + nearest), 0).w;
        }
    }
    return sum;
}

#for render/walk_vertices render/walk_planes
// Maximum texels between two samples.
override SCAN_STEP: f32 = 1.0;
// Maximum number of sub-intervals per segment.
const MAX_STEPS: u32 = 8192u;
// Offset in texels past a label boundary that the ray has just reached.
const STEP_EPSILON: f32 = 1e-3;

#for render/walk_vertices render/walk_planes render/path
// F⁻ᵀ of the current tet, which transforms gradients from the rest to the deformed configuration.
var<private> rest_to_world: mat3x3<f32>;

#for render/walk_vertices render/walk_planes
fn set_rest_to_world(tet: u32) {
    let v = textureLoad(tets, array_texel(tet), 0);
    let p = corner_at(v.x);
    let r = textureLoad(rests, array_texel(v.x), 0).xyz;
    let p1 = corner_at(v.y) - p;
    let p2 = corner_at(v.z) - p;
    let p3 = corner_at(v.w) - p;
    let r1 = textureLoad(rests, array_texel(v.y), 0).xyz - r;
    let r2 = textureLoad(rests, array_texel(v.z), 0).xyz - r;
    let r3 = textureLoad(rests, array_texel(v.w), 0).xyz - r;
    let n = cross(p2, p3);
    let volume = dot(p1, n);
    // A degenerate tet has no gradient.
    let over = select(1.0 / volume, 0.0, abs(volume) < 1e-30);
    let c1 = n * over;
    let c2 = cross(p3, p1) * over;
    let c3 = cross(p1, p2) * over;
    rest_to_world = mat3x3(
        c1 * r1.x + c2 * r2.x + c3 * r3.x,
        c1 * r1.y + c2 * r2.y + c3 * r3.y,
        c1 * r1.z + c2 * r2.z + c3 * r3.z,
    );
}

#for render/walk_vertices render/walk_planes render/path
// Returns the gradient of scan k at a rest position, transformed to the deformed body in the local
// frame: the gradient of the values, or of the indicator function of the local label.
fn scan_gradient(k: u32, rest: vec3<f32>) -> vec3<f32> {
    let p = texel_of(k, rest);
    var g = vec3(0.0);
    for (var axis = 0u; axis < 3u; axis++) {
        var off = vec3(0.0);
        off[axis] = 1.0;
        if has_labels(k) {
            let own = label_at(k, p);
            g[axis] = 0.5 * (select(0.0, 1.0, label_at(k, p + off) == own) - select(0.0, 1.0, label_at(k, p - off) == own));
        } else {
            g[axis] = 0.5 * (normalised_value(k, p + off) - normalised_value(k, p - off));
        }
    }
    let s = scans[k];
    return rest_to_world * (g.x * s.x.xyz + g.y * s.y.xyz + g.z * s.z.xyz);
}

#for render/walk_vertices render/walk_planes
// Returns the table coordinate of a normalised value.
fn coordinate_of(share: f32) -> f32 {
    return params.scalar.x * share + params.scalar.y;
}

// Returns the sample at parameter u of a segment, with the value of the first scan.
fn scan_spot(whole: Segment, u: f32) -> RaySample {
    var spot = lerp_sample(whole.front, whole.back, u);
    if !has_labels(0u) {
        spot.s = coordinate_of(normalised_value(0u, texel_of(0u, spot.rest)));
    }
    return spot;
}

// Applies lighting and shadows to the colour and opacity of an unlit sub-interval.
fn in_light(k: u32, seen: vec4<f32>, part: Segment, ray: Ray) -> vec4<f32> {
    if LIGHTING {
        if seen.a <= 0.0 {
            return seen;
        }
        var light = shade(scan_gradient(k, 0.5 * (part.front.rest + part.back.rest)), ray.lights);
        if SHADOWS {
            light *= 0.5 * (part.front.bright + part.back.bright);
        }
        return vec4(min(light.x * seen.rgb + light.y * seen.a, vec3(seen.a)), seen.a);
    }
    return seen;
}

// Returns the colour of the label at p; w is its extinction, relative to the largest.
fn label_look(k: u32, p: vec3<f32>) -> vec4<f32> {
    return textureLoad(colours, array_texel(u32(scans[k].look.z) * COLOUR_LUT_SIZE + label_at(k, p)), 0);
}

// Returns the colour and opacity of a sub-interval from scan k, except the values of the first
// scan, which slice planes and isosurfaces also use.
fn shade_scan(k: u32, part: Segment, ray: Ray) -> vec4<f32> {
    let front = texel_of(k, part.front.rest);
    let back = texel_of(k, part.back.rest);
    let length = length_of(part, ray);
    if has_labels(k) {
        let look = label_look(k, 0.5 * (front + back));
        let alpha = 1.0 - exp2(-look.w * length);
        return in_light(k, vec4(look.rgb * alpha, alpha), part, ray);
    }
    let seen = segment(coordinate_of(normalised_value(k, front)), coordinate_of(normalised_value(k, back)), length, u32(scans[k].look.z));
    return in_light(k, seen, part, ray);
}

// Combines two media in one sub-interval: to first order, each attenuates half of the other.
fn blend_scans(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    return vec4(a.rgb * (1.0 - 0.5 * b.a) + b.rgb * (1.0 - 0.5 * a.a), a.a + b.a - a.a * b.a);
}

// Returns the colour and opacity of all scans in a sub-interval of at most one texel.
fn shade_stretch(part: Segment, row: u32, ray: Ray) -> vec4<f32> {
    var seen = vec4(0.0);
    let rest = 0.5 * (part.front.rest + part.back.rest);
    for (var k = 0u; k < SCAN_COUNT; k++) {
        if !is_inside(k, texel_of(k, rest)) {
            continue;
        }
        var own: vec4<f32>;
        if k == 0u {
            let values = !has_labels(0u);
            if ISOSURFACE_COUNT > 0u {
                own = shade_range(part, vec2(0.0, 1.0), row, ray, DRAW_VOLUME & values);
            } else if values {
                own = shade_lit_segment(part, row, ray);
            }
            if DRAW_VOLUME & !values {
                own += (1.0 - own.a) * shade_scan(0u, part, ray);
            }
        } else if DRAW_VOLUME {
            own = shade_scan(k, part, ray);
        }
        seen = select(blend_scans(seen, own), own, k == 0u);
    }
    return seen;
}

// Returns the parameter range of a segment that scan k covers, from 0 at its front to 1.
fn covered(k: u32, whole: Segment) -> vec2<f32> {
    let front = texel_of(k, whole.front.rest);
    let way = texel_of(k, whole.back.rest) - front;
    var range = vec2(0.0, 1.0);
    for (var axis = 0u; axis < 3u; axis++) {
        let low = -0.5 - front[axis];
        let high = scans[k].size[axis] - 0.5 - front[axis];
        if way[axis] == 0.0 {
            range = select(range, vec2(1.0, 0.0), low > 0.0 || high < 0.0);
        } else {
            let a = low / way[axis];
            let b = high / way[axis];
            range = vec2(max(range.x, min(a, b)), min(range.y, max(a, b)));
        }
    }
    return range;
}

// Returns the first parameter after u, up to `stop`, where the ray enters or leaves scan k or, for
// labels, enters another voxel.
fn next_boundary(k: u32, whole: Segment, u: f32, stop: f32) -> f32 {
    let range = covered(k, whole);
    var first = stop;
    first = select(first, min(first, range.x), range.x > u);
    first = select(first, min(first, range.y), range.y > u);
    if has_labels(k) {
        let front = texel_of(k, whole.front.rest);
        let way = texel_of(k, whole.back.rest) - front;
        let ahead = front + way * (u + STEP_EPSILON / max(length(way), 1e-6)) + 0.5;
        for (var axis = 0u; axis < 3u; axis++) {
            let wall = select(ceil(ahead[axis]) - 1.0, floor(ahead[axis]) + 1.0, way[axis] > 0.0);
            let at_wall = (wall - 0.5 - front[axis]) / select(way[axis], 1.0, way[axis] == 0.0);
            first = select(first, min(first, at_wall), way[axis] != 0.0 && at_wall > u);
        }
    }
    return first;
}

// Ray-marching plan of a segment: its parameter range and step length, as fractions of the segment.
struct StepPlan {
    range: vec2<f32>,
    step: f32,
}

fn step_plan(whole: Segment, kept_part: vec2<f32>) -> StepPlan {
    var range = kept_part;
    if SCAN_COUNT == 1u {
        let own = covered(0u, whole);
        range = vec2(max(range.x, own.x), min(range.y, own.y));
    }
    var texels = 0.0;
    for (var k = 0u; k < SCAN_COUNT; k++) {
        if !has_labels(k) {
            texels = max(texels, distance(texel_of(k, whole.front.rest), texel_of(k, whole.back.rest)));
        }
    }
    let span = range.y - range.x;
    return StepPlan(range, span / clamp(ceil(texels * span / SCAN_STEP - STEP_EPSILON), 1.0, f32(MAX_STEPS / 2u)));
}

// Returns the end of the sub-interval that begins at u.
fn next_stop(whole: Segment, way: StepPlan, u: f32) -> f32 {
    var stop = way.range.x + way.step * (floor((u - way.range.x) / way.step + STEP_EPSILON) + 1.0);
    if (SCAN_COUNT > 1u) | LABELS {
        for (var k = 0u; k < SCAN_COUNT; k++) {
            stop = next_boundary(k, whole, u, stop);
        }
    }
    stop = max(stop, u + STEP_EPSILON * STEP_EPSILON * way.step);
    return select(stop, way.range.y, stop + STEP_EPSILON * way.step >= way.range.y);
}

// Returns the colour and opacity of a segment; `row` is the row of its tet, and `before` the
// opacity accumulated in front of it.
fn scans_seen(whole: Segment, row: u32, ray: Ray, before: f32) -> vec4<f32> {
    var range = vec2(0.0, 1.0);
    if CLIP_PLANE_COUNT > 0u {
        range = unclipped_range(whole, ray);
    }
    var seen = vec4(0.0);
    if range.x >= range.y {
        return seen;
    }
    let clear = (row & TRANSPARENT_FLAG) != 0u;
    if clear & (SLICE_COUNT == 0u) {
        return seen;
    }
    let own = row & ~TRANSPARENT_FLAG;
    let way = step_plan(whole, range);
    if way.range.x >= way.range.y {
        return seen;
    }
    if LIGHTING & !clear {
        set_rest_to_world(whole.tet);
    }
    var u = way.range.x;
    var here = scan_spot(whole, u);
    var met = SurfaceHit(u, 0u);
    for (var i = 0u; i < MAX_STEPS; i++) {
        var stop = way.range.y;
        if !clear {
            stop = next_stop(whole, way, u);
        }
        var slice = SurfaceHit(stop, 0u);
        if SLICE_COUNT > 0u {
            slice = next_slice(whole, ray, met, stop);
            stop = slice.u;
        }
        let there = scan_spot(whole, stop);
        if !clear & (stop > u) {
            seen += (1.0 - seen.a) * shade_stretch(Segment(here, there, whole.tet), own, ray);
        }
        if slice.which != 0u {
            seen += (1.0 - seen.a) * surface_colour(slice.which, there, own, ray);
        }
        if ((stop >= way.range.y) & (slice.which == 0u)) | (before + (1.0 - before) * seen.a > OPACITY_CUTOFF) {
            break;
        }
        met = SurfaceHit(stop, slice.which);
        here = there;
        u = stop;
    }
    return seen;
}

// Returns the scan colours on a slice plane: the first scan with its transfer function, with the
// labels of the others blended at half opacity.
fn scans_sliced(spot: RaySample, row: u32) -> vec4<f32> {
    var seen = vec4(0.0);
    for (var k = 0u; k < SCAN_COUNT; k++) {
        let p = texel_of(k, spot.rest);
        if !is_inside(k, p) {
            continue;
        }
        if has_labels(k) {
            let look = label_look(k, p);
            let share = select(select(0.5, 1.0, seen.a == 0.0), 0.0, look.w <= 0.0);
            seen = mix(seen, vec4(look.rgb, 1.0), share);
        } else if k == 0u {
            seen = vec4(colour_of(coordinate_of(normalised_value(0u, p)), row), 1.0);
        }
    }
    return seen;
}

// Accumulates the maximum, minimum or mean of the first scan.
fn scans_projected(sum: vec4<f32>, whole: Segment, ray: Ray) -> vec4<f32> {
    var own = sum;
    var walked = walk_values(whole);
    while step_values(whole, &walked) {
        own = projected_scalar(own, Segment(walked.here, walked.there, whole.tet), ray);
    }
    return own;
}

// Returns the X-ray attenuation of the first scan, as if the body were at rest.
fn scans_attenuation(whole: Segment, ray: Ray) -> f32 {
    var sum = 0.0;
    var walked = walk_values(whole);
    while step_values(whole, &walked) {
        sum += mean_attenuation(walked.here.s, walked.there.s) * length_of(Segment(walked.here, walked.there, whole.tet), ray);
    }
    return sum;
}

// Iterator over the sub-intervals of the first scan in a segment.
struct ValueWalk {
    way: StepPlan,
    here: RaySample,
    there: RaySample,
    // The parameter of `there`, and the number of sub-intervals so far.
    u: f32,
    stops: u32,
}

fn walk_values(whole: Segment) -> ValueWalk {
    var walked: ValueWalk;
    walked.way = step_plan(whole, covered(0u, whole));
    walked.u = walked.way.range.x;
    walked.there = scan_spot(whole, walked.u);
    return walked;
}

// Advances to the next sub-interval; returns false at the end.
fn step_values(whole: Segment, walked: ptr<function, ValueWalk>) -> bool {
    let range = (*walked).way.range;
    if ((*walked).u >= range.y) | ((*walked).stops >= MAX_STEPS) | has_labels(0u) {
        return false;
    }
    let stop = next_stop(whole, (*walked).way, (*walked).u);
    (*walked).here = (*walked).there;
    (*walked).there = scan_spot(whole, stop);
    (*walked).u = stop;
    (*walked).stops += 1u;
    return true;
}
