// Runs after the iterations recorded for a step with tools: converged, or to be continued. One
// invocation.

#import lib/status
#import lib/tool_motion

@group(0) @binding(next) var<storage, read_write> status: Status;
@group(0) @binding(next) var<storage, read_write> pushing: ContactStepState;

@compute @workgroup_size(1)
fn main() {
    if status.failed != 0u {
        return;
    }
    status.iterations = 8u * pushing.cg_batches;
    status.solving = select(1u, 0u, pushing.done != 0u);
    if pushing.done == 0u {
        return;
    }
    pushing.step_found = 1u;
    pushing.steps = status.steps;
    for (var k = 0u; k < arrayLength(&tools); k++) {
        tools[k].accepted_position = tools[k].current_position;
        tools[k].accepted_rotation = tools[k].current_rotation;
    }
}
