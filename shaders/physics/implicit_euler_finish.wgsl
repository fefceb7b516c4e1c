// Runs after the iterations recorded for a step: solved, to be continued, or failed. One workgroup.

#import lib/cg

@group(0) @binding(0) var<storage, read> rz_partials: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> scalars: CgScalars;
@group(0) @binding(2) var<storage, read_write> status: Status;
@group(0) @binding(3) var<uniform> params: CgParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    var share = vec4(0.0);
    for (var k = lane; k < params.groups + params.rigid_groups; k += WORKGROUP) {
        share += rz_partials[k];
    }
    let rz = reduce(share, lane).x;
    if lane != 0u || status.failed != 0u {
        return;
    }
    status.iterations = scalars.iterations;
    status.solving = 0u;
    if scalars.done == BREAKDOWN || !finite(rz) {
        status.failed = NON_FINITE;
        return;
    }
    status.residual = sqrt(max(rz, 0.0) / max(scalars.rz_start, 1e-37));
    let met = rz <= max(params.tolerance * scalars.rz_start, scalars.rz_floor);
    if scalars.done == CONVERGED || met {
        return;
    }
    if scalars.iterations < params.max_iterations {
        status.solving = 1u;
    } else if rz > params.acceptable * scalars.rz_start {
        status.failed = NOT_CONVERGED;
    }
}
