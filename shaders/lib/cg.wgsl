// The scalars of conjugate gradients, as every workgroup sees them.

#import lib/reduce
#import lib/status

struct CgScalars {
    // r·z now and at the start, and the value of it that is as good as zero.
    rz: f32,
    rz_start: f32,
    rz_floor: f32,
    iterations: u32,
    // 1: the tolerance is met; 2: the matrix or the numbers gave out.
    done: u32,
    _pad0: u32,
    _pad1: u32,
    _pad2: u32,
}

const CONVERGED: u32 = 1u;
const BREAKDOWN: u32 = 2u;

struct CgParams {
    nodes: u32,
    // Workgroups that wrote a partial sum.
    groups: u32,
    max_iterations: u32,
    // Squares of the relative residuals to reach, and to call a failure when it is not reached.
    tolerance: f32,
    acceptable: f32,
    // Square of the change of velocity that is as good as none.
    negligible: f32,
    // h α, where a force −α m v slows every node.
    drag: f32,
    // Workgroups that wrote one of r·z for rigid bodies, after those.
    rigid_groups: u32,
}

// The 3×3 symmetric matrix with the rows (a.x a.y a.z), (a.y a.w b.x), (a.z b.x b.y), times v.
fn sym_mul(a: vec4<f32>, b: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return vec3(dot(a.xyz, v), dot(vec3(a.y, a.w, b.x), v), dot(vec3(a.z, b.x, b.y), v));
}
