// The paper's walk: in each tet, the exit is the nearest of the planes that the ray leaves through,
//     lambda_i = ((v - e) · n_i) / (r · n_i)  over faces with  r · n_i > 0
// where the face it came in by is left out, and the scalar follows from the gradient,
//     s(x) = g · (x - v0) + s0,  clamped to the tet's range.
// After Tejada & Ertl (2005), section 5.1. The ray's parameter is z of camera space.

#import lib/array
#import lib/view
#import lib/tet
#import lib/segment
#import lib/sight

override BACKWARDS: bool = false;
override OCCLUDED: bool = false;
// Whether scalars are constant in each tet.
override CELLS: bool = false;

// Eight texels a tet; see refresh_geometry.wgsl.
@group(0) @binding(0) var records: texture_2d<u32>;
// One scalar a tet, if CELLS.
@group(0) @binding(1) var cells: texture_2d<f32>;
// If LIT: the four nodes of each tet, their positions, and the gradient at each.
@group(0) @binding(2) var tets: texture_2d<u32>;
@group(0) @binding(3) var positions: texture_2d<f32>;
@group(0) @binding(4) var gradients: texture_2d<f32>;
@group(0) @binding(5) var starts: texture_2d<u32>;
@group(0) @binding(6) var fronts: texture_2d<u32>;
@group(0) @binding(7) var gathered: texture_2d<f32>;
@group(0) @binding(8) var occluder: texture_depth_2d;
@group(0) @binding(9) var table: texture_2d_array<f32>;
@group(0) @binding(10) var smooth_sampler: sampler;
@group(0) @binding(11) var<storage, read_write> lost: array<atomic<u32>, 1>;
@group(0) @binding(12) var<uniform> params: View;

#import lib/fullscreen

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return fullscreen(index);
}

// A walk that ends farther than this outside the tet it was in last, in local units, is lost.
const STRAY: f32 = 1e-3;

// A ray in the local frame: point(z) = foot + z run.
struct Ray {
    foot: vec3<f32>,
    run: vec3<f32>,
    // What a step in z is worth in the unit of the mode.
    scale: f32,
    // z at which it ends.
    end: f32,
}

struct Walked {
    sum: vec4<f32>,
    found: bool,
}

fn record(t: u32, k: u32) -> vec4<u32> {
    let i = t * 8u + k;
    return textureLoad(records, at(i), 0);
}

fn plane(t: u32, k: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(record(t, k));
}

// The scalar (table coordinate) at z in tet t.
fn scalar_at(t: u32, ray: Ray, z: f32) -> f32 {
    if CELLS {
        return params.scalar.x * textureLoad(cells, at(t), 0).x + params.scalar.y;
    }
    let gradient = plane(t, 4u);
    let corner = record(t, 5u);
    let x = ray.foot + z * ray.run - bitcast<vec3<f32>>(corner.xyz);
    let range = unpack2x16unorm(corner.w);
    let s = clamp(dot(gradient.xyz, x) + gradient.w, range.x, range.y);
    return params.scalar.x * s + params.scalar.y;
}

// The light on the ray between two depths in tet t: that of the gradient in the middle.
fn shade_between(t: u32, ray: Ray, z0: f32, z1: f32) -> vec2<f32> {
    if !LIT {
        return vec2(1.0, 0.0);
    }
    let ids = textureLoad(tets, at(t), 0);
    let x = ray.foot + 0.5 * (z0 + z1) * ray.run;
    var p: array<vec3<f32>, 4>;
    for (var k = 0u; k < 4u; k++) {
        p[k] = textureLoad(positions, at(ids[k]), 0).xyz - x;
    }
    // Volumes of the parts that the point makes of the tet.
    var w = vec4(
        dot(p[1], cross(p[2], p[3])),
        -dot(p[0], cross(p[2], p[3])),
        dot(p[0], cross(p[1], p[3])),
        -dot(p[0], cross(p[1], p[2])),
    );
    let whole = w.x + w.y + w.z + w.w;
    w = clamp(w / select(whole, 1e-30, abs(whole) < 1e-30), vec4(0.0), vec4(1.0));
    var gradient = vec3(0.0);
    for (var k = 0u; k < 4u; k++) {
        gradient += w[k] * textureLoad(gradients, at(ids[k]), 0).xyz;
    }
    return shade(params, gradient / max(w.x + w.y + w.z + w.w, 1e-30), normalize(ray.run));
}

fn walk(code: u32, ray: Ray, before: vec4<f32>) -> Walked {
    var sum = before;
    // 4 tet + the face come in by.
    var here = code;
    let entry = plane(code >> 2u, code & 3u);
    let slant = dot(entry.xyz, ray.run);
    var z = (entry.w - dot(entry.xyz, ray.foot)) / select(slant, -1e-12, abs(slant) < 1e-12);
    if BACKWARDS {
        z = max(z, params.near);
    }
    var s = scalar_at(code >> 2u, ray, z);
    var mark = NONE;
    var steps = 0u;
    var dead = false;
    var last = code >> 2u;
    loop {
        let t = here >> 2u;
        if here == NONE || t == mark || steps >= params.cap || is_opaque(sum) {
            break;
        }
        // A ray that meets a tet again goes in a circle: marks at powers of two find every one.
        if (steps & (steps - 1u)) == 0u {
            mark = t;
        }
        steps += 1u;
        last = t;
        if CELLS {
            s = scalar_at(t, ray, z);
        }
        let k = vec3(here + 1u, here + 2u, here + 3u) & vec3(3u);
        let p0 = plane(t, k.x);
        let p1 = plane(t, k.y);
        let p2 = plane(t, k.z);
        var slants = vec3(dot(p0.xyz, ray.run), dot(p1.xyz, ray.run), dot(p2.xyz, ray.run));
        let heights = vec3(p0.w - dot(p0.xyz, ray.foot), p1.w - dot(p1.xyz, ray.foot), p2.w - dot(p2.xyz, ray.foot));
        var next_z = 0.0;
        var exit = k.x;
        if BACKWARDS {
            let leave = select(vec3(-1e30), heights / slants, slants < vec3(0.0));
            next_z = leave.x;
            if leave.y > next_z { next_z = leave.y; exit = k.y; }
            if leave.z > next_z { next_z = leave.z; exit = k.z; }
            // No face leads out of here.
            if next_z <= -1e30 {
                dead = true;
                break;
            }
            next_z = min(next_z, z);
            if next_z < params.near {
                next_z = min(z, params.near);
                let near_s = scalar_at(t, ray, next_z);
                sum = gather_in_front(sum, Segment(vec2(near_s, s), (z - next_z) * ray.scale, shade_between(t, ray, next_z, z)));
                return Walked(begun(sum), true);
            }
        } else {
            let leave = select(vec3(1e30), heights / slants, slants > vec3(0.0));
            next_z = leave.x;
            if leave.y < next_z { next_z = leave.y; exit = k.y; }
            if leave.z < next_z { next_z = leave.z; exit = k.z; }
            if next_z >= 1e30 {
                dead = true;
                break;
            }
            next_z = max(next_z, z);
            if OCCLUDED && next_z > ray.end {
                next_z = max(z, ray.end);
                sum = gather(sum, Segment(vec2(s, scalar_at(t, ray, next_z)), (next_z - z) * ray.scale, shade_between(t, ray, z, next_z)));
                return Walked(sum, true);
            }
        }
        let next_s = scalar_at(t, ray, next_z);
        let light = shade_between(t, ray, z, next_z);
        if BACKWARDS {
            sum = gather_in_front(sum, Segment(vec2(next_s, s), (z - next_z) * ray.scale, light));
        } else {
            sum = gather(sum, Segment(vec2(s, next_s), (next_z - z) * ray.scale, light));
        }
        here = record(t, 6u)[exit];
        s = next_s;
        z = next_z;
    }
    if is_opaque(sum) {
        return Walked(sum, true);
    }
    // It must have come out at a point of the tet it was in last.
    let end = ray.foot + z * ray.run;
    var outside = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let p = plane(last, k);
        outside = max(outside, dot(p.xyz, end) - p.w);
    }
    return Walked(sum, !dead && here == NONE && outside < STRAY);
}

// Walks again along slightly other rays when a ray ends nowhere, as one may that lies exactly in a
// face; counts it as lost when they do as well.
fn walk_safely(code: u32, ray: Ray, before: vec4<f32>) -> vec4<f32> {
    var along = ray;
    var walked = Walked(before, false);
    for (var attempt = 0u; attempt < 4u && !walked.found; attempt++) {
        walked = walk(code, along, before);
        along.foot += 1.7e-6 * params.right.xyz - 1.1e-6 * params.up.xyz;
    }
    if !walked.found {
        atomicAdd(&lost[0], 1u);
    }
    return walked.sum;
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<u32>(position.xy);
    let start = textureLoad(starts, pixel, 0).xy;
    var sum = vec4(0.0);
    var starting = start.y != NONE;
    if BACKWARDS {
        // The eye is inside where the nearest face of all shows its back.
        let front = textureLoad(fronts, pixel, 0).xy;
        starting = starting && (front.y == NONE || bitcast<f32>(start.x) >= bitcast<f32>(front.x));
    } else {
        sum = textureLoad(gathered, pixel, 0);
        starting = starting && !is_opaque(sum);
    }
    let sight = sight_at(params, position.xy);
    let slope = sight.slope;
    let origin = sight.origin - vec2(params.right.w, params.up.w);
    let length = sqrt(1.0 + dot(slope, slope));
    var ray: Ray;
    ray.foot = origin.x * params.right.xyz + origin.y * params.up.xyz - params.forward.w * params.forward.xyz;
    ray.run = slope.x * params.right.xyz + slope.y * params.up.xyz + params.forward.xyz;
    ray.scale = length * select(params.unit, params.opacity, MODE == COMPOSITE);
    ray.end = 3e38;
    if OCCLUDED {
        ray.end = z_of_depth(params, textureLoad(occluder, pixel, 0));
        starting = starting && (BACKWARDS || z_of_depth(params, bitcast<f32>(start.x)) < ray.end);
    }
    if starting {
        if !BACKWARDS {
            sum = begun(sum);
        }
        sum = walk_safely(start.y, ray, sum);
    }
    return sum;
}
