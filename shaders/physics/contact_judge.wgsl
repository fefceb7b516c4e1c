// Takes a trial, or has more or less of the direction tried. One workgroup.

#import lib/reduce
#import lib/status
#import lib/tool_way

struct LineSearchParams {
    // Workgroups that wrote a partial sum.
    groups: u32,
}

@group(0) @binding(next) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(next) var<storage, read_write> status: Status;
@group(0) @binding(next) var<storage, read_write> pushing: ContactStepState;
@group(0) @binding(next) var<uniform> params: LineSearchParams;

// A trial is too far where the potential rises by more than the first part of how steep it fell, and
// after one that was, not far enough where it falls by more than the second.
const MAX_SLOPE_RATIO: f32 = 0.5;
const CURVATURE_RATIO: f32 = 0.9;

// A direction is tried again so often at most.
const MAX_LINE_SEARCH_TRIALS: u32 = 8u;

// How much nearer tools push in an iteration than in the one before.
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
