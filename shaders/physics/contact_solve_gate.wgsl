// Runs after every few conjugate gradient iterations: enables the passes that use the solution once
// it is available. One invocation.

#import lib/cg
#import lib/tool

struct SolveGateParams {
    max_iterations: u32,
}

@group(0) @binding(0) var<storage, read> scalars: CgScalars;
@group(0) @binding(1) var<storage, read_write> status: Status;
@group(0) @binding(2) var<storage, read_write> contact_state: ContactStepState;
@group(0) @binding(3) var<uniform> params: SolveGateParams;

@compute @workgroup_size(1)
fn main() {
    if status.failed != 0u || contact_state.done != 0u {
        return;
    }
    contact_state.cg_batches += 1u;
    let is_solved = scalars.done != 0u || scalars.iterations >= params.max_iterations;
    status.solving = select(1u, 0u, is_solved);
}
