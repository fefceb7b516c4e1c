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
@group(0) @binding(next) var<storage, read_write> pushing: ContactStepState;
@group(0) @binding(next) var<uniform> params: LineSearchParams;

// A trial is too long if the slope is positive and exceeds the first fraction of the initial
// descent; after such a trial, one is too short if the slope is still a larger descent than the
// second fraction.
const MAX_SLOPE_RATIO: f32 = 0.5;
const CURVATURE_RATIO: f32 = 0.9;

// Maximum number of trials per direction.
const MAX_LINE_SEARCH_TRIALS: u32 = 8u;

// Factor by which the activation distance of tools shrinks per iteration.
const ACTIVATION_SHRINK: f32 = 0.3;

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
    let first = abs(total.x);
    if pushing.line_search_trials == 0u {
        pushing.bracket_low = 0.0;
        pushing.low_slope = first;
    }
    let broken = !finite(total.y);
    let far = broken || total.y < -MAX_SLOPE_RATIO * first;
    let short = pushing.line_search_trials > 0u && total.y > CURVATURE_RATIO * first;
    if pushing.line_search_trials < MAX_LINE_SEARCH_TRIALS && (far || short) {
        if far {
            pushing.high = pushing.last_length;
            pushing.high_slope = select(total.y, -first, broken);
        } else {
            pushing.bracket_low = pushing.last_length;
            pushing.low_slope = total.y;
        }
        let secant = pushing.low_slope / (pushing.low_slope - pushing.high_slope);
        pushing.trial_length = mix(pushing.bracket_low, pushing.high, clamp(secant, 0.2, 0.7));
        pushing.line_search_trials += 1u;
        status.solving = 1u;
        return;
    }
    pushing.newton_iteration += 1u;
    pushing.line_search_trials = 0u;
    pushing.trial_length = 1.0;
    let last = pushing.stage == pushing.stages;
    pushing.tracks_tool = select(1u, 0u, last);
    var least = 3.4e38;
    for (var k = 0u; k < arrayLength(&tools); k++) {
        tools[k].previous_position = tools[k].current_position;
        tools[k].previous_rotation = tools[k].current_rotation;
        least = min(least, tools[k].numbers.y);
    }
    if !last {
        pushing.stage += 1u;
        set_tool_stage(pushing.stage, pushing.stages);
        return;
    }
    pushing.activation_distance = select(0.0, ACTIVATION_SHRINK * pushing.activation_distance, ACTIVATION_SHRINK * pushing.activation_distance > least);
    if pushing.update_friction != 0u {
        pushing.friction_updates += 1u;
        for (var k = 0u; k < arrayLength(&tools); k++) {
            tools[k].friction_position = tools[k].current_position;
            tools[k].friction_rotation = tools[k].current_rotation;
        }
    }
}
