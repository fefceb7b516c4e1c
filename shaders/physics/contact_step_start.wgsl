// Begins a step with tools: chooses the number of stages of their motion. One invocation.

#import lib/status
#import lib/tool_motion

@group(0) @binding(next) var<storage, read> status: Status;
@group(0) @binding(next) var<storage, read_write> pushing: ContactStepState;

struct InitParams {
    // Initial activation distance for moving tools.
    wide: f32,
}
@group(0) @binding(next) var<uniform> params: InitParams;

// Minimum tool motion, relative to `wide`, for which it applies.
const MIN_MOVE_RATIO: f32 = 0.2;

// Maximum number of stages per step.
const MAX_STAGES: f32 = 64.0;

// Upper bound of the distance of the boundary from the local origin, with a margin.
const BOUNDARY_RADIUS: f32 = 1.5;

@compute @workgroup_size(1)
fn main() {
    if status.failed != 0u || status.solving != 0u {
        return;
    }
    // If the last step converged and was accepted, tools are at its end.
    let sound = pushing.step_found != 0u && pushing.steps != status.steps;
    var most = 0.0;
    var moves = false;
    var farthest = 0.0;
    for (var k = 0u; k < arrayLength(&tools); k++) {
        if sound {
            tools[k].start_position = tools[k].accepted_position;
            tools[k].start_rotation = tools[k].accepted_rotation;
        }
        tools[k].previous_position = tools[k].start_position;
        tools[k].previous_rotation = tools[k].start_rotation;
        tools[k].friction_position = tools[k].start_position;
        tools[k].friction_rotation = tools[k].start_rotation;
        let arm = min(tools[k].limits.z, length(tools[k].start_position.xyz) + BOUNDARY_RADIUS);
        let cosine = abs(dot(tools[k].start_rotation, tools[k].target_rotation));
        let angle = 2.0 * sqrt(max(2.0 - 2.0 * cosine, 0.0));
        let way = distance(tools[k].start_position.xyz, tools[k].target_position.xyz) + angle * arm;
        moves = moves || any(tools[k].start_position != tools[k].target_position) || any(tools[k].start_rotation != tools[k].target_rotation);
        tools[k].limits.w = way;
        farthest = max(farthest, way);
        most = max(most, way / tools[k].limits.y);
    }
    let stages = u32(clamp(ceil(most), 1.0, MAX_STAGES));
    set_tool_stage(1u, stages);
    pushing = ContactStepState(1u, stages, select(0u, 1u, moves), 1u, 0u, 0u, 1u, 0u, 0u, 0u, 1.0, 1.0,
        0.0, 1.0, 0.0, 0.0, select(0.0, params.wide, farthest > params.wide * MIN_MOVE_RATIO), 0u, 0u, 3.4e38, 0u, 0u, 0u);
}
