// Contact forces of tools on boundary points, and their Hessian contributions.

#import lib/contact

@group(0) @binding(next) var velocities: texture_2d<f32>;
// The latest change of the velocities.
@group(0) @binding(next) var direction: texture_2d<f32>;
// The velocities at which friction takes its normal forces (lagged friction).
@group(0) @binding(next) var friction_velocities: texture_2d<f32>;
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

// Three nodes: start positions, velocities, their latest change, and the velocities used for
// friction.
struct ContactNodes {
    x: mat3x3<f32>,
    v: mat3x3<f32>,
    velocity_change: mat3x3<f32>,
    friction_velocities: mat3x3<f32>,
}

// Lower bound of the stiffness along the sliding direction, relative to sticking; prevents
// oscillation.
const MIN_SLIDING_STIFFNESS_RATIO: f32 = 0.1;

// Returns the activation distance of tool k in the current iteration.
fn active_gap(k: u32) -> f32 {
    return max(tools[k].contact_parameters.y, contact_state.activation_distance);
}

// Returns the contribution of tool k to a point with node weights w; ak is its A K.
fn contact_contribution(k: u32, at: ContactNodes, w: vec3<f32>, ak: f32) -> ContactContribution {
    let h = params.dt;
    let friction = tools[k].contact_parameters.x;
    let gap = active_gap(k);
    let speed = at.v * w;
    let now = surface_distance(k, relative_displacement(at.x, tools[k].current_position.xyz, w, h * speed), tools[k].current_rotation);
    var barrier = barrier_derivatives(now.w / gap);
    var contribution = ContactContribution(vec3(0.0), vec3(0.0), vec3(0.0), false, 0.0);
    contribution.exceeds_penetration = select(0.0, 1.0, now.w < -tools[k].motion_limits.x);
    if contact_state.tracks_tool != 0u {
        let latest_motion = contact_state.last_length * h * (at.velocity_change * w);
        let p = relative_displacement(at.x, tools[k].previous_position.xyz, w, h * speed - latest_motion);
        let previous = surface_distance(k, p, tools[k].previous_rotation);
        let previous_barrier = barrier_derivatives(previous.w / gap);
        if previous_barrier.y < 0.0 {
            // Existing contacts follow the tool as if the barrier were a two-sided spring.
            // Otherwise tools that retract by more than the gap would release everything at once.
            barrier = vec3(0.0, previous_barrier.y + previous_barrier.z * (now.w - previous.w) / gap, previous_barrier.z);
        }
    }
    if friction > 0.0 {
        let p = relative_displacement(at.x, tools[k].friction_position.xyz, w, h * (at.friction_velocities * w));
        let lagged = surface_distance(k, p, tools[k].friction_rotation);
        let max_force = -friction * ak * barrier_derivatives(lagged.w / tools[k].contact_parameters.y).y;
        if max_force > 0.0 {
            let local_point = quat_rotate(quat_conjugate(tools[k].friction_rotation), p);
            let moved = tools[k].target_position.xyz - tools[k].start_position.xyz
                + rotation_difference(tools[k].start_rotation, tools[k].target_rotation, local_point);
            let n = lagged.xyz;
            var slide = speed - moved / h;
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
