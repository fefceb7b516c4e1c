// Tools as stored on the GPU, in local units. Host side: `physics::gpu::contact`.

#import lib/rotation

struct Tool {
    // Dimensions by shape: radius; radius and half length; half edges; or scale of the field
    // values. w is the shape.
    dimensions: vec4<f32>,
    // Friction coefficient, gap, half thickness if thin, and size.
    contact_parameters: vec4<f32>,
    // Final penetration tolerance, maximum motion per stage, radius of an enclosing ball, and
    // maximum motion of any point during the step.
    motion_limits: vec4<f32>,
    // Signed distance field: first grid point and spacing; number of points along each axis and
    // index of the first value.
    low: vec4<f32>,
    grid: vec4<u32>,
    // Poses before the step, at its end, and at the current Newton iteration.
    start_position: vec4<f32>,
    start_rotation: vec4<f32>,
    target_position: vec4<f32>,
    target_rotation: vec4<f32>,
    current_position: vec4<f32>,
    current_rotation: vec4<f32>,
    // Pose in the previous iteration.
    previous_position: vec4<f32>,
    previous_rotation: vec4<f32>,
    // Pose at which the friction normal forces were evaluated.
    friction_position: vec4<f32>,
    friction_rotation: vec4<f32>,
    // Pose at the end of the last converged step.
    accepted_position: vec4<f32>,
    accepted_rotation: vec4<f32>,
}

const SPHERE: u32 = 0u;
const CAPSULE: u32 = 1u;
const BOX: u32 = 2u;
const PLANE: u32 = 3u;
const SDF: u32 = 4u;

// State of a step with tools between its Newton iterations.
struct ContactStepState {
    // Number of stages of the tool motion, and the current stage.
    stage: u32,
    stages: u32,
    // 1 while contacts follow their tool on a straight line: the first iteration of a stage.
    tracks_tool: u32,
    // 1 before the first system: the previous state is the state at the start of the step.
    is_first_system: u32,
    // Number of Newton iterations, and of friction updates (lagged friction).
    newton_iteration: u32,
    friction_updates: u32,
    // 1 if the next accepted state becomes the friction state.
    update_lagged_friction: u32,
    done: u32,
    // Number of batches of eight conjugate gradient iterations used.
    cg_batches: u32,
    // Line search: number of extra trials of the direction, step length to try, and length of the
    // last trial.
    line_search_trials: u32,
    trial_length: f32,
    last_length: f32,
    // Bracket of the minimum of the potential along the direction, and the slopes at its ends.
    bracket_low: f32,
    high: f32,
    low_slope: f32,
    high_slope: f32,
    // Minimum activation distance of tools while active contacts are being determined.
    activation_distance: f32,
    // 1 if a tool may come near in the step.
    may_contact: u32,
    // 1 if the last assembled system had no contact.
    had_no_contact: u32,
    // Smallest squared residual, and number of iterations without improvement.
    min_residual_squared: f32,
    stalled_iterations: u32,
    // 1 once a step has converged, and the step count at that time: if `steps` has increased since,
    // the step was accepted.
    step_found: u32,
    steps: u32,
}

// Returns the difference of v rotated by `to_rotation` and by `from_rotation`, computed so that it
// stays accurate for nearly equal rotations.
fn rotation_difference(from_rotation: vec4<f32>, to_rotation: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    let difference = select(-1.0, 1.0, dot(from_rotation, to_rotation) >= 0.0) * to_rotation - from_rotation;
    let from_vector = from_rotation.xyz;
    let to_vector = from_vector + difference.xyz;
    let rotated = cross(difference.xyz, cross(to_vector, v) + (from_rotation.w + difference.w) * v);
    return 2.0 * (rotated + cross(from_vector, cross(difference.xyz, v) + difference.w * v));
}
