// Checks a candidate state: all values must be finite, the energy must not exceed the initial
// energy plus the external work by too much, and no tet may be inverted unless one was before. One
// workgroup.

#import lib/workgroup_sum
#import lib/status

struct CheckParams {
    // 0: a step; 1: forces at the current state, before steps; 2: as 1, after the state was changed
    // by the host.
    kind: u32,
    // Number of workgroups that wrote a partial sum.
    groups: u32,
    // Length of the history.
    history: u32,
    dt: f32,
    // Energy below which no state counts as a runaway.
    floor: f32,
    // Maximum ratio of the energy to the initial energy plus the external work.
    factor: f32,
    // 1 if a step may invert tets.
    allow_inversion: u32,
    _pad0: u32,
}

@group(0) @binding(0) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> status: Status;
// For each step: iterations, residual, kinetic and elastic energy.
@group(0) @binding(2) var<storage, read_write> history: array<vec4<f32>>;
@group(0) @binding(3) var<uniform> params: CheckParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    var sum = vec4(0.0);
    for (var k = lane; k < params.groups; k += WORKGROUP) {
        sum += partials[k];
    }
    let total = reduce(sum, lane);
    if lane != 0u || status.failed != 0u {
        return;
    }
    status.accepted = 0u;
    if status.solving != 0u {
        return;
    }
    let energy = total.x + total.y;
    let work = abs(total.z * params.dt);
    if !finite(energy) || !finite(work) || !finite(total.w) || total.w >= NON_FINITE_WEIGHT {
        status.failed = NON_FINITE;
        return;
    }
    let inverted = u32(total.w > 0.0);
    if params.kind == 2u {
        status.baseline = energy;
        status.work = 0.0;
    }
    if params.kind == 0u {
        let allowed = status.baseline + status.work + work;
        if energy > params.factor * (allowed + params.floor) {
            status.failed = RUNAWAY_ENERGY;
            return;
        }
        if inverted > status.inverted && params.allow_inversion == 0u {
            status.failed = INVERTED_TETS;
            return;
        }
        status.work += work;
        history[status.steps % params.history] =
            vec4(f32(status.iterations), status.residual, total.x, total.y);
        status.steps += 1u;
        status.accepted = 1u;
    }
    status.inverted = inverted;
    status.kinetic = total.x;
    status.elastic = total.y;
}
