// GPU status of a run of steps, and the checks that stop it. Host side: `physics::gpu::status`.

const NON_FINITE: u32 = 1u;
const RUNAWAY_ENERGY: u32 = 2u;
const NOT_CONVERGED: u32 = 3u;
const EXCESS_PENETRATION: u32 = 4u;
const INVERTED_TETS: u32 = 5u;

struct Status {
    // 0, or one of the reasons above: all later passes do nothing.
    failed: u32,
    // 1 while a linear solve continues in the next passes.
    solving: u32,
    // 1 if the candidate state passed the checks.
    accepted: u32,
    // Steps completed since the solver was created.
    steps: u32,
    // Iterations and relative residual of the last linear solve.
    iterations: u32,
    residual: f32,
    // Energy at the start, and the accumulated |work| of the external forces.
    baseline: f32,
    work: f32,
    // Energies of the last checked state.
    kinetic: f32,
    elastic: f32,
    // 1 if the last checked state has inverted tets.
    inverted: u32,
    _pad0: u32,
}

// Weight of a node with non-finite values in the sum that otherwise counts inverted tets.
const NON_FINITE_WEIGHT: f32 = 1e30;

// Whether x is neither NaN nor infinite. Tests the bits, because comparisons with NaN are
// unreliable.
fn finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn finite3(v: vec3<f32>) -> bool {
    return finite(v.x) && finite(v.y) && finite(v.z);
}
