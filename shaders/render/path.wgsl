// Light transport through the deformed body: one path per pixel and sample, by delta tracking
// (Woodcock et al. 1965) from tet to tet, each with the largest extinction in it as its majorant. At
// each collision the path scatters as soft tissue or as a surface, chosen by the gradient (after
// Kroes et al. 2012), and one direction to the surroundings is tested for light (multiple importance
// sampling: Veach 1997). Unbiased: paths end by Russian roulette only.
//
// Rays walk over the planes of render/refresh_geometry; outside, the tree of lib/path_boxes finds
// where they enter. CPU reference: `render::path::reference`.

#each reads #import terms/TERM
@group(0) @binding(next) var tets: texture_2d<u32>;
@group(0) @binding(next) var positions: texture_2d<f32>;
// Gradient at each node (lib/shade), if NODE_GRADIENTS.
@group(0) @binding(next) var gradients: texture_2d<f32>;
// One scalar per tet, if CELL_SCALARS.
@group(0) @binding(next) var cells: texture_2d<f32>;
// Table row of each tet, if HAS_REGIONS.
@group(0) @binding(next) var rows: texture_2d<u32>;
// Colour of each table row over its range; w is the extinction relative to the largest.
@group(0) @binding(next) var colours: texture_2d<f32>;
// Largest extinction in each tet, relative to the largest of all.
@group(0) @binding(next) var majorants: texture_2d<f32>;
// Clip planes (lib/sections).
@group(0) @binding(next) var cuts: texture_2d<f32>;
// Maps to rest positions (render/path_maps), if USE_REST_POSITIONS.
@group(0) @binding(next) var maps: texture_2d<f32>;

#each scan #import terms/TERM
#import lib/array
#import lib/tet
#import lib/path_random
#import lib/path_lobes
#import lib/path_medium
#import lib/path_sky
#import lib/path_boxes
#import lib/path_walls

// Gradient with which half of the collisions are with a surface; as in lib/shade.
const GRADIENT_HALF_SATURATION: f32 = 2.0;
// Optical depth and distance (in local units) from a cut face within which it acts as a surface.
const CUT_DEPTH: f32 = 3.0;
const CUT_DISTANCE: f32 = 0.01;
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
    // Pixels of the window, its corner in the picture, and the first sample to draw.
    size: vec2<u32>,
    corner: vec2<u32>,
    sample: u32,
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
    // Boundary faces, and leaves of their tree.
    faces: u32,
    leaves: u32,
    // Triangles of skins and tools, and leaves of their tree.
    wall_count: u32,
    wall_leaves: u32,
    max_steps: u32,
}

// Two items per pixel: sum of light (linear) and opacity; of the squared luminance.
@group(0) @binding(next) var<storage, read_write> sums: array<vec4<f32>>;
@group(0) @binding(next) var<storage, read_write> lost_path_count: array<atomic<u32>, 1>;
@group(0) @binding(next) var<uniform> params: Path;

fn corner_at(i: u32) -> vec3<f32> {
    return textureLoad(positions, array_texel(i), 0).xyz;
}

// A ray in the local frame, with unit direction, and how far it has gone.
struct Ray {
    origin: vec3<f32>,
    direction: vec3<f32>,
    at: f32,
    // NONE outside.
    tet: u32,
}

// The tet that the ray is in.
var<private> exit_at: f32;
var<private> exit_code: u32;
var<private> majorant: f32;

// Loads the tet of a ray: where it leaves it, and its majorant.
fn enter_tet(ray: Ray) {
    let t = ray.tet;
    exit_at = 3e38;
    var face = 4u;
    for (var k = 0u; k < 4u; k++) {
        let plane = bitcast<vec4<f32>>(record_at(8u * t + k));
        let slant = dot(plane.xyz, ray.direction);
        if slant > 0.0 {
            let at = (plane.w - dot(plane.xyz, ray.origin)) / slant;
            if at < exit_at {
                exit_at = at;
                face = k;
            }
        }
    }
    exit_at = max(exit_at, ray.at);
    exit_code = NONE;
    if face < 4u {
        exit_code = record_at(8u * t + 6u)[face];
    }
    majorant = params.extinction * textureLoad(majorants, array_texel(t), 0).x;
}

// Returns the ray of a pixel's sample, from the lens.
fn camera_ray(position: vec2<f32>) -> Ray {
    let slope = params.slope.xy * position + params.slope.zw;
    let base = params.base.xy * position + params.base.zw;
    // At z, the ray is at base + slope z across the view.
    let from_ = base + slope * params.near - vec2(params.right.w, params.up.w);
    var origin = from_.x * params.right.xyz + from_.y * params.up.xyz + (params.near - params.forward.w) * params.forward.xyz;
    var direction = slope.x * params.right.xyz + slope.y * params.up.xyz + params.forward.xyz;
    if params.lens > 0.0 {
        let target_point = origin + (params.focus - params.near) * direction;
        let r = params.lens * sqrt(random());
        let turn = 2.0 * PI * random();
        origin += r * cos(turn) * params.right.xyz + r * sin(turn) * params.up.xyz;
        direction = target_point - origin;
    }
    return Ray(origin, normalize(direction), 0.0, NONE);
}

// Returns the tet that contains the start of a ray whose nearest face is `back`, by a walk back from
// that face.
fn tet_of_start(ray: Ray, back: FaceHit) -> u32 {
    var reverse = Ray(ray.origin + back.distance * ray.direction, -ray.direction, 0.0, back.code >> 2u);
    for (var i = 0u; i < params.max_steps; i++) {
        enter_tet(reverse);
        if exit_at >= back.distance || exit_code == NONE {
            break;
        }
        reverse.at = exit_at;
        reverse.tet = exit_code >> 2u;
    }
    return reverse.tet;
}

struct PathResult {
    light: vec3<f32>,
    opacity: f32,
    lost: bool,
}

// What a path meets.
struct Collision {
    colour: vec3<f32>,
    // Unit normal, on the side the path came from, and how likely the collision is with a surface.
    normal: vec3<f32>,
    surface_share: f32,
}

// Returns the collision with the medium at a place in the tet of a ray; extinction is per local unit.
fn collision_at(ray: Ray, x: vec3<f32>, medium: Medium, cut: Cut) -> Collision {
    let gradient = gradient_at_place(ray.tet, x, medium.scan);
    let steep = length(gradient);
    var found = Collision(linear_colour(medium.colour), gradient / max(steep, 1e-20), steep / (steep + GRADIENT_HALF_SATURATION));
    let cut_depth = params.extinction * medium.extinction * cut.distance / CUT_DEPTH;
    let cut_distance = cut.distance / CUT_DISTANCE;
    let cut_share = exp(-cut_depth * cut_depth - cut_distance * cut_distance);
    if cut_share > 0.0 && random() < cut_share {
        found.normal = cut.normal;
        found.surface_share = 1.0;
    }
    return found;
}

// State of a path.
var<private> ray: Ray;
var<private> wall: WallHit;
var<private> weight: vec3<f32>;
// Density with which the direction of the path was sampled.
var<private> density: f32;
var<private> events: u32;
// While a direction to the surroundings is tested, the path waits.
var<private> testing: bool;
var<private> tested: vec3<f32>;
var<private> waiting: Ray;

fn start_ray(next: Ray) {
    ray = next;
    wall = nearest_wall(ray.origin, ray.direction, WALL_OFFSET);
    if ray.tet != NONE {
        enter_tet(ray);
    }
}

// Scatters the path at x. Returns whether it goes on.
fn scatter(x: vec3<f32>, met: Collision) -> bool {
    let back = -ray.direction;
    let normal = select(met.normal, -met.normal, dot(met.normal, back) < 0.0);
    events += 1u;
    let on_surface = random() < met.surface_share && dot(normal, back) > 1e-4;
    let light = sample_sky();
    var to_light: LobeValue;
    var way: vec3<f32>;
    var factor = met.colour;
    if on_surface {
        to_light = surface_value(normal, back, light.direction, met.colour);
        way = sample_surface(normal, back, met.colour);
        let reflected = surface_value(normal, back, way, met.colour);
        density = reflected.density;
        factor = select(vec3(0.0), reflected.value / max(density, 1e-20), density > 0.0);
    } else {
        let along = phase(dot(ray.direction, light.direction));
        to_light = LobeValue(met.colour * along, along);
        way = sample_phase(ray.direction);
        density = phase(dot(ray.direction, way));
    }
    tested = weight * to_light.value * light.colour / max(light.density + to_light.density, 1e-20);
    weight *= factor;
    let most = max(weight.x, max(weight.y, weight.z));
    let survives = select(min(most, 1.0), 1.0, events <= SURE_EVENTS);
    let goes_on = most > 0.0 && random() < survives;
    weight = select(vec3(0.0), weight / max(survives, 1e-20), goes_on);
    waiting = Ray(x, way, 0.0, ray.tet);
    testing = any(tested > vec3(0.0));
    if testing {
        start_ray(Ray(x, light.direction, 0.0, ray.tet));
    } else if goes_on {
        start_ray(waiting);
    }
    return testing || goes_on;
}

// Ends the test of a direction. Returns whether the path goes on.
fn end_test() -> bool {
    testing = false;
    if !any(weight > vec3(0.0)) {
        return false;
    }
    start_ray(waiting);
    return true;
}

fn trace(position: vec2<f32>) -> PathResult {
    var found = PathResult(vec3(0.0), 0.0, false);
    weight = vec3(1.0);
    density = 0.0;
    events = 0u;
    testing = false;
    var first = camera_ray(position);
    if all(first.origin >= boxes[2].xyz) && all(first.origin <= boxes[3].xyz) {
        let nearest = nearest_face(first.origin, first.direction, 0.0, false);
        if nearest.code != NONE && !nearest.front {
            first.tet = tet_of_start(first, nearest);
        }
    }
    start_ray(first);
    for (var step = 0u; step < params.max_steps; step++) {
        var next = 3e38;
        var entry = NONE;
        if ray.tet == NONE {
            let face = nearest_face(ray.origin, ray.direction, ray.at, true);
            next = face.distance;
            entry = face.code;
        } else if majorant > 0.0 {
            next = ray.at - log(1.0 - random()) / majorant;
        }
        var met: Collision;
        var x: vec3<f32>;
        if HAS_WALLS && wall.distance <= min(next, select(exit_at, 3e37, ray.tet == NONE)) {
            ray.at = wall.distance;
            x = ray.origin + ray.at * ray.direction;
            let clipped = CLIP_PLANE_COUNT > 0u && nearest_cut_in_space(x) < 0.0;
            if clipped || random() >= walls[wall.item].w {
                wall = nearest_wall(ray.origin, ray.direction, ray.at + WALL_OFFSET);
                continue;
            }
            let normal = at_wall(wall, 3u);
            met = Collision(at_wall(wall, 6u), normal / max(length(normal), 1e-20), 1.0);
        } else if ray.tet == NONE {
            if entry != NONE {
                ray.at = next;
                ray.tet = entry >> 2u;
                enter_tet(ray);
                continue;
            }
            if testing {
                found.light += tested;
                if end_test() {
                    continue;
                }
                return found;
            }
            if events > 0u {
                let light = sky_at(ray.direction);
                found.light += weight * light.rgb * (density / (density + light.w));
            }
            return found;
        } else if next >= exit_at {
            ray.at = exit_at;
            ray.tet = select(exit_code >> 2u, NONE, exit_code == NONE);
            if ray.tet != NONE {
                enter_tet(ray);
            }
            continue;
        } else {
            ray.at = next;
            x = ray.origin + ray.at * ray.direction;
            load_medium(ray.tet);
            let medium = medium_at(ray.tet, x);
            var cut = Cut(3e38, vec3(0.0));
            if CLIP_PLANE_COUNT > 0u {
                cut = nearest_cut(x);
            }
            if cut.distance < 0.0 || random() * majorant >= params.extinction * medium.extinction {
                continue;
            }
            if !testing {
                met = collision_at(ray, x, medium, cut);
            }
        }
        if testing {
            if end_test() {
                continue;
            }
            return found;
        }
        found.opacity = 1.0;
        if !scatter(x, met) {
            return found;
        }
    }
    found.lost = true;
    return found;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let pixel = id.xy + params.corner;
    seed_random(pixel, params.sample, params.seed);
    // The window's camera counts from its corner.
    let position = vec2<f32>(id.xy) + vec2(random(), random());
    let found = trace(position);
    if found.lost {
        atomicAdd(&lost_path_count[0], 1u);
    }
    let luminance = dot(found.light, vec3(0.2126, 0.7152, 0.0722));
    let i = 2u * (id.y * params.size.x + id.x);
    sums[i] += vec4(found.light, found.opacity);
    sums[i + 1u] += vec4(luminance * luminance, 0.0, 0.0, 0.0);
}
