// Light transport through the deformed body: one path per pixel and sample, by delta tracking
// (Woodcock et al. 1965) from tet to tet, each with the largest extinction in it as its majorant. At
// each collision the path scatters as soft tissue or as a surface, chosen by the gradient (after
// Kroes et al. 2012), and one direction to the surroundings is tested for light (multiple importance
// sampling: Veach 1997). Unbiased: paths end by Russian roulette only.
//
// Rays walk over the planes of render/refresh_geometry; outside, the tree of lib/path_boxes finds
// where they enter. CPU reference: `render::path::reference`.
//
// Invocations that run in lockstep wait for each other at the end of each loop. So a walk from tet
// to tet is a loop of its own, what follows it is done once for all of them, and an invocation whose
// path has ended starts the next sample of its pixel at once.

#each reads #import terms/TERM
// One scalar per tet, if CELL_SCALARS.
@group(0) @binding(next) var cells: texture_2d<f32>;
// Table row of each tet, if HAS_REGIONS.
@group(0) @binding(next) var rows: texture_2d<u32>;
// Clip planes, slices and isosurfaces, as in lib/sections; but isosurfaces have the share of the range.
@group(0) @binding(next) var cuts: texture_2d<f32>;
// Maps to rest positions (render/path_maps), if USE_REST_POSITIONS.
@group(0) @binding(next) var maps: texture_2d<f32>;

#each scan #import terms/TERM
#import lib/array
#import lib/tet
#import lib/path_random
#import lib/path_lobes
#import lib/path_medium
#import lib/path_sections
#import lib/path_sky
#import lib/path_boxes
#import lib/path_walls
#import lib/path_camera

// Distance, in local units, by which a ray that leaves the body where it has entered it goes on: by
// rounding, it would enter there again and again.
const GRAZE: f32 = 2e-6;
// Scattering events before Russian roulette.
const SURE_EVENTS: u32 = 3u;

struct Path {
    // Camera (lib/view): axes, and the ray of each pixel.
    right: vec4<f32>,
    up: vec4<f32>,
    forward: vec4<f32>,
    slope: vec4<f32>,
    base: vec4<f32>,
    // Axes of the map of the surroundings, in the local frame.
    sky_x: vec4<f32>,
    sky_y: vec4<f32>,
    sky_z: vec4<f32>,
    // Directional albedo of the specular lobe at evenly spaced cosines of incidence.
    albedos: array<vec4<f32>, 8>,
    sky_size: vec2<u32>,
    // Pixels of the window, its corner in the picture, and the samples that each shall have.
    size: vec2<u32>,
    corner: vec2<u32>,
    until: u32,
    seed: u32,
    // Largest extinction, per local unit.
    extinction: f32,
    anisotropy: f32,
    // Roughness squared, and the mean albedo of the specular lobe.
    alpha: f32,
    mean_albedo: f32,
    // z of the eye and of the plane in focus; radius of the lens, in local units.
    near: f32,
    focus: f32,
    lens: f32,
    // Leaves of the tree around the boundary.
    leaves: u32,
    // Triangles of skins and tools, and leaves of their tree.
    wall_count: u32,
    wall_leaves: u32,
    // Steps after which a path is given up, and after which an invocation starts no other sample.
    max_steps: u32,
    max_work: u32,
}

// Two items per pixel: sum of light (linear) and opacity; of the squared luminance, and the number
// of samples.
@group(0) @binding(next) var<storage, read_write> sums: array<vec4<f32>>;
// Paths given up, and pixels that need another dispatch.
@group(0) @binding(next) var<storage, read_write> counts: array<atomic<u32>, 2>;
@group(0) @binding(next) var<uniform> params: Path;

// A ray in the local frame, with unit direction, and how far it has gone.
struct Ray {
    origin: vec3<f32>,
    direction: vec3<f32>,
    at: f32,
    // NONE outside.
    tet: u32,
    // Slice or isosurface on which it starts, from 1; 0 for none.
    left: u32,
}

// State of a path.
var<private> ray: Ray;
var<private> weight: vec3<f32>;
// Density with which the direction of the path was sampled.
var<private> density: f32;
var<private> events: u32;
// While a direction to the surroundings is tested, the path waits.
var<private> testing: bool;
var<private> tested: vec3<f32>;
var<private> waiting: Ray;
// Its light and opacity so far.
var<private> light: vec3<f32>;
var<private> opacity: f32;
// Tets entered, and candidates for collisions.
var<private> steps: u32;
// Whether it goes on, and whether it has just left the eye.
var<private> running: bool;
var<private> first: bool;

// The box around the body.
var<private> body_low: vec3<f32>;
var<private> body_high: vec3<f32>;

// State of its ray: optical depth until the next candidate for a collision,
var<private> depth: f32;
// the nearest wall, or from where it is to be found (negative: found),
var<private> wall: WallHit;
var<private> wall_after: f32;
// where it has entered the body,
var<private> entered_at: f32;
// whether the tet is loaded: where the ray leaves it, and its majorant.
var<private> loaded: bool;
var<private> exit_at: f32;
var<private> exit_code: u32;
var<private> majorant: f32;

// Takes the exit through face k if it is nearer than those before.
fn meet_face(code: u32, face: ptr<function, u32>) {
    let plane = bitcast<vec4<f32>>(record_at(8u * (code >> 2u) + (code & 3u)));
    let slant = dot(plane.xyz, ray.direction);
    let at = (plane.w - dot(plane.xyz, ray.origin)) / slant;
    if slant > 0.0 && at < exit_at {
        exit_at = at;
        *face = code & 3u;
    }
}

// Loads the tet that a ray enters through a face (4 tet + face), or is in if `inside`: where it
// leaves it, and its majorant.
fn load_tet(code: u32, inside: bool) {
    let t = code >> 2u;
    exit_at = 3e38;
    var face = 4u;
    if inside {
        meet_face(code, &face);
    }
    // Not through the face by which it enters.
    meet_face((code & ~3u) + ((code + 1u) & 3u), &face);
    meet_face((code & ~3u) + ((code + 2u) & 3u), &face);
    meet_face((code & ~3u) + ((code + 3u) & 3u), &face);
    exit_at = max(exit_at, ray.at);
    exit_code = NONE;
    if face < 4u {
        exit_code = record_at(8u * t + 6u)[face];
    }
    majorant = select(0.0, params.extinction * majorant_at(t), DRAW_VOLUME);
    loaded = true;
}

fn random_depth() -> f32 {
    return -log(1.0 - random());
}

fn start_ray(next: Ray) {
    ray = next;
    depth = random_depth();
    wall_after = WALL_OFFSET;
    loaded = false;
    sides_known = false;
    entered_at = -1.0;
}

// Returns the tet that contains the start of the ray, whose nearest face is `back`, by a walk back
// from that face.
fn tet_of_start(back: FaceHit) -> u32 {
    let forward = ray;
    ray = Ray(ray.origin + back.distance * ray.direction, -ray.direction, 0.0, back.code >> 2u, 0u);
    load_tet(back.code, false);
    for (var i = 0u; i < params.max_steps && exit_at < back.distance && exit_code != NONE; i++) {
        ray.at = exit_at;
        ray.tet = exit_code >> 2u;
        load_tet(exit_code, false);
    }
    let found = ray.tet;
    ray = forward;
    loaded = false;
    return found;
}

// Scatters the path at x.
fn scatter(x: vec3<f32>, met: Collision) {
    let back = -ray.direction;
    let normal = select(met.normal, -met.normal, dot(met.normal, back) < 0.0);
    events += 1u;
    let on_surface = random() < met.surface_share && dot(normal, back) > 1e-4;
    let source = sample_sky();
    var to_light: LobeValue;
    var way: vec3<f32>;
    var factor = met.colour;
    if on_surface {
        to_light = surface_value(normal, back, source.direction, met.colour);
        way = sample_surface(normal, back, met.colour);
        let reflected = surface_value(normal, back, way, met.colour);
        density = reflected.density;
        factor = select(vec3(0.0), reflected.value / max(density, 1e-20), density > 0.0);
    } else {
        let along = phase(dot(ray.direction, source.direction));
        to_light = LobeValue(met.colour * along, along);
        way = sample_phase(ray.direction);
        density = phase(dot(ray.direction, way));
    }
    tested = weight * to_light.value * source.colour / max(source.density + to_light.density, 1e-20);
    weight *= factor;
    let most = max(weight.x, max(weight.y, weight.z));
    let survives = select(min(most, 1.0), 1.0, events <= SURE_EVENTS);
    let goes_on = most > 0.0 && random() < survives;
    weight = select(vec3(0.0), weight / max(survives, 1e-20), goes_on);
    waiting = Ray(x, way, 0.0, ray.tet, met.section);
    testing = any(tested > vec3(0.0));
    if testing {
        start_ray(Ray(x, source.direction, 0.0, ray.tet, met.section));
    } else if goes_on {
        start_ray(waiting);
    }
    running = testing || goes_on;
}

// Ends the test of a direction: the path goes on.
fn end_test() {
    testing = false;
    running = any(weight > vec3(0.0));
    if running {
        start_ray(waiting);
    }
}

// Starts the path of a sample.
fn start_path(pixel: vec2<u32>, sample: u32) {
    seed_random(pixel + params.corner, sample, params.seed);
    weight = vec3(1.0);
    density = 0.0;
    events = 0u;
    testing = false;
    light = vec3(0.0);
    opacity = 0.0;
    steps = 0u;
    running = true;
    // The window's camera counts from its corner.
    start_ray(camera_ray(vec2<f32>(pixel) + vec2(random(), random())));
    first = all(ray.origin >= body_low) && all(ray.origin <= body_high);
}

// What stops a ray.
const AT_NOTHING: u32 = 0u;
const AT_WALL: u32 = 1u;
const AT_COLLISION: u32 = 2u;
const AT_SKY: u32 = 3u;
const AT_SECTION: u32 = 4u;

// Leads a ray outside to where it enters the body. Returns what stops it.
fn find_entry() -> u32 {
    let after = select(ray.at, ray.at + GRAZE, ray.at <= entered_at);
    let face = nearest_face(ray.origin, ray.direction, after, !first);
    if first && face.code != NONE && !face.front {
        ray.tet = tet_of_start(face);
        return AT_NOTHING;
    }
    if HAS_WALLS && wall.distance <= min(face.distance, 3e37) {
        return AT_WALL;
    }
    if face.code == NONE {
        return AT_SKY;
    }
    ray.at = face.distance;
    entered_at = ray.at;
    ray.tet = face.code >> 2u;
    ray.left = 0u;
    sides_known = false;
    load_tet(face.code, false);
    meet_section(false);
    return AT_NOTHING;
}

// Takes the light of the surroundings.
fn reach_sky() {
    if testing {
        light += tested;
        end_test();
        return;
    }
    if events > 0u {
        let found = sky_at(ray.direction);
        light += weight * found.rgb * (density / (density + found.w));
    }
    running = false;
}

// Walks from tet to tet to the next candidate for a collision, a surface, or out of the body.
// Returns what stops the ray.
fn walk() -> u32 {
    var met = AT_NOTHING;
    loop {
        var until = min(exit_at, section_at);
#any scan         until = min(piece_end, section_at);
        let end = select(until, min(until, wall.distance), HAS_WALLS);
        let depth_to_end = majorant * (end - ray.at);
        if depth < depth_to_end {
            ray.at = min(ray.at + depth / majorant, end);
            met = AT_COLLISION;
            break;
        }
        depth -= depth_to_end;
        if HAS_WALLS && wall.distance <= until {
            met = AT_WALL;
            break;
        }
        if section != 0u {
            ray.at = section_at;
            met = AT_SECTION;
            break;
        }
        ray.at = exit_at;
#any scan         if piece_end < exit_at {
#any scan             ray.at = piece_end;
#any scan             steps += 1u;
#any scan             meet_section(true);
#any scan             continue;
#any scan         }
        if exit_code == NONE {
            ray.tet = NONE;
            break;
        }
        ray.tet = exit_code >> 2u;
        steps += 1u;
        if steps > params.max_steps {
            break;
        }
        load_tet(exit_code, false);
        meet_section(false);
    }
    return met;
}

// Takes the ray in the body to its next collision, a surface, or out. Returns what stops it; `medium`
// and `cut` are those of a collision. A test that a collision ends is over: the path itself flies on.
fn fly(medium: ptr<function, Medium>, cut: ptr<function, Cut>) -> u32 {
    var stop = AT_NOTHING;
    loop {
        if !loaded {
            load_tet(4u * ray.tet, true);
            meet_section(false);
        }
        stop = walk();
        if stop == AT_SECTION && !section_stops() {
            pass_section();
            steps += 1u;
            stop = AT_NOTHING;
            if steps <= params.max_steps {
                continue;
            }
        }
        if stop != AT_COLLISION {
            break;
        }
        let x = ray.origin + ray.at * ray.direction;
        load_medium(ray.tet);
        *medium = medium_at(ray.tet, x);
        if CLIP_PLANE_COUNT > 0u {
            *cut = nearest_cut(x);
        }
        let real = (*cut).distance >= 0.0 && random() * majorant < params.extinction * (*medium).extinction;
        if real && !testing {
            break;
        }
        if real {
            end_test();
        } else {
            depth = random_depth();
        }
        steps += 1u;
        // A path outside, or whose wall is to be found first, waits for the others.
        if !running || ray.tet == NONE || (HAS_WALLS && wall_after >= 0.0) || steps > params.max_steps {
            stop = AT_NOTHING;
            break;
        }
    }
    return stop;
}

// Takes the path one stop further.
fn advance() {
    if HAS_WALLS && wall_after >= 0.0 {
        wall = nearest_wall(ray.origin, ray.direction, wall_after);
        wall_after = -1.0;
    }
    var stop = AT_NOTHING;
    if ray.tet == NONE {
        stop = find_entry();
    }
    first = false;
    if stop == AT_SKY {
        reach_sky();
        stop = AT_NOTHING;
    }
    var medium: Medium;
    var cut = Cut(3e38, vec3(0.0));
    // The wall of a ray that reach_sky has started is yet to be found.
    if running && stop == AT_NOTHING && ray.tet != NONE && (!HAS_WALLS || wall_after < 0.0) {
        stop = fly(&medium, &cut);
    }
    var met: Collision;
    if HAS_WALLS && stop == AT_WALL {
        ray.at = wall.distance;
        let clipped = CLIP_PLANE_COUNT > 0u && nearest_cut_in_space(ray.origin + ray.at * ray.direction) < 0.0;
        if clipped || random() >= wall_item(wall.item).w {
            wall_after = ray.at + WALL_OFFSET;
            stop = AT_NOTHING;
        } else {
            let normal = at_wall(wall, 3u);
            met = Collision(at_wall(wall, 6u), normal / max(length(normal), 1e-20), 1.0, 0u);
        }
    }
    if stop == AT_NOTHING {
        return;
    }
    if testing {
        end_test();
        return;
    }
    let x = ray.origin + ray.at * ray.direction;
    if stop == AT_COLLISION {
        met = collision_at(ray, x, medium, cut);
    } else if stop == AT_SECTION {
        met = section_collision(x);
    }
    opacity = 1.0;
    scatter(x, met);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let i = 2u * (id.y * params.size.x + id.x);
    var sum = sums[i];
    var more = sums[i + 1u];
    var work = 0u;
    body_low = box_at(2u);
    body_high = box_at(3u);
    running = false;
    while u32(more.y) < params.until && work <= params.max_work {
        if !running {
            start_path(id.xy, u32(more.y));
        }
        advance();
        steps += 1u;
        let lost = running && steps > params.max_steps;
        if lost {
            atomicAdd(&counts[0], 1u);
        }
        if lost || !running {
            running = false;
            work += steps;
            sum += vec4(light, opacity);
            let luminance = dot(light, vec3(0.2126, 0.7152, 0.0722));
            more += vec4(luminance * luminance, 1.0, 0.0, 0.0);
        }
    }
    if running {
        // The driver has ended the loop.
        atomicAdd(&counts[0], 1u);
        more.y += 1.0;
    }
    if u32(more.y) < params.until {
        atomicAdd(&counts[1], 1u);
    }
    sums[i] = sum;
    sums[i + 1u] = more;
}
