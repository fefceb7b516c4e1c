// What the GPU knows of a run of steps, and the rule that freezes it. The twin of `physics::guard`.

const NON_FINITE: u32 = 1u;
const RUNAWAY_ENERGY: u32 = 2u;
const NOT_CONVERGED: u32 = 3u;
const PIERCED: u32 = 4u;

struct Status {
    // 0, or one of the reasons above: everything after does nothing.
    failed: u32,
    // 1 while a linear solve has to go on in the next passes.
    solving: u32,
    // 1 when the candidate state has passed the checks.
    accepted: u32,
    // Steps completed since the solver was made.
    steps: u32,
    // Iterations and relative residual of the last linear solve.
    iterations: u32,
    residual: f32,
    // Energy at the start, and the sum of |work| of the external forces since.
    baseline: f32,
    work: f32,
    // Energies of the last state checked.
    kinetic: f32,
    elastic: f32,
    _pad0: u32,
    _pad1: u32,
}

// Not NaN, not infinite, by the bits: comparisons with NaN cannot be relied on.
fn finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn finite3(v: vec3<f32>) -> bool {
    return finite(v.x) && finite(v.y) && finite(v.z);
}
