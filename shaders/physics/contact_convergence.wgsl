// Newton convergence test, run after a system was assembled: decides whether the step is complete.
// One workgroup.

#import lib/cg
#import lib/tool_motion

struct ConvergenceParams {
    // Number of workgroups that wrote a partial sum.
    groups: u32,
    // 1 if a tool has friction.
    rubs: u32,
}

@group(0) @binding(next) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(next) var<storage, read_write> scalars: CgScalars;
@group(0) @binding(next) var<storage, read_write> status: Status;
@group(0) @binding(next) var<storage, read_write> pushing: ContactStepState;
@group(0) @binding(next) var<uniform> params: ConvergenceParams;

// Convergence tolerance of the squared residual, relative to the contact forces; and the ratio to
// it below which the friction forces are updated (lagged friction).
const TOLERANCE: f32 = 1e-6;
const FRICTION_UPDATE_RESIDUAL_RATIO: f32 = 100.0;

// Maximum number of friction updates per step.
const MAX_FRICTION_UPDATES: u32 = 6u;

// Maximum number of iterations after the last stage, and of consecutive iterations without
// progress.
const MAX_ITERATIONS: u32 = 100u;
const MAX_STALLED: u32 = 10u;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    var share = vec4(0.0);
    for (var k = lane; k < params.groups; k += WORKGROUP) {
        share += partials[k];
    }
    let total = reduce(share, lane);
    if lane != 0u || status.failed != 0u || status.solving != 0u {
        return;
    }
    status.solving = 1u;
    let rubbed = pushing.update_friction != 0u;
    pushing.update_friction = 0u;
    let touches = total.z > 0.0;
    let bare = pushing.had_no_contact != 0u;
    pushing.had_no_contact = select(1u, 0u, touches);
    if pushing.is_first_system != 0u {
        pushing.is_first_system = 0u;
        // Tools that come near nothing move to their target at once.
        if pushing.may_contact == 0u {
            pushing.stage = pushing.stages;
            pushing.tracks_tool = 0u;
            pushing.activation_distance = 0.0;
            set_tool_stage(pushing.stage, pushing.stages);
        }
        return;
    }
    if pushing.tracks_tool != 0u || pushing.activation_distance > 0.0 {
        return;
    }
    let square = total.x;
    status.residual = select(0.0, sqrt(max(square, 0.0) / total.z), touches);
    let goal = TOLERANCE * total.z;
    let rubs = params.rubs != 0u && touches && pushing.friction_updates < MAX_FRICTION_UPDATES;
    if square < 0.7 * pushing.min_residual_squared {
        pushing.min_residual_squared = square;
        pushing.stalled_iterations = 0u;
    } else {
        pushing.stalled_iterations += 1u;
    }
    // A step without contact from the start converges in one iteration, as without tools.
    let free = bare && !touches && pushing.last_length >= 1.0;
    let near = square <= goal && (rubbed || !rubs);
    let spent = pushing.newton_iteration >= pushing.stages + MAX_ITERATIONS || pushing.stalled_iterations >= MAX_STALLED;
    if free || near || spent || !finite(square) {
        pushing.done = 1u;
        scalars.done = CONVERGED;
        if total.w > 0.0 {
            status.failed = PIERCED;
        }
        return;
    }
    pushing.update_friction = select(0u, 1u, rubs && square <= FRICTION_UPDATE_RESIDUAL_RATIO * goal);
}
