// Contact forces of tools on boundary points, and their Hessian contributions.

#import lib/contact

@group(0) @binding(next) var velocities: texture_2d<f32>;
// The latest change of the velocities.
@group(0) @binding(next) var ways: texture_2d<f32>;
// The velocities at which friction takes its normal forces (lagged friction).
@group(0) @binding(next) var rubbed: texture_2d<f32>;
@group(0) @binding(next) var<storage, read> pushing: ContactStepState;

struct ContactParams {
    items: u32,
    dt: f32,
    // Sliding speed below which friction is regularised (sticking).
    least_speed: f32,
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
    pierced: f32,
}

// Three nodes: start positions, velocities, their latest change, and the velocities used for
// friction.
struct ContactNodes {
    x: mat3x3<f32>,
    v: mat3x3<f32>,
    way: mat3x3<f32>,
    rubbed: mat3x3<f32>,
}

// Lower bound of the stiffness along the sliding direction, relative to sticking; prevents
// oscillation.
const MIN_SLIDING_STIFFNESS_RATIO: f32 = 0.1;

// Returns the activation distance of tool k in the current iteration.
fn active_gap(k: u32) -> f32 {
    return max(tools[k].numbers.y, pushing.activation_distance);
}

// Returns the contribution of tool k to a point with node weights w; ak is its A K.
fn contact_contribution(k: u32, at: ContactNodes, w: vec3<f32>, ak: f32) -> ContactContribution {
    let h = params.dt;
    let friction = tools[k].numbers.x;
    let gap = active_gap(k);
    let speed = at.v * w;
    let now = surface_distance(k, relative_displacement(at.x, tools[k].current_position.xyz, w, h * speed), tools[k].current_rotation);
    var barrier = barrier_derivatives(now.w / gap);
    var share = ContactContribution(vec3(0.0), vec3(0.0), vec3(0.0), false, 0.0);
    share.pierced = select(0.0, 1.0, now.w < -tools[k].limits.x);
    if pushing.tracks_tool != 0u {
        let way = pushing.last_length * h * (at.way * w);
        let p = relative_displacement(at.x, tools[k].previous_position.xyz, w, h * speed - way);
        let was = surface_distance(k, p, tools[k].previous_rotation);
        let known = barrier_derivatives(was.w / gap);
        if known.y < 0.0 {
            // Existing contacts follow the tool as if the barrier were a two-sided spring.
            // Otherwise tools that retract by more than the gap would release everything at once.
            barrier = vec3(0.0, known.y + known.z * (now.w - was.w) / gap, known.z);
        }
    }
    if friction > 0.0 {
        let p = relative_displacement(at.x, tools[k].friction_position.xyz, w, h * (at.rubbed * w));
        let was = surface_distance(k, p, tools[k].friction_rotation);
        let limit = -friction * ak * barrier_derivatives(was.w / tools[k].numbers.y).y;
        if limit > 0.0 {
            let own = quat_rotate(quat_conjugate(tools[k].friction_rotation), p);
            let moved = tools[k].target_position.xyz - tools[k].start_position.xyz
                + rotation_difference(tools[k].start_rotation, tools[k].target_rotation, own);
            let n = was.xyz;
            var slide = speed - moved / h;
            slide -= dot(n, slide) * n;
            let fast = length(slide);
            let least = params.least_speed;
            let y = fast / least;
            let slope = select((2.0 - y) / least, 1.0 / fast, y >= 1.0);
            share.touches = true;
            share.force = -limit * slope * slide;
            let c = h * limit * slope;
            share.diagonal = c * (1.0 - n * n);
            share.mixed = -c * n.xxy * n.yzz;
            let bend = max(2.0 * (1.0 - y) / least, MIN_SLIDING_STIFFNESS_RATIO * slope);
            let along = slide / max(fast, 1e-30);
            let less = h * limit * (bend - slope);
            share.diagonal += less * along * along;
            share.mixed += less * along.xxy * along.yzz;
        }
    }
    if barrier.z > 0.0 {
        let n = now.xyz;
        let c = h * h * ak * barrier.z / gap;
        share.touches = true;
        share.force -= ak * barrier.y * n;
        share.diagonal += c * n * n;
        share.mixed += c * n.xxy * n.yzz;
    }
    return share;
}
