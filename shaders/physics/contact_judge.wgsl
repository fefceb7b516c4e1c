// Takes a trial, or has less of the direction tried. One workgroup.

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
@group(0) @binding(next) var<storage, read_write> debug_log: array<vec4<f32>>;

// Iterations after the last stage that are taken whatever they come to: they find what touches, and
// those that go too far show it.
const FINDING: u32 = 12u;

// A trial is too far where the potential rises by more than this part of how it fell.
const RISES: f32 = 0.5;

// A direction is cut short so often at most.
const MOST_CUTS: u32 = 5u;

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
    debug_log[u32(debug_log[0].x) % 500u + 1u] = vec4(total.x, total.y, pushing.tried, f32(pushing.round) + 1000.0); debug_log[0].x += 1.0;
    let finding = pushing.stage < pushing.stages || pushing.follows != 0u
        || pushing.round < pushing.stages + FINDING;
    let rises = total.y < -RISES * abs(total.x);
    let broken = !finite(total.y);
    if pushing.cuts < MOST_CUTS && (broken || (rises && !finding)) {
        let secant = select(abs(total.x) / (abs(total.x) - total.y), 0.25, broken);
        pushing.length = pushing.tried * clamp(secant, 0.1, 0.7);
        pushing.cuts += 1u;
        status.solving = 1u;
        return;
    }
    pushing.round += 1u;
    pushing.cuts = 0u;
    pushing.length = 1.0;
    let last = pushing.stage == pushing.stages;
    pushing.follows = select(1u, 0u, last);
    if !last || pushing.rub != 0u {
        pushing.rub = 1u;
        pushing.rubs += select(0u, 1u, last);
        for (var k = 0u; k < arrayLength(&tools); k++) {
            tools[k].lag_place = tools[k].at_place;
            tools[k].lag_turn = tools[k].at_turn;
        }
    }
    if !last {
        pushing.stage += 1u;
        go_to_stage(pushing.stage, pushing.stages);
    }
}
