// Newton convergence test, run after a system was assembled: decides whether the step is complete.
// One workgroup.

#import lib/cg
#import lib/tool_motion

struct ConvergenceParams {
    // Number of workgroups that wrote a partial sum.
    groups: u32,
    // 1 if a tool has friction.
    has_friction: u32,
}

@group(0) @binding(next) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(next) var<storage, read_write> scalars: CgScalars;
@group(0) @binding(next) var<storage, read_write> status: Status;
@group(0) @binding(next) var<storage, read_write> contact_state: ContactStepState;
@group(0) @binding(next) var<uniform> params: ConvergenceParams;

// Convergence tolerance of the squared residual, relative to the contact forces.
const TOLERANCE: f32 = 1e-6;

// Ratio of the squared residual to its tolerance below which the friction forces are updated
// (lagged friction).
const FRICTION_UPDATE_RESIDUAL_RATIO: f32 = 100.0;

// Number of friction updates per step with friction. The CPU engine makes at most 5 and stops when
// the forces no longer change; without that test, one more is made here.
const MAX_FRICTION_UPDATES: u32 = 6u;

// Maximum number of iterations after the last stage.
const MAX_ITERATIONS: u32 = 100u;

// Maximum number of consecutive iterations without progress.
const MAX_STALLED_ITERATIONS: u32 = 10u;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    var partial_sum = vec4(0.0);
    for (var k = lane; k < params.groups; k += WORKGROUP) {
        partial_sum += partials[k];
    }
    let total = reduce(partial_sum, lane);
    if lane != 0u || status.failed != 0u || status.solving != 0u {
        return;
    }
    status.solving = 1u;
    let friction_was_updated = contact_state.update_lagged_friction != 0u;
    contact_state.update_lagged_friction = 0u;
    let touches = total.z > 0.0;
    let had_no_contact = contact_state.had_no_contact != 0u;
    contact_state.had_no_contact = select(1u, 0u, touches);
    if contact_state.is_first_system != 0u {
        contact_state.is_first_system = 0u;
        // Tools that come near nothing move to their target at once.
        if contact_state.may_contact == 0u {
            contact_state.stage = contact_state.stages;
            contact_state.tracks_tool = 0u;
            contact_state.activation_distance = 0.0;
            set_tool_stage(contact_state.stage, contact_state.stages);
        }
        return;
    }
    if contact_state.tracks_tool != 0u || contact_state.activation_distance > 0.0 {
        return;
    }
    let residual_squared = total.x;
    status.residual = select(0.0, sqrt(max(residual_squared, 0.0) / total.z), touches);
    let target_squared = TOLERANCE * total.z;
    let can_update_friction = params.has_friction != 0u && touches && contact_state.friction_updates < MAX_FRICTION_UPDATES;
    if residual_squared < 0.7 * contact_state.min_residual_squared {
        contact_state.min_residual_squared = residual_squared;
        contact_state.stalled_iterations = 0u;
    } else {
        contact_state.stalled_iterations += 1u;
    }
    // A step without contact from the start converges in one iteration, as without tools.
    let is_contact_free = had_no_contact && !touches && contact_state.last_length >= 1.0;
    let has_converged = residual_squared <= target_squared && (friction_was_updated || !can_update_friction);
    let is_exhausted = contact_state.newton_iteration >= contact_state.stages + MAX_ITERATIONS || contact_state.stalled_iterations >= MAX_STALLED_ITERATIONS;
    if is_contact_free || has_converged || is_exhausted || !finite(residual_squared) {
        contact_state.done = 1u;
        scalars.done = CONVERGED;
        if total.w > 0.0 {
            status.failed = EXCESS_PENETRATION;
        }
        return;
    }
    contact_state.update_lagged_friction = select(0u, 1u, can_update_friction && residual_squared <= FRICTION_UPDATE_RESIDUAL_RATIO * target_squared);
}
