// Slices and isosurfaces that paths meet in the tet of a ray. Each is the zero of a function that is
// linear in the tet; but isosurfaces of a scan are sought in pieces of a texel's length. A ray keeps
// the side of each that it is on, so that rounding at a face neither hides a crossing nor counts it
// twice. Needs the bindings of render/path, its `ray` and `exit_at`, and lib/path_medium. CPU
// reference: `render::path::reference_sections`.

override SLICE_COUNT: u32 = 0u;
override ISOSURFACE_COUNT: u32 = 0u;
override DRAW_VOLUME: bool = true;

// As in lib/segment.
const HIDDEN: u32 = 0xffffu;
const TRANSPARENT_FLAG: u32 = 0x8000u;
// Error of the range in a tet's record.
const RANGE_ERROR: f32 = 1.0 / 65535.0;
// Distance from a clip plane within which a slice on it is kept, in local units.
const CLIP_TOLERANCE: f32 = 2e-6;
// Steps that refine a crossing with an isosurface of a scan.
const REFINEMENTS: u32 = 4u;

// Whether the ray is on the negative side of each surface, a bit each; unknown where a ray starts.
var<private> sides: array<u32, 3>;
var<private> sides_known: bool;
// The next surface in the tet, from 1 (0 for none), and its distance; its colour once it is met.
var<private> section: u32;
var<private> section_at: f32;
var<private> section_colour: vec3<f32>;
// With scans: where the piece ends for which that holds, the tet or a part of it; length of the
// pieces in this tet, and the share at the end of the last.
#any scan var<private> piece_end: f32;
#any scan var<private> piece_length: f32;
#any scan var<private> piece_share: f32;

fn section_item(k: u32, which: u32) -> vec4<f32> {
    return textureLoad(cuts, array_texel(2u * (CLIP_PLANE_COUNT + k) + which), 0);
}

// Returns the scalar's share at a place in the tet, with tolerance at the ends of the tet's range.
fn loose_share(x: vec3<f32>) -> f32 {
    let gradient = bitcast<vec4<f32>>(record_at(8u * ray.tet + 4u));
    let corner = record_at(8u * ray.tet + 5u);
    let range = unpack2x16unorm(corner.w) + vec2(-RANGE_ERROR, RANGE_ERROR);
    return clamp(dot(gradient.xyz, x - bitcast<vec3<f32>>(corner.xyz)) + gradient.w, range.x, range.y);
}

// Returns the function of surface k at two places whose scalars are `shares`.
fn section_values(k: u32, a: vec3<f32>, b: vec3<f32>, shares: vec2<f32>) -> vec2<f32> {
    let first = section_item(k, 0u);
    if k >= SLICE_COUNT {
        return shares - first.x;
    }
    if USE_REST_POSITIONS && section_item(k, 1u).x > 0.5 {
        return vec2(dot(first.xyz, rest_of(a)), dot(first.xyz, rest_of(b))) - first.w;
    }
    return vec2(dot(first.xyz, a), dot(first.xyz, b)) - first.w;
}

// Returns the share of the range that isosurfaces compare: of the first scan, or of the scalar.
fn section_share(x: vec3<f32>) -> f32 {
#any scan     if HAS_SCANS { return normalised_value(0u, texel_of(0u, rest_of(x))); }
    return loose_share(x);
}

// Whether the first scan has none of the isosurfaces in the tet of the ray.
#any scan fn lacks_isosurfaces() -> bool {
#any scan     return HAS_REGIONS && (textureLoad(rows, array_texel(ray.tet), 0).x & TRANSPARENT_FLAG) != 0u;
#any scan }

// Returns the length of a texel along the ray in its tet, from `here` on.
#any scan fn texel_length(here: vec3<f32>) -> f32 {
#any scan     let out = ray.origin + exit_at * ray.direction;
#any scan     let texels = distance(texel_of(0u, rest_of(here)), texel_of(0u, rest_of(out)));
#any scan     return select(3e38, (exit_at - ray.at) / texels, texels > 1.0);
#any scan }

// Moves `section_at` from the chord of the scan's values in the piece to their zero (regula falsi).
#any scan fn refine_section() {
#any scan     let value = section_item(section - 1u, 0u).x;
#any scan     var ends = vec2(ray.at, piece_end);
#any scan     var values = vec2(section_share(ray.origin + ends.x * ray.direction), section_share(ray.origin + ends.y * ray.direction)) - value;
#any scan     for (var i = 0u; i < REFINEMENTS && (values.x < 0.0) != (values.y < 0.0); i++) {
#any scan         let between = section_share(ray.origin + section_at * ray.direction) - value;
#any scan         let is_front = (between < 0.0) == (values.x < 0.0);
#any scan         ends = select(vec2(ends.x, section_at), vec2(section_at, ends.y), is_front);
#any scan         values = select(vec2(values.x, between), vec2(between, values.y), is_front);
#any scan         section_at = mix(ends.x, ends.y, clamp(values.x / select(values.x - values.y, 1.0, values.x == values.y), 0.0, 1.0));
#any scan     }
#any scan }

// Finds the next surface that the ray crosses in its tet, or in the next piece of it. Whether the ray
// `continues` from the end of a piece of the same tet.
fn meet_section(continues: bool) {
    section = 0u;
    section_at = 3e38;
#any scan     piece_end = exit_at;
    // A ray without an exit is in a degenerate tet.
    if SLICE_COUNT + ISOSURFACE_COUNT == 0u || exit_at > 1e37 {
        return;
    }
    if USE_REST_POSITIONS && (SLICE_COUNT > 0u || HAS_SCANS) && !continues {
        load_rest_map(ray.tet);
    }
    let here = ray.origin + ray.at * ray.direction;
    var until = exit_at;
    var lacks = false;
#any scan     if ISOSURFACE_COUNT > 0u {
#any scan         lacks = !continues && lacks_isosurfaces();
#any scan         if !continues { piece_length = texel_length(here); }
#any scan         let end = min(ray.at + piece_length, exit_at);
#any scan         if !lacks && end > ray.at { until = end; }
#any scan         piece_end = until;
#any scan     }
    let there = ray.origin + until * ray.direction;
    var shares = vec2(0.0);
    if ISOSURFACE_COUNT > 0u {
        shares.y = section_share(there);
        if !continues {
            shares.x = section_share(here);
        }
#any scan         if continues { shares.x = piece_share; }
#any scan         piece_share = shares.y;
    }
    for (var k = 0u; k < SLICE_COUNT + ISOSURFACE_COUNT; k++) {
        let ends = section_values(k, here, there, shares);
        let bit = 1u << (k & 31u);
        let word = k >> 5u;
        if !sides_known {
            // The surface on which the ray starts is not crossed in this tet.
            let starts = select(ends.x, ends.y, k + 1u == ray.left) < 0.0;
            sides[word] = (sides[word] & ~bit) | select(0u, bit, starts);
        }
        if ((sides[word] & bit) != 0u) == (ends.y < 0.0) {
            continue;
        }
        if lacks && k >= SLICE_COUNT {
            // Beyond the scan, whose values go on there.
            sides[word] ^= bit;
            continue;
        }
        let u = clamp(ends.x / select(ends.x - ends.y, 1.0, ends.x == ends.y), 0.0, 1.0);
        let at = min(mix(ray.at, until, u), until);
        if at < section_at {
            section = k + 1u;
            section_at = at;
        }
    }
    sides_known = true;
#any scan     if section > SLICE_COUNT { refine_section(); }
}

// Goes to the other side of the surface that the ray is at.
fn pass_section() {
    let k = section - 1u;
    sides[k >> 5u] ^= 1u << (k & 31u);
    meet_section(false);
}

// Whether the surface that the ray is at stops it, at random by its opacity. Clipped and hidden parts
// never do.
fn section_stops() -> bool {
    if HAS_REGIONS && textureLoad(rows, array_texel(ray.tet), 0).x == HIDDEN {
        return false;
    }
    load_medium(ray.tet);
    let x = ray.origin + ray.at * ray.direction;
    if CLIP_PLANE_COUNT > 0u && nearest_cut(x).distance < -CLIP_TOLERANCE {
        return false;
    }
    let k = section - 1u;
#any scan     if k >= SLICE_COUNT && !is_inside(0u, texel_of(0u, rest_of(x))) { return false; }
    let second = section_item(k, 1u);
    var look: vec4<f32>;
    if k < SLICE_COUNT {
        look = vec4(look_of(row, share_at(ray.tet, x)).rgb, 1.0);
#any scan         look = scans_sliced(x);
        look.w *= second.y;
    } else {
        let first = section_item(k, 0u);
        look = vec4(select(look_of(row, first.x).rgb, second.rgb, first.z > 0.5), first.y);
    }
    section_colour = linear_colour(look.rgb);
    return random() < look.w;
}

// Returns the collision with the surface that the ray is at.
fn section_collision(x: vec3<f32>) -> Collision {
    let k = section - 1u;
    var normal = section_item(k, 0u).xyz;
    if k >= SLICE_COUNT {
        if !HAS_SCANS { normal = gradient_at_place(ray.tet, x, 0u); }
#any scan         rest_to_world = mat3x3(map_x.xyz, map_y.xyz, map_z.xyz);
#any scan         normal = scan_gradient(0u, rest_of(x));
        if dot(normal, normal) == 0.0 {
            normal = select(bitcast<vec4<f32>>(record_at(8u * ray.tet + 4u)).xyz, -ray.direction, HAS_SCANS);
        }
    } else if USE_REST_POSITIONS && section_item(k, 1u).x > 0.5 {
        normal = normal.x * map_x.xyz + normal.y * map_y.xyz + normal.z * map_z.xyz;
    }
    return Collision(section_colour, normal / max(length(normal), 1e-20), 1.0, section);
}

// Returns the colour of the scans on a slice, as in lib/sections: the first one's values, with the
// labels of the others blended at half opacity.
#any scan fn scans_sliced(x: vec3<f32>) -> vec4<f32> {
#any scan     let rest = rest_of(x);
#any scan     var seen = vec4(0.0);
#any scan     for (var k = 0u; k < SCAN_COUNT; k++) {
#any scan         let p = texel_of(k, rest);
#any scan         if !is_inside(k, p) { continue; }
#any scan         if has_labels(k) {
#any scan             let look = colour_at(u32(scans[k].look.z) * COLOUR_LUT_SIZE + label_at(k, p));
#any scan             let share = select(select(0.5, 1.0, seen.w == 0.0), 0.0, look.w <= 0.0);
#any scan             seen = mix(seen, vec4(look.rgb, 1.0), share);
#any scan         } else if k == 0u {
#any scan             seen = vec4(look_of(row, normalised_value(0u, p)).rgb, 1.0);
#any scan         }
#any scan     }
#any scan     return seen;
#any scan }
