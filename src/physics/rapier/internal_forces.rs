//! Nodal forces of rapier's material law in float64; rapier itself does not report them.

use super::soft_body_model::damping_times;
use crate::physics::model::elements::polar_decomposition;
use crate::physics::{ConstitutiveModel, DiscreteModel, Element};
use glam::{DMat3, DVec3};

/// Time step in s, to both sides, of the central difference of forces along the velocities, from
/// which damping forces are computed.
const FINITE_DIFFERENCE_STEP: f64 = 1e-6;

/// Returns the forces of the tets of `model` and of their damping on all nodes at `x` (m) with
/// velocities `v` (m/s), N.
pub(super) fn internal_forces(model: &DiscreteModel, x: &[DVec3], v: &[DVec3]) -> Vec<DVec3> {
    let mut forces = vec![DVec3::ZERO; x.len()];
    let Some(elements) = model.elements() else {
        return forces;
    };
    let law = elements.law;
    let damping_times = damping_times(model, elements);
    for (tet, damping) in elements.tets.iter().zip(damping_times) {
        let at = tet.node_positions(x);
        let mut pull = corner_forces(tet, law, &at);
        if damping > 0.0 {
            let speed = tet.node_positions(v);
            let moved = |by: f64| std::array::from_fn(|k| at[k] + by * speed[k]);
            let ahead = corner_forces(tet, law, &moved(FINITE_DIFFERENCE_STEP));
            let behind = corner_forces(tet, law, &moved(-FINITE_DIFFERENCE_STEP));
            for (k, f) in pull.iter_mut().enumerate() {
                *f += damping * (ahead[k] - behind[k]) / (2.0 * FINITE_DIFFERENCE_STEP);
            }
        }
        for (node, f) in tet.nodes.iter().zip(pull) {
            forces[*node as usize] += f;
        }
    }
    for ((f, m), v) in forces.iter_mut().zip(&model.masses).zip(v) {
        *f -= elements.mass_damping * *m * *v;
    }
    forces
}

/// Returns the forces of a tet on its corners, N. rapier's corotated law is linear in the stretch,
/// without our volume term.
fn corner_forces(tet: &Element, law: ConstitutiveModel, corners: &[DVec3; 4]) -> [DVec3; 4] {
    let f = tet.deformation_gradient(corners);
    let [mu, lambda] = tet.small_strain(law);
    let stress = match law {
        ConstitutiveModel::NeoHookean => {
            f * mu + tet.cofactor(corners) * ((lambda + mu) * (f.determinant() - 1.0) - mu)
        }
        ConstitutiveModel::Corotated => {
            let (turn, stretch) = polar_decomposition(&f);
            let strain = stretch - DMat3::IDENTITY;
            let trace = strain.x_axis.x + strain.y_axis.y + strain.z_axis.z;
            turn * (strain * (2.0 * mu) + DMat3::IDENTITY * (lambda * trace))
        }
    };
    tet.gradients().map(|g| stress * g * -tet.volume)
}
