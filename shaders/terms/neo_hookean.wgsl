// Stable Neo-Hookean material (Smith, de Goes & Kim 2018, "Stable Neo-Hookean Flesh Simulation",
// equation 13, without the barrier): Ψ = μ/2 (|F|² − 3) − μ (J − 1) + λ/2 (J − 1)². The parameter λ
// passed in is Lamé's λ + μ. Crushed elements are stiffened; see `physics::model::elements`.
//
// In terms of G = F − I the first-order terms cancel: |F|²/2 − 3/2 − (J − 1) is |G|²/2 − tr cof G −
// det G.
#term law

#import lib/finite_elements
#import lib/energy_hessian

fn neo_hookean_energy(g: mat3x3<f32>, mu: f32, lambda: f32) -> f32 {
    let c = cofactor(g);
    let j = volume_change(g, c);
    let shear = mu * (0.5 * double_dot(g, g) - trace(c) - dot(g[0], c[0]));
    return shear + volumetric_energy(j, mu, lambda);
}

fn neo_hookean_stress(g: mat3x3<f32>, mu: f32, lambda: f32) -> mat3x3<f32> {
    let c = cofactor(g);
    let cofactor_change = cofactor_minus_identity(g, c);
    let pressure = volumetric_derivatives(volume_change(g, c), mu, lambda).x;
    return mu * (g - cofactor_change) + pressure * (unit_matrix() + cofactor_change);
}

fn neo_hookean_curvature(e: vec3<f32>, mu: f32, lambda: f32) -> PrincipalHessian {
    let s = vec3(1.0) + e;
    let cofactors_and_j = cofactors_and_det(e);
    let cofactors = cofactors_and_j.xyz;
    let volumetric = volumetric_derivatives(cofactors_and_j.w, mu, lambda);
    let pressure = volumetric.x;
    let off_diagonal = volumetric.y * cofactors.yzx * cofactors.zxy + (pressure - mu) * s;
    let diagonal = mu + volumetric.y * cofactors * cofactors;
    return PrincipalHessian(
        mat3x3(diagonal.x, off_diagonal.z, off_diagonal.y, off_diagonal.z, diagonal.y, off_diagonal.x, off_diagonal.y, off_diagonal.x, diagonal.z),
        mu + mu * s - pressure * s,
        pressure * s - mu * e,
    );
}
