// Contact of boundary quadrature points with tools: barrier energy E = Σ A K ĝ b(d/ĝ), with lagged
// Coulomb friction (normal forces of an earlier state). CPU reference: `physics::contact` and
// `physics::cpu::contact`.

#import lib/array
#import lib/status
#import lib/tool

// Node positions at the start of the step.
@group(0) @binding(next) var start_positions: texture_2d<f32>;
@group(0) @binding(next) var masses: texture_2d<f32>;
@group(0) @binding(next) var<storage, read> status: Status;
@group(0) @binding(next) var<storage, read> tools: array<Tool>;
// Values of all signed distance fields.
@group(0) @binding(next) var<storage, read> fields: array<f32>;

// Maximum rest spacing of a face's lattice of points relative to a tool's size, and the maximum
// number of subdivisions of an edge.
const MAX_SPACING_RATIO: f32 = 0.2;
const MAX_SUBDIVISIONS: f32 = 12.0;

// A point whose nodes have a mobility below this cannot move.
const MIN_MOBILITY: f32 = 0.25;

// Gap below which the barrier is extended quadratically; see `physics::contact::barrier`.
const QUADRATIC_BELOW: f32 = 0.2;

// Returns b, b' and b'' at the gap g.
fn barrier_derivatives(g: f32) -> vec3<f32> {
    if g >= 1.0 {
        return vec3(0.0);
    }
    let x = max(g, QUADRATIC_BELOW);
    let off = x - 1.0;
    let ratio = off / x;
    let logarithm = log(x);
    let first_derivative = -2.0 * off * logarithm - off * ratio;
    let second_derivative = -2.0 * logarithm - 4.0 * ratio + ratio * ratio;
    let by = g - x;
    return vec3(
        by * (first_derivative + 0.5 * by * second_derivative) - off * off * logarithm,
        first_derivative + by * second_derivative,
        second_derivative,
    );
}

// Returns the number of subdivisions of a face edge in the lattice of contact points.
fn subdivisions(k: u32, longest: f32) -> u32 {
    // The tolerance avoids an extra subdivision when rounding lifts a whole quotient.
    return u32(clamp(ceil(longest / (MAX_SPACING_RATIO * tools[k].contact_parameters.w) - 1e-3), 1.0, MAX_SUBDIVISIONS));
}

// Returns the normal and distance to the sphere of this radius; `off` is relative to its centre.
fn sphere_distance(off: vec3<f32>, radius: f32) -> vec4<f32> {
    let l = length(off);
    if l < 1e-30 {
        return vec4(1.0, 0.0, 0.0, -radius);
    }
    return vec4(off / l, l - radius);
}

// Returns the quadratic B-spline weights of three points at t from the first, and their
// derivatives.
fn bspline_weights(t: f32) -> mat2x3<f32> {
    let s = t - 1.0;
    return mat2x3(
        vec3(0.5 * (0.5 - s) * (0.5 - s), 0.75 - s * s, 0.5 * (0.5 + s) * (0.5 + s)),
        vec3(s - 0.5, -2.0 * s, s + 0.5),
    );
}

// Returns the normal and distance to a signed distance field.
fn sdf_distance(k: u32, p: vec3<f32>) -> vec4<f32> {
    let spacing = tools[k].low.w;
    let counts = tools[k].grid.xyz;
    let within = clamp((p - tools[k].low.xyz) / spacing, vec3(1.5), vec3<f32>(counts) - 2.5);
    let beyond = p - tools[k].low.xyz - spacing * within;
    let beyond_distance = length(beyond);
    if beyond_distance > 1e-5 * spacing {
        return vec4(beyond / beyond_distance, beyond_distance + 2.5 * spacing);
    }
    let first = floor(within - 0.5);
    let off = within - first;
    let wx = bspline_weights(off.x);
    let wy = bspline_weights(off.y);
    let wz = bspline_weights(off.z);
    let start = vec3<u32>(first);
    var sum = vec4(0.0);
    for (var z = 0u; z < 3u; z++) {
        for (var y = 0u; y < 3u; y++) {
            let row = tools[k].grid.w + ((start.z + z) * counts.y + start.y + y) * counts.x + start.x;
            let values = vec3(fields[row], fields[row + 1u], fields[row + 2u]);
            let value = dot(wx[0], values);
            sum += vec4(
                dot(wx[1], values) * wy[0][y] * wz[0][z],
                value * wy[1][y] * wz[0][z],
                value * wy[0][y] * wz[1][z],
                value * wy[0][y] * wz[0][z],
            );
        }
    }
    return tools[k].dimensions.x * vec4(sum.xyz / spacing, sum.w);
}

// Returns the normal and, in w, the distance to tool k of a point in the tool's frame.
fn local_distance(k: u32, p: vec3<f32>) -> vec4<f32> {
    let dimensions = tools[k].dimensions;
    switch u32(dimensions.w) {
        case SPHERE: {
            return sphere_distance(p, dimensions.x);
        }
        case CAPSULE: {
            return sphere_distance(p - vec3(0.0, 0.0, clamp(p.z, -dimensions.y, dimensions.y)), dimensions.x);
        }
        case BOX: {
            let side = select(vec3(1.0), vec3(-1.0), p < vec3(0.0));
            let out = abs(p) - dimensions.xyz;
            let max_offset = max(max(out.x, out.y), out.z);
            if max_offset > 0.0 {
                return sphere_distance(side * max(out, vec3(0.0)), 0.0);
            }
            if max_offset == out.x {
                return vec4(side.x, 0.0, 0.0, max_offset);
            }
            if max_offset == out.y {
                return vec4(0.0, side.y, 0.0, max_offset);
            }
            return vec4(0.0, 0.0, side.z, max_offset);
        }
        case PLANE: {
            return vec4(0.0, 0.0, 1.0, p.z);
        }
        default: {
            return sdf_distance(k, p);
        }
    }
}

// Returns the normal and distance to tool k with this rotation, of a point p relative to its
// origin.
fn surface_distance(k: u32, p: vec3<f32>, rotation: vec4<f32>) -> vec4<f32> {
    let local = local_distance(k, quat_rotate(quat_conjugate(rotation), p));
    return vec4(quat_rotate(rotation, local.xyz), local.w);
}

// Returns the position relative to a tool's `origin` of a point of three nodes at x,
// moved by `displacement`. Differences are taken first, to preserve accuracy.
fn relative_displacement(x: mat3x3<f32>, origin: vec3<f32>, w: vec3<f32>, displacement: vec3<f32>) -> vec3<f32> {
    return w.x * (x[0] - origin) + w.y * (x[1] - origin) + w.z * (x[2] - origin) + displacement;
}
