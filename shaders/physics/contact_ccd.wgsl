// Continuous collision detection (CCD): the largest fraction of the direction for which no boundary
// point penetrates a tool too deeply; the minimum per workgroup. Uses conservative advancement: a
// distance changes no faster than its point moves. At the start of a step, a second value is 0 if a
// tool may come near in the step.

#import lib/contact
#import lib/workgroup_min

struct CcdParams {
    faces: u32,
    dt: f32,
}

@group(0) @binding(next) var contact_corners: texture_2d<u32>;
@group(0) @binding(next) var velocities: texture_2d<f32>;
// Change of the velocities.
@group(0) @binding(next) var direction: texture_2d<f32>;
@group(0) @binding(next) var<storage, read> contact_state: ContactStepState;
@group(0) @binding(next) var<storage, read_write> partial_minima: array<vec2<f32>>;
@group(0) @binding(next) var<uniform> params: CcdParams;

// Maximum penetration between two iterations, relative to half of the tool's thickness, so that
// points leave on the side where they entered.
const MAX_ITERATION_PENETRATION: f32 = 0.25;

// Maximum number of conservative advancement steps per point.
const MAX_POINT_CCD_ITERATIONS: u32 = 60u;

// Returns the allowed fraction of the motion `along` of a point at p relative to the tool's origin.
fn point_toi(k: u32, p: vec3<f32>, along: vec3<f32>, rotation: vec4<f32>) -> f32 {
    let far = length(along);
    let allowed_penetration = MAX_ITERATION_PENETRATION * tools[k].contact_parameters.z;
    var t = 0.0;
    var clearance = surface_distance(k, p, rotation).w + allowed_penetration;
    let initial_clearance = clearance;
    // Points that are already deeper are not limited.
    if initial_clearance <= 0.0 {
        return 1.0;
    }
    for (var n = 0u; n < MAX_POINT_CCD_ITERATIONS; n++) {
        if far * (1.0 - t) <= clearance {
            return 1.0;
        }
        // Converged.
        if clearance <= 1e-2 * min(initial_clearance, allowed_penetration) {
            break;
        }
        t += clearance / far;
        clearance = surface_distance(k, p + t * along, rotation).w + allowed_penetration;
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
    var collision_free_fraction = 1.0;
    var is_far_from_tools = 1.0;
    for (var n = id.x; n < params.faces; n += groups.x * WORKGROUP) {
        let face = textureLoad(contact_corners, array_texel(n), 0);
        var x: mat3x3<f32>;
        var v: mat3x3<f32>;
        var along: mat3x3<f32>;
        var free = vec3(0.0);
        for (var c = 0u; c < 3u; c++) {
            let i = array_texel(face[c]);
            x[c] = textureLoad(start_positions, i, 0).xyz;
            if contact_state.is_first_system == 0u {
                v[c] = textureLoad(velocities, i, 0).xyz;
            }
            along[c] = params.dt * textureLoad(direction, i, 0).xyz;
            free[c] = select(0.0, 1.0, textureLoad(masses, i, 0).y != 0.0);
        }
        let moved = x + params.dt * v;
        let longest_edge = max(max(distance(moved[0], moved[1]), distance(moved[1], moved[2])), distance(moved[2], moved[0]));
        let far = max(max(length(along[0]), length(along[1])), length(along[2]));
        for (var k = 0u; k < arrayLength(&tools); k++) {
            var position = tools[k].current_position.xyz;
            var rotation = tools[k].current_rotation;
            if contact_state.is_first_system != 0u {
                position = tools[k].start_position.xyz;
                rotation = tools[k].start_rotation;
            }
            let corner_distance = surface_distance(k, relative_displacement(x, position, vec3(1.0, 0.0, 0.0), params.dt * v[0]), rotation).w;
            if corner_distance <= longest_edge + far + tools[k].motion_limits.w + max(tools[k].contact_parameters.y, contact_state.activation_distance) {
                is_far_from_tools = 0.0;
            }
            // Points behind a plane are pushed back without a limit.
            if corner_distance > longest_edge + far || u32(tools[k].dimensions.w) == PLANE {
                continue;
            }
            let count = subdivisions(k, bitcast<f32>(face.w));
            for (var i = 0u; i <= count; i++) {
                for (var j = 0u; j <= count - i; j++) {
                    let w = vec3(f32(i), f32(j), f32(count - i - j)) / f32(count);
                    if dot(w, free) >= MIN_MOBILITY {
                        collision_free_fraction = min(collision_free_fraction, point_toi(k, relative_displacement(x, position, w, params.dt * (v * w)), along * w, rotation));
                    }
                }
            }
        }
    }
    let min_fraction = workgroup_min(collision_free_fraction, lane);
    let min_is_far = workgroup_min(is_far_from_tools, lane);
    if lane == 0u {
        partial_minima[group.x] = vec2(min_fraction, min_is_far);
    }
}
