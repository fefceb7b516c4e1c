// Tools as stored on the GPU, in local units. Host side: `physics::gpu::contact`.

struct Tool {
    // Dimensions by shape: radius; radius and half length; half edges; or scale of the field
    // values. w is the shape.
    shape: vec4<f32>,
    // Friction coefficient, gap, half thickness if thin, and size.
    numbers: vec4<f32>,
    // Final penetration tolerance, maximum motion per stage, radius of an enclosing ball, and
    // maximum motion of any point during the step.
    limits: vec4<f32>,
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

// How a step of tools goes, as its iterations find and leave it.
struct ContactStepState {
    // Stages in which the tools go their way, and the one that they are at.
    stage: u32,
    stages: u32,
    // 1 while what touches follows its tool on a straight line: the first iteration of a stage.
    tracks_tool: u32,
    // 1 before the first system: the state to come from is that at the start of the step.
    is_first_system: u32,
    // Iterations, and how often friction took over normal forces.
    newton_iteration: u32,
    friction_updates: u32,
    // 1 where the next state that is taken is what friction goes by from then on.
    update_friction: u32,
    done: u32,
    // Rounds of eight iterations of conjugate gradients that were spent.
    cg_batches: u32,
    // How often the latest direction was tried again, how much of it is to be tried, and how much was.
    line_search_trials: u32,
    trial_length: f32,
    last_length: f32,
    // Parts of it between which the potential is least, and how steep it is at these.
    bracket_low: f32,
    high: f32,
    low_slope: f32,
    high_slope: f32,
    // Tools push from so far away at least, while it is being found what touches.
    activation_distance: f32,
    // 1 where a tool may come near in the step.
    may_contact: u32,
    // 1 where nothing touched in the system that was made last.
    had_no_contact: u32,
    // The least square of the residual, and iterations that came no lower.
    min_residual_squared: f32,
    stalled_iterations: u32,
    // 1 once a step was found, after so many steps: if there is one more by then, it was sound.
    step_found: u32,
    steps: u32,
}

fn quat_rotate(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}

// Where a turn has a vector, from where another one has it: of turns that are near each other the
// difference keeps its digits so.
fn rotation_difference(from_turn: vec4<f32>, to_turn: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    let by = select(-1.0, 1.0, dot(from_turn, to_turn) >= 0.0) * to_turn - from_turn;
    let first = from_turn.xyz;
    let last = first + by.xyz;
    let way = cross(by.xyz, cross(last, v) + (from_turn.w + by.w) * v);
    return 2.0 * (way + cross(first, cross(by.xyz, v) + by.w * v));
}

// The turn that undoes another.
fn quat_conjugate(q: vec4<f32>) -> vec4<f32> {
    return vec4(-q.xyz, q.w);
}
