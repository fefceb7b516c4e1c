// Takes a trial, or has more or less of the direction tried. One workgroup.

#import lib/reduce
#import lib/status
#import lib/tool_way

struct JudgeParams {
    // Workgroups that wrote a partial sum.
    groups: u32,
}

@group(0) @binding(next) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(next) var<storage, read_write> status: Status;
@group(0) @binding(next) var<storage, read_write> pushing: Pushing;
@group(0) @binding(next) var<uniform> params: JudgeParams;

// A trial is too far where the potential rises by more than the first part of how steep it fell, and
// after one that was, not far enough where it falls by more than the second.
const RISES: f32 = 0.5;
const FALLS: f32 = 0.9;

// A direction is tried again so often at most.
const MOST_CUTS: u32 = 8u;

// How much nearer tools push in an iteration than in the one before.
const NARROWER: f32 = 0.3;

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
    if pushing.cuts == 0u {
        pushing.low = 0.0;
        pushing.low_slope = first;
    }
    let broken = !finite(total.y);
    let far = broken || total.y < -RISES * first;
    let short = pushing.cuts > 0u && total.y > FALLS * first;
    if pushing.cuts < MOST_CUTS && (far || short) {
        if far {
            pushing.high = pushing.tried;
            pushing.high_slope = select(total.y, -first, broken);
        } else {
            pushing.low = pushing.tried;
            pushing.low_slope = total.y;
        }
        let secant = pushing.low_slope / (pushing.low_slope - pushing.high_slope);
        pushing.length = mix(pushing.low, pushing.high, clamp(secant, 0.2, 0.7));
        pushing.cuts += 1u;
        status.solving = 1u;
        return;
    }
    pushing.round += 1u;
    pushing.cuts = 0u;
    pushing.length = 1.0;
    let last = pushing.stage == pushing.stages;
    pushing.follows = select(1u, 0u, last);
    var least = 3.4e38;
    for (var k = 0u; k < arrayLength(&tools); k++) {
        tools[k].last_place = tools[k].at_place;
        tools[k].last_turn = tools[k].at_turn;
        least = min(least, tools[k].numbers.y);
    }
    if !last {
        pushing.stage += 1u;
        go_to_stage(pushing.stage, pushing.stages);
        return;
    }
    pushing.wide = select(0.0, NARROWER * pushing.wide, NARROWER * pushing.wide > least);
    if pushing.rub != 0u {
        pushing.rubs += 1u;
        for (var k = 0u; k < arrayLength(&tools); k++) {
            tools[k].lag_place = tools[k].at_place;
            tools[k].lag_turn = tools[k].at_turn;
        }
    }
}
