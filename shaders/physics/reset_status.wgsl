// Clears a failure and an unfinished solve after the host changed the state.

#import lib/status

@group(0) @binding(0) var<storage, read_write> status: Status;

@compute @workgroup_size(1)
fn main() {
    status.failed = 0u;
    status.solving = 0u;
    status.iterations = 0u;
    status.residual = 0.0;
}
