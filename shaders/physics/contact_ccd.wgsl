// Continuous collision detection (CCD): the largest fraction of the direction for which no boundary
// point penetrates a tool too deeply; the minimum per workgroup. Uses conservative advancement: a
// distance changes no faster than its point moves. At the start of a step, a second value is 0 if a
// tool may come near in the step.

#import lib/contact
#import lib/workgroup_min

struct WayParams {
    faces: u32,
    dt: f32,
}

@group(0) @binding(next) var contact_corners: texture_2d<u32>;
@group(0) @binding(next) var velocities: texture_2d<f32>;
// Change of the velocities.
@group(0) @binding(next) var ways: texture_2d<f32>;
@group(0) @binding(next) var<storage, read> pushing: ContactStepState;
@group(0) @binding(next) var<storage, read_write> parts: array<vec2<f32>>;
@group(0) @binding(next) var<uniform> params: WayParams;

// Maximum penetration between two iterations, relative to half of the tool's thickness, so that
// points leave on the side where they entered.
const MAX_ITERATION_PENETRATION: f32 = 0.25;

// Maximum number of conservative advancement steps per point.
const MAX_CCD_ITERATIONS: u32 = 60u;

// Returns the allowed fraction of the motion `along` of a point at p relative to the tool's origin.
fn point_toi(k: u32, p: vec3<f32>, along: vec3<f32>, turn: vec4<f32>) -> f32 {
    let far = length(along);
    let deep = MAX_ITERATION_PENETRATION * tools[k].numbers.z;
    var t = 0.0;
    var room = surface_distance(k, p, turn).w + deep;
    let start = room;
    // Points that are already deeper are not limited.
    if start <= 0.0 {
        return 1.0;
    }
    for (var n = 0u; n < MAX_CCD_ITERATIONS; n++) {
        if far * (1.0 - t) <= room {
            return 1.0;
        }
        // Converged.
        if room <= 1e-2 * min(start, deep) {
            break;
        }
        t += room / far;
        room = surface_distance(k, p + t * along, turn).w + deep;
    }
    return t;
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    if status.failed != 0u || status.solving != 0u {
        return;
    }
    var way = 1.0;
    var apart = 1.0;
    for (var n = id.x; n < params.faces; n += groups.x * WORKGROUP) {
        let face = textureLoad(contact_corners, array_texel(n), 0);
        var x: mat3x3<f32>;
        var v: mat3x3<f32>;
        var along: mat3x3<f32>;
        var free = vec3(0.0);
        for (var c = 0u; c < 3u; c++) {
            let i = array_texel(face[c]);
            x[c] = textureLoad(start_positions, i, 0).xyz;
            if pushing.is_first_system == 0u {
                v[c] = textureLoad(velocities, i, 0).xyz;
            }
            along[c] = params.dt * textureLoad(ways, i, 0).xyz;
            free[c] = select(0.0, 1.0, textureLoad(masses, i, 0).y != 0.0);
        }
        let moved = x + params.dt * v;
        let edge = max(max(distance(moved[0], moved[1]), distance(moved[1], moved[2])), distance(moved[2], moved[0]));
        let far = max(max(length(along[0]), length(along[1])), length(along[2]));
        for (var k = 0u; k < arrayLength(&tools); k++) {
            var place = tools[k].current_position.xyz;
            var turn = tools[k].current_rotation;
            if pushing.is_first_system != 0u {
                place = tools[k].start_position.xyz;
                turn = tools[k].start_rotation;
            }
            let corner = surface_distance(k, relative_displacement(x, place, vec3(1.0, 0.0, 0.0), params.dt * v[0]), turn).w;
            if corner <= edge + far + tools[k].limits.w + max(tools[k].numbers.y, pushing.activation_distance) {
                apart = 0.0;
            }
            // Points behind a plane are pushed back without a limit.
            if corner > edge + far || u32(tools[k].shape.w) == PLANE {
                continue;
            }
            let count = subdivisions(k, bitcast<f32>(face.w));
            for (var i = 0u; i <= count; i++) {
                for (var j = 0u; j <= count - i; j++) {
                    let w = vec3(f32(i), f32(j), f32(count - i - j)) / f32(count);
                    if dot(w, free) >= MIN_MOBILITY {
                        way = min(way, point_toi(k, relative_displacement(x, place, w, params.dt * (v * w)), along * w, turn));
                    }
                }
            }
        }
    }
    let least = workgroup_min(way, lane);
    let least_apart = workgroup_min(apart, lane);
    if lane == 0u {
        parts[group.x] = vec2(least, least_apart);
    }
}
