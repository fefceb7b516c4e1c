// Planes and isosurfaces in a volume: clips segments and intersects them with surfaces. CPU
// reference: `render::sections`. Needs the same imports as lib/segment.

// Number of clip planes, slice planes (which show the scalar) and isosurfaces.
override CLIP_PLANE_COUNT: u32 = 0u;
override SLICE_COUNT: u32 = 0u;
override ISOSURFACE_COUNT: u32 = 0u;
// Whether any plane is defined in the rest configuration.
override USE_REST_POSITIONS: bool = false;
// Whether the volume is rendered in addition to the surfaces.
override DRAW_VOLUME: bool = true;

// Colours per transfer function in `colours`.
const COLOUR_LUT_SIZE: u32 = 1024u;

// Two texels each. Planes, clip planes first: n and c of n · x = c, where the half-space that n
// points to is clipped; 1 if defined in the rest configuration, opacity. Isosurfaces: table
// coordinate, opacity, and 1 for a colour of its own; that colour.
@group(0) @binding(next) var cuts: texture_2d<f32>;
// Colours of each transfer function, sampled uniformly over the range.
@group(0) @binding(next) var colours: texture_2d<f32>;
// Rest positions of the nodes, in the local frame; if USE_REST_POSITIONS.
@group(0) @binding(next) var rests: texture_2d<f32>;

// Returns the signed distance of a ray sample beyond plane k.
fn plane_side(k: u32, spot: RaySample, ray: Ray) -> f32 {
    let plane = textureLoad(cuts, array_texel(2u * k), 0);
    var place = ray.origin + spot.z * ray.direction;
    if USE_REST_POSITIONS {
        place = select(place, spot.rest, textureLoad(cuts, array_texel(2u * k + 1u), 0).x > 0.5);
    }
    return dot(plane.xyz, place) - plane.w;
}

// Returns the unclipped parameter range of a segment, from 0 at its front to 1; empty if x >= y.
fn unclipped_range(part: Segment, ray: Ray) -> vec2<f32> {
    var range = vec2(0.0, 1.0);
    for (var k = 0u; k < CLIP_PLANE_COUNT; k++) {
        let front = plane_side(k, part.front, ray);
        let back = plane_side(k, part.back, ray);
        let at_plane = front / select(front - back, 1.0, front == back);
        if front > 0.0 {
            range.x = select(2.0, max(range.x, at_plane), back <= 0.0);
        } else if back > 0.0 {
            range.y = min(range.y, at_plane);
        }
    }
    return range;
}

fn sub_segment(part: Segment, range: vec2<f32>) -> Segment {
    return Segment(lerp_sample(part.front, part.back, range.x), lerp_sample(part.front, part.back, range.y), part.tet);
}

// Intersection of a segment with a surface: parameter and surface number; 0 for none.
struct SurfaceHit {
    u: f32,
    which: u32,
}

// Returns the nearer of `best` and the crossing with surface `which`, considering only hits after
// `after`. The surface is the zero of a linear function with the values `ends` at front and back.
fn closer_hit(best: SurfaceHit, after: SurfaceHit, which: u32, ends: vec2<f32>) -> SurfaceHit {
    // A crossing belongs to exactly one segment, because neighbouring segments share an end.
    if (ends.x < 0.0) == (ends.y < 0.0) {
        return best;
    }
    let u = clamp(ends.x / (ends.x - ends.y), 0.0, 1.0);
    let behind = u > after.u || (u == after.u && which > after.which);
    if behind && (u < best.u || (u == best.u && best.which == 0u)) {
        return SurfaceHit(u, which);
    }
    return best;
}

fn next_slice(part: Segment, ray: Ray, after: SurfaceHit, until: f32) -> SurfaceHit {
    var best = SurfaceHit(until, 0u);
    for (var k = 0u; k < SLICE_COUNT; k++) {
        let ends = vec2(plane_side(CLIP_PLANE_COUNT + k, part.front, ray), plane_side(CLIP_PLANE_COUNT + k, part.back, ray));
        best = closer_hit(best, after, k + 1u, ends);
    }
    return best;
}

fn next_surface(part: Segment, ray: Ray, after: SurfaceHit, until: f32) -> SurfaceHit {
    var best = SurfaceHit(until, 0u);
    // Scans intersect slice planes over the whole segment themselves.
    if !HAS_SCANS {
        best = next_slice(part, ray, after, until);
    }
    for (var k = 0u; k < ISOSURFACE_COUNT; k++) {
        let s = textureLoad(cuts, array_texel(2u * (CLIP_PLANE_COUNT + SLICE_COUNT + k)), 0).x;
        best = closer_hit(best, after, SLICE_COUNT + k + 1u, vec2(part.front.s, part.back.s) - s);
    }
    return best;
}

// Returns the colour of transfer function `row` at a table coordinate.
fn colour_of(s: f32, row: u32) -> vec3<f32> {
    let share = clamp((s - params.scalar.y) / params.scalar.x, 0.0, 1.0);
    let x = share * f32(COLOUR_LUT_SIZE - 1u);
    let below = min(u32(x), COLOUR_LUT_SIZE - 2u);
    let first = row * COLOUR_LUT_SIZE + below;
    return mix(textureLoad(colours, array_texel(first), 0).rgb, textureLoad(colours, array_texel(first + 1u), 0).rgb, x - f32(below));
}

// Returns the colour of a surface, premultiplied.
fn surface_colour(which: u32, spot: RaySample, row: u32, ray: Ray) -> vec4<f32> {
    let item = 2u * (CLIP_PLANE_COUNT + which - 1u);
    let first = textureLoad(cuts, array_texel(item), 0);
    let second = textureLoad(cuts, array_texel(item + 1u), 0);
    if which <= SLICE_COUNT {
#any scan         if HAS_SCANS { return scans_sliced(spot, row) * second.y; }
        return vec4(colour_of(spot.s, row), 1.0) * second.y;
    }
    var colour = second.rgb;
    if first.z < 0.5 {
        colour = colour_of(first.x, row);
    }
    if LIGHTING {
        var gradient = spot.gradient;
#any scan         gradient = scan_gradient(0u, spot.rest);
        var light = shade_surface(gradient, ray.lights);
        if SHADOWS {
            light *= spot.bright;
        }
        colour = min(light.x * colour + light.y, vec3(1.0));
    }
    return vec4(colour, 1.0) * first.y;
}

// Returns the colour of a segment: its unclipped volume and the surfaces in it, front to back.
fn shade_segment(part: Segment, row: u32, ray: Ray) -> vec4<f32> {
    return shade_range(part, unclipped_range(part, ray), row, ray, DRAW_VOLUME);
}

// As shade_segment, for the parameter range `range` of the segment.
fn shade_range(part: Segment, range: vec2<f32>, row: u32, ray: Ray, volume: bool) -> vec4<f32> {
    var seen = vec4(0.0);
    if range.x >= range.y {
        return seen;
    }
    let count = SLICE_COUNT + ISOSURFACE_COUNT;
    var met = SurfaceHit(range.x, 0u);
    for (var i = 0u; i <= count; i++) {
        var next = SurfaceHit(range.y, 0u);
        if i < count {
            next = next_surface(part, ray, met, range.y);
        }
        if volume {
            seen += (1.0 - seen.a) * shade_lit_segment(sub_segment(part, vec2(met.u, next.u)), row, ray);
        }
        if next.which == 0u {
            break;
        }
        seen += (1.0 - seen.a) * surface_colour(next.which, lerp_sample(part.front, part.back, next.u), row, ray);
        met = next;
    }
    return seen;
}
