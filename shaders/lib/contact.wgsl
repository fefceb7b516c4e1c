// Points of the boundary and the tools near them: E = Σ A K ĝ b(d/ĝ), with Coulomb friction by the
// normal forces of a state before. The twin of `physics::contact` and `physics::cpu::contact`.

#import lib/array
#import lib/status
#import lib/tool

// Where the nodes are at the start of the step.
@group(0) @binding(next) var start_positions: texture_2d<f32>;
@group(0) @binding(next) var masses: texture_2d<f32>;
@group(0) @binding(next) var<storage, read> status: Status;
@group(0) @binding(next) var<storage, read> tools: array<Tool>;
// Values of all fields.
@group(0) @binding(next) var<storage, read> fields: array<f32>;

// Points of a face's lattice are nearer to each other at rest than this part of a tool's size, and
// so many along an edge at most.
const MAX_SPACING_RATIO: f32 = 0.2;
const MAX_SUBDIVISIONS: f32 = 12.0;

// A point whose nodes are free by less than this has nowhere to go.
const MIN_MOBILITY: f32 = 0.25;

// Where the barrier goes on as a parabola; see `physics::contact::barrier`.
const QUADRATIC_BELOW: f32 = 0.2;

// b, b' and b'' at the gap g.
fn barrier_derivatives(g: f32) -> vec3<f32> {
    if g >= 1.0 {
        return vec3(0.0);
    }
    let x = max(g, QUADRATIC_BELOW);
    let off = x - 1.0;
    let ratio = off / x;
    let logarithm = log(x);
    let slope = -2.0 * off * logarithm - off * ratio;
    let bend = -2.0 * logarithm - 4.0 * ratio + ratio * ratio;
    let by = g - x;
    return vec3(by * (slope + 0.5 * by * bend) - off * off * logarithm, slope + by * bend, bend);
}

// Parts of an edge of a face in the lattice of points that a tool is kept from.
fn subdivisions(k: u32, longest: f32) -> u32 {
    // Not one more where the quotient is a whole number but for rounding.
    return u32(clamp(ceil(longest / (MAX_SPACING_RATIO * tools[k].numbers.w) - 1e-3), 1.0, MAX_SUBDIVISIONS));
}

// All within `radius` of a place from which the point is `off`: normal and distance.
fn sphere_distance(off: vec3<f32>, radius: f32) -> vec4<f32> {
    let l = length(off);
    if l < 1e-30 {
        return vec4(1.0, 0.0, 0.0, -radius);
    }
    return vec4(off / l, l - radius);
}

// The weights of three points at t from the first, and their slopes.
fn bspline_weights(t: f32) -> mat2x3<f32> {
    let s = t - 1.0;
    return mat2x3(
        vec3(0.5 * (0.5 - s) * (0.5 - s), 0.75 - s * s, 0.5 * (0.5 + s) * (0.5 + s)),
        vec3(s - 0.5, -2.0 * s, s + 0.5),
    );
}

// Where a point stands to a field of distances.
fn sdf_distance(k: u32, p: vec3<f32>) -> vec4<f32> {
    let spacing = tools[k].low.w;
    let counts = tools[k].grid.xyz;
    let within = clamp((p - tools[k].low.xyz) / spacing, vec3(1.5), vec3<f32>(counts) - 2.5);
    let beyond = p - tools[k].low.xyz - spacing * within;
    let far = length(beyond);
    if far > 1e-5 * spacing {
        return vec4(beyond / far, far + 2.5 * spacing);
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
    return tools[k].shape.x * vec4(sum.xyz / spacing, sum.w);
}

// Where a point of the tool's own frame stands to it: the normal, and in w the distance.
fn local_distance(k: u32, p: vec3<f32>) -> vec4<f32> {
    let shape = tools[k].shape;
    switch u32(shape.w) {
        case SPHERE: {
            return sphere_distance(p, shape.x);
        }
        case CAPSULE: {
            return sphere_distance(p - vec3(0.0, 0.0, clamp(p.z, -shape.y, shape.y)), shape.x);
        }
        case BOX: {
            let side = select(vec3(1.0), vec3(-1.0), p < vec3(0.0));
            let out = abs(p) - shape.xyz;
            let most = max(max(out.x, out.y), out.z);
            if most > 0.0 {
                return sphere_distance(side * max(out, vec3(0.0)), 0.0);
            }
            if most == out.x {
                return vec4(side.x, 0.0, 0.0, most);
            }
            if most == out.y {
                return vec4(0.0, side.y, 0.0, most);
            }
            return vec4(0.0, 0.0, side.z, most);
        }
        case PLANE: {
            return vec4(0.0, 0.0, 1.0, p.z);
        }
        default: {
            return sdf_distance(k, p);
        }
    }
}

// The same of a point that is p from the tool's origin, where it is turned so.
fn surface_distance(k: u32, p: vec3<f32>, turn: vec4<f32>) -> vec4<f32> {
    let own = local_distance(k, quat_rotate(quat_conjugate(turn), p));
    return vec4(quat_rotate(turn, own.xyz), own.w);
}

// From a tool's origin at `place`, a point of three nodes at x + h v: differences first, so that
// they have their digits.
fn relative_displacement(x: mat3x3<f32>, place: vec3<f32>, w: vec3<f32>, way: vec3<f32>) -> vec3<f32> {
    return w.x * (x[0] - place) + w.y * (x[1] - place) + w.z * (x[2] - place) + way;
}
