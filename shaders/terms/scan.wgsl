// Scans that the body carries: looked up where each point of a ray is at rest, in texels. The twin of
// `render::scan`. Needs `corner_at` of the walk that imports it.
#term scan

#for render/walk_vertices render/walk_planes render/shadow_fill
// How many there are, and whether any of them has labels.
override SCAN_COUNT: u32 = 1u;
override LABELS: bool = false;

struct Scan {
    // The texel at a place at rest, in the local frame: dot(axis.xyz, place) + axis.w along each axis.
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
    // Texels along each axis, and where they begin in the texture, along z.
    size: vec4<f32>,
    // Share of the range: look.x texel + look.y. Its row of the table; 1 where it has labels.
    look: vec4<f32>,
}

// Numbers of labels are told in parts of this.
const MOST_LABELS: f32 = 1024.0;

// One after the other along z: values from -1 to 1 over all that occur, or numbers of labels.
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

// Whether a scan covers a place: up to the outer sides of its outermost texels.
fn is_inside(k: u32, p: vec3<f32>) -> bool {
    return all(p >= vec3(-0.5)) && all(p <= scans[k].size.xyz - 0.5);
}

// The share of the range at texel p, trilinear; at the rim that of the nearest centre.
fn normalised_value(k: u32, p: vec3<f32>) -> f32 {
    let size = scans[k].size;
    let q = clamp(p, vec3(0.0), size.xyz - 1.0) + 0.5 + vec3(0.0, 0.0, size.w);
    let texel = textureSampleLevel(scan, scan_sampler, q / vec3<f32>(textureDimensions(scan)), 0.0).x;
    return clamp(scans[k].look.x * texel + scans[k].look.y, 0.0, 1.0);
}

// The number of the label at texel p.
fn label_at(k: u32, p: vec3<f32>) -> u32 {
    let size = scans[k].size;
    let q = clamp(floor(p + 0.5), vec3(0.0), size.xyz - 1.0) + vec3(0.0, 0.0, size.w);
    return u32(MOST_LABELS * textureLoad(scan, vec3<i32>(q), 0).x + 0.5);
}

#for render/shadow_fill
// What all scans at a place at rest dim light by: extinction, over the largest.
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
// Texels between two look-ups, at most.
override SCAN_STEP: f32 = 1.0;
// Stretches of a segment between two look-ups, at most.
const MAX_STEPS: u32 = 8192u;
// Texels by which a wall between labels lies behind the ray that has just met it.
const STEP_EPSILON: f32 = 1e-3;

// What carries gradients from rest to where the tet is: F to the power -T, of the tet that the ray is
// in.
var<private> rest_to_world: mat3x3<f32>;

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
    // A flat tet has no gradient.
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

// The gradient of what scan k shows at a place at rest, as it is where the body is now, in the local
// frame: of values, or of being the label that is there.
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

// The table coordinate of a share.
fn coordinate_of(share: f32) -> f32 {
    return params.scalar.x * share + params.scalar.y;
}

// A place of a segment, with what the first scan has there.
fn scan_spot(whole: Segment, u: f32) -> RaySample {
    var spot = lerp_sample(whole.front, whole.back, u);
    if !has_labels(0u) {
        spot.s = coordinate_of(normalised_value(0u, texel_of(0u, spot.rest)));
    }
    return spot;
}

// Colour and opacity of a stretch in light, where no light was counted before.
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

// What a label looks like: its colour, and in w extinction, over the largest.
fn label_look(k: u32, p: vec3<f32>) -> vec4<f32> {
    return textureLoad(colours, array_texel(u32(scans[k].look.z) * COLOUR_LUT_SIZE + label_at(k, p)), 0);
}

// Colour and opacity of a stretch by scan k, other than values of the first, which planes and
// isosurfaces know of too.
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

// Two things in one stretch: each hides half of the other, to first order.
fn blend_scans(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    return vec4(a.rgb * (1.0 - 0.5 * b.a) + b.rgb * (1.0 - 0.5 * a.a), a.a + b.a - a.a * b.a);
}

// All scans in a stretch that is at most a texel long.
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

// The part of a segment that scan k covers, from 0 at its front to 1.
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

// The first place behind u, and up to `stop`, where scan k begins, ends, or has another voxel.
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

// How a segment is gone through: the part of it that is, and the length of a step, in shares.
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

// Where the stretch that begins at u ends.
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

// Colour and opacity of a segment; `row` is that of its tet, and `before` how opaque what is before
// it is.
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

// What a plane shows of the scans: the first, in the colours of its transfer function, and the labels
// of others half over it.
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

// The largest, least or mean value of the first scan, so far.
fn scans_projected(sum: vec4<f32>, whole: Segment, ray: Ray) -> vec4<f32> {
    var own = sum;
    var walked = walk_values(whole);
    while step_values(whole, &walked) {
        own = projected_scalar(own, Segment(walked.here, walked.there, whole.tet), ray);
    }
    return own;
}

// What the first scan attenuates X-rays by, as if the body were at rest.
fn scans_attenuation(whole: Segment, ray: Ray) -> f32 {
    var sum = 0.0;
    var walked = walk_values(whole);
    while step_values(whole, &walked) {
        sum += mean_attenuation(walked.here.s, walked.there.s) * length_of(Segment(walked.here, walked.there, whole.tet), ray);
    }
    return sum;
}

// A way through the values of the first scan in a segment, stretch by stretch.
struct ValueWalk {
    way: StepPlan,
    here: RaySample,
    there: RaySample,
    // Where `there` is, and stretches so far.
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

// Goes on to the next stretch; false where there is none.
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
