// Second derivatives of an isotropic energy by F = U Σ Vᵀ (projected SPD Hessian): Stomakhin et al.
// 2012, section 4; Smith, de Goes & Kim 2019, "Analytic Eigensystems for Isotropic Distortion
// Energies".
//
// In the frame of U and V the Hessian is a 3×3 matrix ∂²Ψ/∂σ_i∂σ_j that maps the diagonal of UᵀδF V
// to that of UᵀδP V, and for each pair of axes a flip eigenvalue (symmetric part) and a twist
// eigenvalue (antisymmetric part).

#import lib/polar

struct PrincipalHessian {
    // ∂²Ψ/∂σ_i∂σ_j.
    stretch: mat3x3<f32>,
    // For the pairs (1 2), (2 0), (0 1).
    flip: vec3<f32>,
    twist: vec3<f32>,
}

struct SvdFrame {
    u: mat3x3<f32>,
    v: mat3x3<f32>,
    // Σ − I.
    strain: vec3<f32>,
}

fn frame_of(g: mat3x3<f32>) -> SvdFrame {
    let parts = polar(g);
    let axes = eigen(parts.strain);
    return SvdFrame(parts.rotation * axes.vectors, axes.vectors, axes.values);
}

// Projects the Hessian to positive semidefinite by clamping negative eigenvalues to zero.
fn project_psd(given: PrincipalHessian) -> PrincipalHessian {
    var c = given;
    c.flip = max(c.flip, vec3(0.0));
    c.twist = max(c.twist, vec3(0.0));
    let m = c.stretch;
    let minor = m[0].x * m[1].y - m[0].y * m[0].y;
    if m[0].x > 0.0 && minor > 0.0 && determinant(m) > 0.0 {
        return c;
    }
    let parts = eigen(m);
    let values = max(parts.values, vec3(0.0));
    let v = parts.vectors;
    c.stretch = mat3x3(v[0] * values.x, v[1] * values.y, v[2] * values.z) * transpose(v);
    return c;
}

// Returns ∂J/∂σ and, in w, J − 1 at Σ = I + E.
fn cofactors_and_det(e: vec3<f32>) -> vec4<f32> {
    let pairs = e.x * e.y + e.y * e.z + e.z * e.x;
    let s = vec3(1.0) + e;
    return vec4(s.yzx * s.zxy, e.x + e.y + e.z + pairs + e.x * e.y * e.z);
}

// Returns the stress differential δP for the differential δF.
fn stress_differential(c: PrincipalHessian, frame: SvdFrame, change: mat3x3<f32>) -> mat3x3<f32> {
    let x = transpose(frame.u) * change * frame.v;
    let along = c.stretch * vec3(x[0].x, x[1].y, x[2].z);
    // Half of x_ij + x_ji and of x_ij − x_ji, for the pairs (1 2), (2 0), (0 1).
    let upper = vec3(x[2].y, x[0].z, x[1].x);
    let lower = vec3(x[1].z, x[2].x, x[0].y);
    let even = 0.5 * c.flip * (upper + lower);
    let odd = 0.5 * c.twist * (upper - lower);
    let up = even + odd;
    let low = even - odd;
    let y = mat3x3(
        along.x, low.z, up.y,
        up.z, along.y, low.x,
        low.y, up.x, along.z,
    );
    return frame.u * y * transpose(frame.v);
}
