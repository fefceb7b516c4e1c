// Mesh traversal over face planes, as in the paper: in each tet, the ray exits through the nearest
// plane of lambda_i = ((v - e) · n_i) / (r · n_i) over faces with r · n_i > 0, excluding the entry
// face. The scalar follows from the gradient, s(x) = g · (x - v0) + s0, clamped to the tet's range.
// After Tejada & Ertl (2005), section 5.1. The ray parameter is camera-space z.

#each reads #import terms/TERM
// One scalar per tet, if CELL_SCALARS.
@group(0) @binding(next) var cells: texture_2d<f32>;
// If LIGHTING or USE_REST_POSITIONS: the four nodes of each tet, their positions, and if
// PER_NODE_LIGHT the gradient at each (w is the fraction of light that reaches it, if SHADOWS).
@group(0) @binding(next) var tets: texture_2d<u32>;
@group(0) @binding(next) var positions: texture_2d<f32>;
@group(0) @binding(next) var gradients: texture_2d<f32>;

#each table #import terms/TERM
#each scan #import terms/TERM
#each intervals #import terms/TERM
#import lib/array
#import lib/view
#import lib/tet
#import lib/segment
#import lib/ray_projection
#import lib/walk_frame

// A ray that ends farther than this outside its last tet, in local units, counts as lost.
const RAY_EPSILON: f32 = 1e-3;

fn load_record(t: u32, k: u32) -> vec4<u32> {
    return record_at(t * 8u + k);
}

fn plane(t: u32, k: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(load_record(t, k));
}

// Returns the position of node i, in the local frame.
fn corner_at(i: u32) -> vec3<f32> {
    return textureLoad(positions, array_texel(i), 0).xyz;
}

// Returns the scalar (table coordinate) at z in tet t.
fn scalar_at(t: u32, ray: Ray, z: f32) -> f32 {
    if CELL_SCALARS {
        return params.scalar.x * textureLoad(cells, array_texel(t), 0).x + params.scalar.y;
    }
    let gradient = plane(t, 4u);
    let corner = load_record(t, 5u);
    let x = ray.origin + z * ray.direction - bitcast<vec3<f32>>(corner.xyz);
    let range = unpack2x16unorm(corner.w);
    let s = clamp(dot(gradient.xyz, x) + gradient.w, range.x, range.y);
    return params.scalar.x * s + params.scalar.y;
}

// Returns the ray sample at z in tet t.
fn sample_at(t: u32, ray: Ray, z: f32) -> RaySample {
    var spot: RaySample;
    spot.z = z;
    spot.s = scalar_at(t, ray, z);
    if !(PER_NODE_LIGHT | USE_REST_POSITIONS) {
        return spot;
    }
    let ids = textureLoad(tets, array_texel(t), 0);
    let x = ray.origin + z * ray.direction;
    var p: array<vec3<f32>, 4>;
    for (var k = 0u; k < 4u; k++) {
        p[k] = textureLoad(positions, array_texel(ids[k]), 0).xyz - x;
    }
    // Sub-volumes of the tet at the point (barycentric weights).
    var w = vec4(
        dot(p[1], cross(p[2], p[3])),
        -dot(p[0], cross(p[2], p[3])),
        dot(p[0], cross(p[1], p[3])),
        -dot(p[0], cross(p[1], p[2])),
    );
    let whole = w.x + w.y + w.z + w.w;
    w = clamp(w / select(whole, 1e-30, abs(whole) < 1e-30), vec4(0.0), vec4(1.0));
    w /= max(w.x + w.y + w.z + w.w, 1e-30);
    for (var k = 0u; k < 4u; k++) {
        if PER_NODE_LIGHT {
            let lit = textureLoad(gradients, array_texel(ids[k]), 0);
            spot.gradient += w[k] * lit.xyz;
            if SHADOWS {
                spot.bright += w[k] * lit.w;
            }
        }
        if USE_REST_POSITIONS {
            spot.rest += w[k] * textureLoad(rests, array_texel(ids[k]), 0).xyz;
        }
    }
    return spot;
}

fn traverse(code: u32, ray: Ray, before: vec4<f32>) -> TraversalResult {
    var sum = before;
    // 4 tet + the entry face.
    var entry_face = code;
    let entry = plane(code >> 2u, code & 3u);
    let slant = dot(entry.xyz, ray.direction);
    let start = (entry.w - dot(entry.xyz, ray.origin)) / select(slant, -1e-12, abs(slant) < 1e-12);
    var here = sample_at(code >> 2u, ray, select(start, max(start, params.near), BACKWARD_TRAVERSAL));
    let first = here.z;
    let cap = params.max_steps;
    var cycle_mark = NONE;
    var steps = 0u;
    var no_exit_face = false;
    // Whether the ray reached an opaque object.
    var ended = false;
    var last = code >> 2u;
    loop {
        let t = entry_face >> 2u;
        if (entry_face == NONE) | (t == cycle_mark) | (steps >= cap) | is_terminated(sum) | ended {
            break;
        }
        // Cycle detection: tets marked at powers of two reveal every cycle.
        cycle_mark = select(cycle_mark, t, (steps & (steps - 1u)) == 0u);
        steps += 1u;
        last = t;
        if CELL_SCALARS {
            here.s = scalar_at(t, ray, here.z);
        }
        let other_faces = vec3(entry_face + 1u, entry_face + 2u, entry_face + 3u) & vec3(3u);
        let p0 = plane(t, other_faces.x);
        let p1 = plane(t, other_faces.y);
        let p2 = plane(t, other_faces.z);
        var slants = vec3(dot(p0.xyz, ray.direction), dot(p1.xyz, ray.direction), dot(p2.xyz, ray.direction));
        let heights = vec3(p0.w - dot(p0.xyz, ray.origin), p1.w - dot(p1.xyz, ray.origin), p2.w - dot(p2.xyz, ray.origin));
        var next_z = 0.0;
        var exit_face = other_faces.x;
        if BACKWARD_TRAVERSAL {
            let exit_z = select(vec3(-1e30), heights / slants, slants < vec3(0.0));
            next_z = exit_z.x;
            if exit_z.y > next_z { next_z = exit_z.y; exit_face = other_faces.y; }
            if exit_z.z > next_z { next_z = exit_z.z; exit_face = other_faces.z; }
            // No exit face.
            if next_z <= -1e30 {
                no_exit_face = true;
                break;
            }
            next_z = min(next_z, here.z);
            if next_z < params.near {
                let near = sample_at(t, ray, min(here.z, params.near));
                return TraversalResult(initial_accumulator(accumulate_until_depth(sum, Segment(near, here, t), ray)), true, vec2(near.z, first));
            }
        } else {
            let exit_z = select(vec3(1e30), heights / slants, slants > vec3(0.0));
            next_z = exit_z.x;
            if exit_z.y < next_z { next_z = exit_z.y; exit_face = other_faces.y; }
            if exit_z.z < next_z { next_z = exit_z.z; exit_face = other_faces.z; }
            if next_z >= 1e30 {
                no_exit_face = true;
                break;
            }
            next_z = max(next_z, here.z);
            if HAS_DEPTH {
                ended = next_z > ray.end;
                next_z = select(next_z, max(here.z, ray.end), ended);
            }
        }
        let next = sample_at(t, ray, next_z);
        if BACKWARD_TRAVERSAL {
            sum = accumulate_until_depth(sum, Segment(next, here, t), ray);
        } else {
            sum = accumulate_segment(sum, Segment(here, next, t), ray);
        }
        entry_face = load_record(t, 6u)[exit_face];
        here = next;
    }
    let depth_range = select(vec2(first, here.z), vec2(here.z, first), BACKWARD_TRAVERSAL);
    if is_terminated(sum) | ended {
        return TraversalResult(sum, true, depth_range);
    }
    // The ray must leave the mesh at a point of its last tet.
    let end = ray.origin + here.z * ray.direction;
    var outside = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let p = plane(last, k);
        outside = max(outside, dot(p.xyz, end) - p.w);
    }
    return TraversalResult(sum, !no_exit_face && entry_face == NONE && outside < RAY_EPSILON, depth_range);
}
