// Line search: accepts a trial, or selects a longer or shorter step length. One workgroup.

#import lib/workgroup_sum
#import lib/status
#import lib/tool_motion

struct LineSearchParams {
    // Number of workgroups that wrote a partial sum.
    groups: u32,
}

@group(0) @binding(next) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(next) var<storage, read_write> status: Status;
@group(0) @binding(next) var<storage, read_write> contact_state: ContactStepState;
@group(0) @binding(next) var<uniform> params: LineSearchParams;

// A trial is too long if its slope is uphill and exceeds this fraction of the initial descent.
const MAX_SLOPE_RATIO: f32 = 0.5;

// A trial after one that was too long is too short if its slope is downhill and exceeds this
// fraction of the initial descent (curvature condition).
const CURVATURE_RATIO: f32 = 0.9;

// Maximum number of trials per direction.
const MAX_LINE_SEARCH_TRIALS: u32 = 8u;

// Factor by which the activation distance of tools shrinks per iteration.
const ACTIVATION_SHRINK: f32 = 0.3;

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
    let initial_slope = abs(total.x);
    if contact_state.line_search_trials == 0u {
        contact_state.bracket_low = 0.0;
        contact_state.low_slope = initial_slope;
    }
    let is_not_finite = !finite(total.y);
    let is_too_long = is_not_finite || total.y < -MAX_SLOPE_RATIO * initial_slope;
    let is_too_short = contact_state.line_search_trials > 0u && total.y > CURVATURE_RATIO * initial_slope;
    if contact_state.line_search_trials < MAX_LINE_SEARCH_TRIALS && (is_too_long || is_too_short) {
        if is_too_long {
            contact_state.high = contact_state.last_length;
            contact_state.high_slope = select(total.y, -initial_slope, is_not_finite);
        } else {
            contact_state.bracket_low = contact_state.last_length;
            contact_state.low_slope = total.y;
        }
        let secant = contact_state.low_slope / (contact_state.low_slope - contact_state.high_slope);
        contact_state.trial_length = mix(contact_state.bracket_low, contact_state.high, clamp(secant, 0.2, 0.7));
        contact_state.line_search_trials += 1u;
        status.solving = 1u;
        return;
    }
    contact_state.newton_iteration += 1u;
    contact_state.line_search_trials = 0u;
    contact_state.trial_length = 1.0;
    let is_last_stage = contact_state.stage == contact_state.stages;
    contact_state.tracks_tool = select(1u, 0u, is_last_stage);
    var min_gap = 3.4e38;
    for (var k = 0u; k < arrayLength(&tools); k++) {
        tools[k].previous_position = tools[k].current_position;
        tools[k].previous_rotation = tools[k].current_rotation;
        min_gap = min(min_gap, tools[k].contact_parameters.y);
    }
    if !is_last_stage {
        contact_state.stage += 1u;
        set_tool_stage(contact_state.stage, contact_state.stages);
        return;
    }
    contact_state.activation_distance = select(0.0, ACTIVATION_SHRINK * contact_state.activation_distance, ACTIVATION_SHRINK * contact_state.activation_distance > min_gap);
    if contact_state.update_lagged_friction != 0u {
        contact_state.friction_updates += 1u;
        for (var k = 0u; k < arrayLength(&tools); k++) {
            tools[k].friction_position = tools[k].current_position;
            tools[k].friction_rotation = tools[k].current_rotation;
        }
    }
}
