// Begins a step with tools: chooses the number of stages of their motion. One invocation.

#import lib/status
#import lib/tool_motion

@group(0) @binding(next) var<storage, read> status: Status;
@group(0) @binding(next) var<storage, read_write> contact_state: ContactStepState;

struct InitParams {
    // Initial activation distance for moving tools.
    initial_activation_distance: f32,
}
@group(0) @binding(next) var<uniform> params: InitParams;

// Minimum tool motion, relative to the activation distance, for which it applies.
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
    let was_accepted = contact_state.step_found != 0u && contact_state.steps != status.steps;
    var stage_count = 0.0;
    var has_motion = false;
    var max_tool_displacement = 0.0;
    for (var k = 0u; k < arrayLength(&tools); k++) {
        if was_accepted {
            tools[k].start_position = tools[k].accepted_position;
            tools[k].start_rotation = tools[k].accepted_rotation;
        }
        tools[k].previous_position = tools[k].start_position;
        tools[k].previous_rotation = tools[k].start_rotation;
        tools[k].friction_position = tools[k].start_position;
        tools[k].friction_rotation = tools[k].start_rotation;
        let arm = min(tools[k].motion_limits.z, length(tools[k].start_position.xyz) + BOUNDARY_RADIUS);
        let cosine = abs(dot(tools[k].start_rotation, tools[k].target_rotation));
        let angle = 2.0 * sqrt(max(2.0 - 2.0 * cosine, 0.0));
        let max_displacement = distance(tools[k].start_position.xyz, tools[k].target_position.xyz) + angle * arm;
        has_motion = has_motion || any(tools[k].start_position != tools[k].target_position) || any(tools[k].start_rotation != tools[k].target_rotation);
        tools[k].motion_limits.w = max_displacement;
        max_tool_displacement = max(max_tool_displacement, max_displacement);
        stage_count = max(stage_count, max_displacement / tools[k].motion_limits.y);
    }
    let stages = u32(clamp(ceil(stage_count), 1.0, MAX_STAGES));
    set_tool_stage(1u, stages);
    contact_state = ContactStepState(1u, stages, select(0u, 1u, has_motion), 1u, 0u, 0u, 1u, 0u, 0u, 0u, 1.0, 1.0,
        0.0, 1.0, 0.0, 0.0, select(0.0, params.initial_activation_distance, max_tool_displacement > params.initial_activation_distance * MIN_MOVE_RATIO), 0u, 0u, 3.4e38, 0u, 0u, 0u);
}
