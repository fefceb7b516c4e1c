// Contact forces of tools on boundary points, and their Hessian contributions. Needs of the importing
// shader, for its `ContactPoint`: `start_offset(at, origin)`, the position at the start of the step
// relative to a tool's origin, and `velocity_at(at)`, `velocity_change_at(at)` and
// `friction_velocity_at(at)`.

#import lib/contact

@group(0) @binding(next) var velocities: texture_2d<f32>;
// The latest change of the velocities.
@group(0) @binding(next) var direction: texture_2d<f32>;
// The velocities at which friction takes its normal forces (lagged friction).
@group(0) @binding(next) var lagged_velocities: texture_2d<f32>;
@group(0) @binding(next) var<storage, read> contact_state: ContactStepState;

struct ContactParams {
    items: u32,
    dt: f32,
    // Sliding speed below which friction is regularised (sticking).
    static_friction_speed: f32,
    _pad0: u32,
}
@group(0) @binding(next) var<uniform> params: ContactParams;

struct ContactContribution {
    force: vec3<f32>,
    // xx, yy, zz, and xy, xz, yz of A = −h² ∂f/∂x − h ∂f/∂v.
    diagonal: vec3<f32>,
    mixed: vec3<f32>,
    touches: bool,
    // 1 if the point penetrates by more than the final tolerance.
    exceeds_penetration: f32,
}

// Lower bound of the stiffness along the sliding direction, relative to sticking; prevents
// oscillation.
const MIN_SLIDING_STIFFNESS_RATIO: f32 = 0.1;

// Returns the activation distance of tool k in the current iteration.
fn active_gap(k: u32) -> f32 {
    return max(tools[k].contact_parameters.y, contact_state.activation_distance);
}

// The states whose distance to a tool contributes: of the current iteration, of the previous one,
// and that of friction.
const NOW: u32 = 0u;
const PREVIOUS: u32 = 1u;
const LAGGED: u32 = 2u;

// Returns the contribution of tool k to a point; ak is its A K.
fn contact_contribution(k: u32, at: ContactPoint, ak: f32) -> ContactContribution {
    let h = params.dt;
    let friction = tools[k].contact_parameters.x;
    let gap = active_gap(k);
    let v = velocity_at(at);
    var now: vec4<f32>;
    var previous_distance = 0.0;
    var lagged: vec4<f32>;
    var lagged_p: vec3<f32>;
    // In a loop: three inlined calls take more registers than a GPU has.
    for (var state = NOW; state <= LAGGED; state++) {
        var position = tools[k].current_position.xyz;
        var rotation = tools[k].current_rotation;
        var displacement = h * v;
        if state == PREVIOUS {
            if contact_state.tracks_tool == 0u {
                continue;
            }
            position = tools[k].previous_position.xyz;
            rotation = tools[k].previous_rotation;
            displacement -= contact_state.last_length * h * velocity_change_at(at);
        } else if state == LAGGED {
            if friction <= 0.0 {
                break;
            }
            position = tools[k].friction_position.xyz;
            rotation = tools[k].friction_rotation;
            displacement = h * friction_velocity_at(at);
        }
        let p = start_offset(at, position) + displacement;
        let found = surface_distance(k, p, rotation);
        if state == NOW {
            now = found;
        } else if state == PREVIOUS {
            previous_distance = found.w;
        } else {
            lagged = found;
            lagged_p = p;
        }
    }
    var barrier = barrier_derivatives(now.w / gap);
    var contribution = ContactContribution(vec3(0.0), vec3(0.0), vec3(0.0), false, 0.0);
    contribution.exceeds_penetration = select(0.0, 1.0, now.w < -tools[k].motion_limits.x);
    if contact_state.tracks_tool != 0u {
        let previous_barrier = barrier_derivatives(previous_distance / gap);
        if previous_barrier.y < 0.0 {
            // Existing contacts follow the tool as if the barrier were a two-sided spring.
            // Otherwise tools that retract by more than the gap would release everything at once.
            barrier = vec3(0.0, previous_barrier.y + previous_barrier.z * (now.w - previous_distance) / gap, previous_barrier.z);
        }
    }
    if friction > 0.0 {
        let max_force = -friction * ak * barrier_derivatives(lagged.w / tools[k].contact_parameters.y).y;
        if max_force > 0.0 {
            let local_point = quat_rotate(quat_conjugate(tools[k].friction_rotation), lagged_p);
            let moved = tools[k].target_position.xyz - tools[k].start_position.xyz
                + rotation_difference(tools[k].start_rotation, tools[k].target_rotation, local_point);
            let n = lagged.xyz;
            var slide = v - moved / h;
            slide -= dot(n, slide) * n;
            let slide_speed = length(slide);
            let static_speed = params.static_friction_speed;
            let y = slide_speed / static_speed;
            let slope = select((2.0 - y) / static_speed, 1.0 / slide_speed, y >= 1.0);
            contribution.touches = true;
            contribution.force = -max_force * slope * slide;
            let c = h * max_force * slope;
            contribution.diagonal = c * (1.0 - n * n);
            contribution.mixed = -c * n.xxy * n.yzz;
            let second_derivative = max(2.0 * (1.0 - y) / static_speed, MIN_SLIDING_STIFFNESS_RATIO * slope);
            let along = slide / max(slide_speed, 1e-30);
            let sliding_correction = h * max_force * (second_derivative - slope);
            contribution.diagonal += sliding_correction * along * along;
            contribution.mixed += sliding_correction * along.xxy * along.yzz;
        }
    }
    if barrier.z > 0.0 {
        let n = now.xyz;
        let c = h * h * ak * barrier.z / gap;
        contribution.touches = true;
        contribution.force -= ak * barrier.y * n;
        contribution.diagonal += c * n * n;
        contribution.mixed += c * n.xxy * n.yzz;
    }
    return contribution;
}
