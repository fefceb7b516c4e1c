//! Static nodal forces of a discrete model, and nodal stiffnesses, in float64.

use super::discrete_model::DiscreteModel;
use super::discretisation::Discretisation;
use super::node_term::NodeTerm;
use glam::DVec3;
use std::sync::Arc;

impl DiscreteModel {
    /// Returns the elastic forces on the nodes at `x` (m) and those of `terms`, without damping, N.
    pub(in crate::physics) fn static_forces(
        &self,
        x: &[DVec3],
        terms: &[Arc<dyn NodeTerm>],
    ) -> Vec<DVec3> {
        let mut forces = match &self.discretisation {
            Discretisation::Springs(_) => self.spring_forces(x),
            Discretisation::Elements(elements) => elements.forces(x),
        };
        for ((f, m), x) in forces.iter_mut().zip(&self.masses).zip(x) {
            *f += terms.iter().map(|term| term.force(*m, *x)).sum::<DVec3>();
        }
        forces
    }

    fn spring_forces(&self, x: &[DVec3]) -> Vec<DVec3> {
        let mut forces = vec![DVec3::ZERO; x.len()];
        for spring in &self.edges {
            let [a, b] = spring.nodes.map(|v| v as usize);
            let d = x[b] - x[a];
            let f = spring.stiffness * (d.length() - spring.length) * d.normalize_or_zero();
            forces[a] += f;
            forces[b] -= f;
        }
        forces
    }

    /// Returns an upper bound of the stiffness of every node with its neighbours fixed at rest,
    /// N/m.
    pub(in crate::physics) fn nodal_stiffness(&self) -> Vec<f64> {
        let mut stiffness = vec![0.0; self.rest_positions.len()];
        match &self.discretisation {
            Discretisation::Springs(_) => {
                for spring in &self.edges {
                    for v in spring.nodes {
                        stiffness[v as usize] += spring.stiffness;
                    }
                }
            }
            Discretisation::Elements(elements) if elements.order() == 2 => {
                for (t, tet) in elements.tets.iter().enumerate() {
                    let [mu, lambda] = tet.lame_parameters;
                    let Some(shape) = elements.quadratic_shape(t) else {
                        continue;
                    };
                    for (gradients, volume) in shape.gradients.iter().zip(shape.volumes) {
                        for (v, g) in elements.nodes_of(t).zip(gradients) {
                            stiffness[v as usize] +=
                                (2.0 * mu + lambda) * volume * g.length_squared();
                        }
                    }
                }
            }
            Discretisation::Elements(elements) => {
                for tet in &elements.tets {
                    let [mu, lambda] = tet.lame_parameters;
                    for (v, g) in tet.nodes.iter().zip(tet.gradients()) {
                        stiffness[*v as usize] +=
                            (2.0 * mu + lambda) * tet.volume * g.length_squared();
                    }
                }
            }
        }
        stiffness
    }
}
