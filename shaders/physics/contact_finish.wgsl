// Runs after the iterations recorded for a step with tools: converged, or to be continued. One
// invocation.

#import lib/status
#import lib/tool_motion

@group(0) @binding(next) var<storage, read_write> status: Status;
@group(0) @binding(next) var<storage, read_write> contact_state: ContactStepState;

@compute @workgroup_size(1)
fn main() {
    if status.failed != 0u {
        return;
    }
    status.iterations = 8u * contact_state.cg_batches;
    status.solving = select(1u, 0u, contact_state.done != 0u);
    if contact_state.done == 0u {
        return;
    }
    contact_state.step_found = 1u;
    contact_state.steps = status.steps;
    for (var k = 0u; k < arrayLength(&tools); k++) {
        tools[k].accepted_position = tools[k].current_position;
        tools[k].accepted_rotation = tools[k].current_rotation;
    }
}
