// Scalars of the conjugate gradient solver, as every workgroup reads them.

#import lib/workgroup_sum
#import lib/status

struct CgScalars {
    // r·z now and at the start, and the value below which it counts as zero.
    rz: f32,
    rz_start: f32,
    rz_floor: f32,
    iterations: u32,
    // 1: converged to the tolerance; 2: breakdown (indefinite matrix or non-finite numbers).
    done: u32,
    _pad0: u32,
    _pad1: u32,
    _pad2: u32,
}

const CONVERGED: u32 = 1u;
const BREAKDOWN: u32 = 2u;

struct CgParams {
    nodes: u32,
    // Number of workgroups that wrote a partial sum.
    groups: u32,
    max_iterations: u32,
    // Squared relative residuals: the convergence tolerance, and the limit above which the solve
    // counts as failed.
    tolerance: f32,
    acceptable: f32,
    // Square of the velocity change that counts as zero.
    negligible: f32,
    // h α, for mass-proportional damping with the force −α m v.
    drag: f32,
    // Number of workgroups that wrote a partial sum of r·z for rigid bodies, after the others.
    rigid_groups: u32,
}

// Returns the product of v and the symmetric 3×3 matrix with the rows (a.x a.y a.z), (a.y a.w b.x),
// (a.z b.x b.y).
fn sym_mul(a: vec4<f32>, b: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return vec3(dot(a.xyz, v), dot(vec3(a.y, a.w, b.x), v), dot(vec3(a.z, b.x, b.y), v));
}
