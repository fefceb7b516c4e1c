// Begins a step of tools: in how many stages they go their way. One invocation.

#import lib/status
#import lib/tool_way

@group(0) @binding(next) var<storage, read> status: Status;
@group(0) @binding(next) var<storage, read_write> pushing: Pushing;

struct OpenParams {
    // Tools that move push from so far away at first.
    wide: f32,
}
@group(0) @binding(next) var<uniform> params: OpenParams;

// Those that move by more than this part of it do so.
const MOVES: f32 = 0.2;

// Stages of a step at most.
const MOST_STAGES: f32 = 64.0;

// How far the boundary comes from the middle of the local frame, and some.
const REACH: f32 = 1.5;

@compute @workgroup_size(1)
fn main() {
    if status.failed != 0u || status.solving != 0u {
        return;
    }
    // Where a step that was found was sound, tools are where it took them.
    let sound = pushing.found != 0u && pushing.steps != status.steps;
    var most = 0.0;
    var moves = false;
    var farthest = 0.0;
    for (var k = 0u; k < arrayLength(&tools); k++) {
        if sound {
            tools[k].from_place = tools[k].went_place;
            tools[k].from_turn = tools[k].went_turn;
        }
        tools[k].last_place = tools[k].from_place;
        tools[k].last_turn = tools[k].from_turn;
        tools[k].lag_place = tools[k].from_place;
        tools[k].lag_turn = tools[k].from_turn;
        let arm = min(tools[k].limits.z, length(tools[k].from_place.xyz) + REACH);
        let cosine = abs(dot(tools[k].from_turn, tools[k].to_turn));
        let angle = 2.0 * sqrt(max(2.0 - 2.0 * cosine, 0.0));
        let way = distance(tools[k].from_place.xyz, tools[k].to_place.xyz) + angle * arm;
        moves = moves || any(tools[k].from_place != tools[k].to_place) || any(tools[k].from_turn != tools[k].to_turn);
        tools[k].limits.w = way;
        farthest = max(farthest, way);
        most = max(most, way / tools[k].limits.y);
    }
    let stages = u32(clamp(ceil(most), 1.0, MOST_STAGES));
    go_to_stage(1u, stages);
    pushing = Pushing(1u, stages, select(0u, 1u, moves), 1u, 0u, 0u, 1u, 0u, 0u, 0u, 1.0, 1.0,
        0.0, 1.0, 0.0, 0.0, select(0.0, params.wide, farthest > params.wide * MOVES), 0u, 0u, 3.4e38, 0u, 0u, 0u);
}
