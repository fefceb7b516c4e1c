// Fixed corotated material (Stomakhin et al. 2012, "Energetically Consistent Invertible
// Elasticity", section 3.4): Ψ = μ |F − R|² + λ/2 (J − 1)², R the rotation of F = R S, det R = 1.
// Crushed elements are stiffened; see `physics::model::elements`.
#term law

#import lib/finite_elements
#import lib/energy_hessian

// Lower bound of the denominator of the twist eigenvalues: the energy has a ridge where σ_i = −σ_j.
const MIN_TWIST_DENOMINATOR: f32 = 1e-4;

fn corotated_energy(g: mat3x3<f32>, mu: f32, lambda: f32) -> f32 {
    let strain = polar(g).strain;
    let j = volume_change(g, cofactor(g));
    return mu * double_dot(strain, strain) + volumetric_energy(j, mu, lambda);
}

fn corotated_stress(g: mat3x3<f32>, mu: f32, lambda: f32) -> mat3x3<f32> {
    let decomposition = polar(g);
    let c = cofactor(g);
    let pressure = volumetric_derivatives(volume_change(g, c), mu, lambda).x;
    let volumetric_stress = pressure * (unit_matrix() + cofactor_minus_identity(g, c));
    return 2.0 * mu * decomposition.rotation * decomposition.strain + volumetric_stress;
}

fn corotated_curvature(e: vec3<f32>, mu: f32, lambda: f32) -> PrincipalHessian {
    let s = vec3(1.0) + e;
    let cofactors_and_j = cofactors_and_det(e);
    let cofactors = cofactors_and_j.xyz;
    let volumetric = volumetric_derivatives(cofactors_and_j.w, mu, lambda);
    let pressure = volumetric.x;
    let off_diagonal = volumetric.y * cofactors.yzx * cofactors.zxy + pressure * s;
    let diagonal = 2.0 * mu + volumetric.y * cofactors * cofactors;
    // 1 − 2/(σ_i + σ_j).
    let pairs = e.yzx + e.zxy;
    let sums = vec3(2.0) + pairs;
    let denominators = select(min(sums, vec3(-MIN_TWIST_DENOMINATOR)), max(sums, vec3(MIN_TWIST_DENOMINATOR)), sums >= vec3(0.0));
    return PrincipalHessian(
        mat3x3(diagonal.x, off_diagonal.z, off_diagonal.y, off_diagonal.z, diagonal.y, off_diagonal.x, off_diagonal.y, off_diagonal.x, diagonal.z),
        2.0 * mu - pressure * s,
        2.0 * mu * pairs / denominators + pressure * s,
    );
}
