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
    return mu * double_dot(strain, strain) + volume_energy(j, mu, lambda);
}

fn corotated_stress(g: mat3x3<f32>, mu: f32, lambda: f32) -> mat3x3<f32> {
    let parts = polar(g);
    let c = cofactor(g);
    let pressure = volume_stress(volume_change(g, c), mu, lambda).x;
    let volume = pressure * (unit_matrix() + cofactor_differential(g, c));
    return 2.0 * mu * parts.rotation * parts.strain + volume;
}

fn corotated_curvature(e: vec3<f32>, mu: f32, lambda: f32) -> PrincipalHessian {
    let s = vec3(1.0) + e;
    let volume = cofactors_and_det(e);
    let by = volume.xyz;
    let stress = volume_stress(volume.w, mu, lambda);
    let pressure = stress.x;
    let off = stress.y * by.yzx * by.zxy + pressure * s;
    let on = 2.0 * mu + stress.y * by * by;
    // 1 − 2/(σ_i + σ_j).
    let pairs = e.yzx + e.zxy;
    let sums = vec3(2.0) + pairs;
    let held = select(min(sums, vec3(-MIN_TWIST_DENOMINATOR)), max(sums, vec3(MIN_TWIST_DENOMINATOR)), sums >= vec3(0.0));
    return PrincipalHessian(
        mat3x3(on.x, off.z, off.y, off.z, on.y, off.x, off.y, off.x, on.z),
        2.0 * mu - pressure * s,
        2.0 * mu * pairs / held + pressure * s,
    );
}
