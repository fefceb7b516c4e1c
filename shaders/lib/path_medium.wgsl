// The medium that light paths travel in: what a place in a tet is made of, its gradient, its distance
// from cut faces, and what a collision there is with. Needs the bindings of render/path, `record_at` and its like, lib/array,
// lib/path_random, and a scan term if there are scans.

override CELL_SCALARS: bool = false;
override HAS_REGIONS: bool = false;
override HAS_SCANS: bool = false;
// Whether there are surfaces, where the gradient is steep.
override SURFACES: bool = true;
override NODE_GRADIENTS: bool = false;
override USE_REST_POSITIONS: bool = false;
override CLIP_PLANE_COUNT: u32 = 0u;

// As in lib/segment and lib/sections.
const ROW_MASK: u32 = 0x7fffu;
const COLOUR_LUT_SIZE: u32 = 1024u;

// Gradient with which half of the collisions are with a surface; as in lib/shade.
const GRADIENT_HALF_SATURATION: f32 = 2.0;
// Optical depth and distance (in local units) from a cut face within which it acts as a surface.
const CUT_DEPTH: f32 = 3.0;
const CUT_DISTANCE: f32 = 0.01;

// Of the tet of the last collision: its table row, and the map to rest positions.
var<private> row: u32;
var<private> map_x: vec4<f32>;
var<private> map_y: vec4<f32>;
var<private> map_z: vec4<f32>;

// Loads what a collision in a tet needs.
fn load_medium(t: u32) {
    row = 0u;
    if HAS_REGIONS {
        row = textureLoad(rows, array_texel(t), 0).x & ROW_MASK;
    }
    if USE_REST_POSITIONS {
        load_rest_map(t);
    }
}

fn load_rest_map(t: u32) {
    map_x = textureLoad(maps, array_texel(3u * t), 0);
    map_y = textureLoad(maps, array_texel(3u * t + 1u), 0);
    map_z = textureLoad(maps, array_texel(3u * t + 2u), 0);
}

fn rest_of(x: vec3<f32>) -> vec3<f32> {
    return vec3(dot(map_x.xyz, x) + map_x.w, dot(map_y.xyz, x) + map_y.w, dot(map_z.xyz, x) + map_z.w);
}

// Returns colour and relative extinction of a table row at a share of its range.
fn look_of(table_row: u32, share: f32) -> vec4<f32> {
    let x = clamp(share, 0.0, 1.0) * f32(COLOUR_LUT_SIZE - 1u);
    let below = min(u32(x), COLOUR_LUT_SIZE - 2u);
    let first = table_row * COLOUR_LUT_SIZE + below;
    return mix(colour_at(first), colour_at(first + 1u), x - f32(below));
}

// Distance from the nearest clip plane, and its unit normal, in the local frame.
struct Cut {
    distance: f32,
    normal: vec3<f32>,
}

// Returns the nearest clip plane of a place; a negative distance is clipped.
fn nearest_cut(x: vec3<f32>) -> Cut {
    var cut = Cut(3e38, vec3(0.0));
    for (var k = 0u; k < CLIP_PLANE_COUNT; k++) {
        let plane = textureLoad(cuts, array_texel(2u * k), 0);
        var place = x;
        var normal = plane.xyz;
        if USE_REST_POSITIONS && textureLoad(cuts, array_texel(2u * k + 1u), 0).x > 0.5 {
            place = rest_of(x);
            normal = normal.x * map_x.xyz + normal.y * map_y.xyz + normal.z * map_z.xyz;
        }
        let length_ = max(length(normal), 1e-20);
        let distance = (plane.w - dot(plane.xyz, place)) / length_;
        if distance < cut.distance {
            cut = Cut(distance, normal / length_);
        }
    }
    return cut;
}

// Returns the signed distance of a place from the nearest clip plane in space.
fn nearest_cut_in_space(x: vec3<f32>) -> f32 {
    var distance = 3e38;
    for (var k = 0u; k < CLIP_PLANE_COUNT; k++) {
        let plane = textureLoad(cuts, array_texel(2u * k), 0);
        if textureLoad(cuts, array_texel(2u * k + 1u), 0).x < 0.5 {
            distance = min(distance, plane.w - dot(plane.xyz, x));
        }
    }
    return distance;
}

struct Medium {
    // Colour as in a picture (sRGB), and extinction relative to the largest.
    colour: vec3<f32>,
    extinction: f32,
    // Scan that the collision is with.
    scan: u32,
}

// Returns the scalar's share of its range at a place in the tet.
fn share_at(t: u32, x: vec3<f32>) -> f32 {
    if CELL_SCALARS {
        return textureLoad(cells, array_texel(t), 0).x;
    }
    let gradient = bitcast<vec4<f32>>(record_at(8u * t + 4u));
    let corner = record_at(8u * t + 5u);
    let range = unpack2x16unorm(corner.w);
    return clamp(dot(gradient.xyz, x - bitcast<vec3<f32>>(corner.xyz)) + gradient.w, range.x, range.y);
}

// Returns the medium at a place in the tet. With several scans their extinctions add, and the
// collision is with one of them, in proportion.
fn medium_at(t: u32, x: vec3<f32>) -> Medium {
    if HAS_SCANS {
        var found = Medium(vec3(0.0), 0.0, 0u);
#any scan         let rest = rest_of(x);
#any scan         for (var k = 0u; k < SCAN_COUNT; k++) {
#any scan             let p = texel_of(k, rest);
#any scan             if !is_inside(k, p) { continue; }
#any scan             let own_row = select(u32(scans[k].look.z), row, k == 0u);
#any scan             var look: vec4<f32>;
#any scan             if has_labels(k) {
#any scan                 look = colour_at(u32(scans[k].look.z) * COLOUR_LUT_SIZE + label_at(k, p));
#any scan             } else {
#any scan                 look = look_of(own_row, normalised_value(k, p));
#any scan             }
#any scan             found.extinction += look.w;
#any scan             if look.w > 0.0 && (found.extinction <= look.w || random() * found.extinction < look.w) {
#any scan                 found.colour = look.rgb;
#any scan                 found.scan = k;
#any scan             }
#any scan         }
        return found;
    }
    let look = look_of(row, share_at(t, x));
    return Medium(look.rgb, look.w, 0u);
}

// Returns the gradient at a place in the tet, in the deformed body.
fn gradient_at_place(t: u32, x: vec3<f32>, which: u32) -> vec3<f32> {
    if !SURFACES {
        return vec3(0.0);
    }
    if HAS_SCANS {
        var g = vec3(0.0);
#any scan         rest_to_world = mat3x3(map_x.xyz, map_y.xyz, map_z.xyz);
#any scan         g = scan_gradient(which, rest_of(x));
        return g;
    }
    if !NODE_GRADIENTS {
        return vec3(0.0);
    }
    let gx = gradient_map_at(3u * t);
    let gy = gradient_map_at(3u * t + 1u);
    let gz = gradient_map_at(3u * t + 2u);
    return vec3(dot(gx.xyz, x) + gx.w, dot(gy.xyz, x) + gy.w, dot(gz.xyz, x) + gz.w);
}

// Returns the linear form of a colour in sRGB.
fn linear_colour(c: vec3<f32>) -> vec3<f32> {
    return select(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, c <= vec3(0.04045));
}

// What a path meets.
struct Collision {
    colour: vec3<f32>,
    // Unit normal, on the side the path came from, and how likely the collision is with a surface.
    normal: vec3<f32>,
    surface_share: f32,
    // Slice or isosurface, from 1; 0 for none.
    section: u32,
}

// Returns the collision with the medium at a place in the tet of a ray; extinction is per local unit.
fn collision_at(ray: Ray, x: vec3<f32>, medium: Medium, cut: Cut) -> Collision {
    let gradient = gradient_at_place(ray.tet, x, medium.scan);
    let steep = length(gradient);
    var found = Collision(linear_colour(medium.colour), gradient / max(steep, 1e-20), steep / (steep + GRADIENT_HALF_SATURATION), 0u);
    let cut_depth = params.extinction * medium.extinction * cut.distance / CUT_DEPTH;
    let cut_distance = cut.distance / CUT_DISTANCE;
    let cut_share = exp(-cut_depth * cut_depth - cut_distance * cut_distance);
    if cut_share > 0.0 && random() < cut_share {
        found.normal = cut.normal;
        found.surface_share = 1.0;
    }
    return found;
}
