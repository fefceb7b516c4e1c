//! The adjoint of the static equilibrium of a body: one solve with the transposed tangent of its
//! static forces.
//!
//! With the residual R(u) = −f(u), K = ∂R/∂u and a quantity Q, K z = ∂Q/∂u on the free degrees of
//! freedom; then dQ = z·df for any change of the forces at fixed u. A quantity that is itself a
//! force, d·f on some nodes, adds d to z at these nodes.

use super::CpuBody;
use super::tangent::Tangent;
use crate::Result;
use crate::physics::cpu::contact::contact_derivatives::WeightDerivatives;
use crate::physics::cpu::elements::muscle::MuscleTerm;
use crate::physics::cpu::implicit::contact_terms::{self_contact, tool_contact};
use crate::physics::cpu::rigid::pose::PROXY_NODES;
use crate::physics::cpu::runtime::static_adjoint::{
    AdjointSeed, AdjointSolution, StaticAdjoint, ToolSlopes,
};
use crate::physics::cpu::term::{StateRef, Term};
use crate::physics::cpu::vectors::{V4, add, scale, sub, to_dvec, to_v4, zero};
use glam::DVec3;
use std::any::Any;
use std::sync::Arc;

/// The right-hand side of an adjoint solve, and the nodes whose forces the quantity sums.
pub(super) struct SeedVectors {
    /// ∂Q/∂u of every slot, in local units.
    pub by_position: Vec<V4<f64>>,
    /// Factors of the forces of terms and of loads on every slot, if Q sums both.
    both: Vec<V4<f64>>,
    /// The same, if it sums the forces of terms alone.
    terms_only: Vec<V4<f64>>,
}

impl StaticAdjoint for CpuBody<f64> {
    fn adjoint(&mut self, seed: &AdjointSeed) -> Result<AdjointSolution> {
        let plan = Arc::clone(&self.plan);
        plan.in_pool(|| {
            let mut tangent = self.linearise_static(seed.parts);
            self.solve_adjoint(&mut tangent, seed)
        })
    }
}

impl CpuBody<f64> {
    /// Returns the derivatives of a quantity by the positions at the current state, at constant
    /// forces of the adjoint; those of friction are not among them. Only a quantity that sums forces of nodes needs the tangent.
    pub(super) fn seed_vectors(
        &self,
        tangent: Option<&Tangent>,
        seed: &AdjointSeed,
    ) -> SeedVectors {
        let slots = self.state.u.len();
        // By displacements in local units.
        let mut rhs = self.to_slots(&seed.gradient, 1.0 / self.units.length);
        let mut both = vec![zero(); slots];
        if let Some((nodes, direction)) = &seed.reaction {
            for v in nodes {
                both[self.engine_index[*v as usize] as usize] = to_v4(*direction);
            }
        }
        // A quantity in N is 1/unit of force in local units.
        let force = self.units.force();
        let mut terms_only = vec![zero(); slots];
        if let (Some((b, direction)), Some(newton)) = (&seed.region, &self.newton) {
            let body = &newton.rigid.bodies[*b];
            terms_only[body.nodes.start..body.nodes.end - PROXY_NODES].fill(to_v4(*direction));
        }
        for (p, with_loads) in [(&both, true), (&terms_only, false)] {
            let Some(tangent) = tangent.filter(|_| p.iter().any(|p| *p != [0.0; 4])) else {
                continue;
            };
            let y = self.multiply_tangent(tangent, p, with_loads);
            for (rhs, y) in rhs.iter_mut().zip(y) {
                *rhs = sub(*rhs, scale(force, y));
            }
        }
        let contact = tool_contact(&self.terms);
        if let (Some(tool), Some(contact)) = (seed.tool, contact) {
            for (i, g) in contact.tool_force_gradient(&self.state.u, tool) {
                rhs[i] = add(rhs[i], to_v4(force * g));
            }
        }
        SeedVectors {
            by_position: rhs,
            both,
            terms_only,
        }
    }

    /// Returns the derivatives by forces and by what the engine alone has, with friction at
    /// `velocities` if there are any: λ, here from forces in
    /// local units, is `z` plus the factors of forces that the quantity sums.
    pub(super) fn derivatives_of_seed(
        &self,
        vectors: &SeedVectors,
        (z, velocities): (&[V4<f64>], Option<&[V4<f64>]>),
        seed: &AdjointSeed,
    ) -> AdjointSolution {
        let force = self.units.force();
        let sum = |a: &[V4<f64>], b: &[V4<f64>]| -> Vec<V4<f64>> {
            let all = a.iter().zip(b);
            all.map(|(a, b)| add(*a, scale(force, *b))).collect()
        };
        let loads = sum(z, &vectors.both);
        let terms = sum(&loads, &vectors.terms_only);
        self.collect_derivatives([&terms, &loads], (&self.state.u, velocities), seed)
    }

    /// Solves for the derivatives of the quantity, here by forces and displacements in local units.
    fn solve_adjoint(&self, tangent: &mut Tangent, seed: &AdjointSeed) -> Result<AdjointSolution> {
        let vectors = self.seed_vectors(Some(tangent), seed);
        let b = self.restrict_forces(&vectors.by_position);
        let x = self.solve_freedoms(tangent, &b, "equilibrium")?;
        let z = self.prolong_freedoms(&x);
        let supports: Vec<V4<f64>> = {
            let y = self.multiply_tangent(tangent, &z, true);
            let left = vectors.by_position.iter().zip(y).zip(0..);
            let held = |i: usize| i < self.soft_nodes() && self.free_mask[i] == 0.0;
            left.map(|((g, y), i)| if held(i) { sub(*g, y) } else { zero() })
                .collect()
        };
        Ok(AdjointSolution {
            supports: self.to_network(&supports, 1.0 / self.units.length),
            iterations: tangent.iterations,
            ..self.derivatives_of_seed(&vectors, (&z, None), seed)
        })
    }

    /// Returns the solution in SI units, with the derivatives by what the engine alone has: for the
    /// derivatives `terms` and `loads` by the forces at the current state, with the loads at the
    /// displacements `loaded`, and with friction at `velocities` if there are any.
    pub(super) fn collect_derivatives(
        &self,
        [terms, loads]: [&[V4<f64>]; 2],
        (loaded, velocities): (&[V4<f64>], Option<&[V4<f64>]>),
        seed: &AdjointSeed,
    ) -> AdjointSolution {
        let units = self.units;
        let u = &self.state.u;
        let mut weights = WeightDerivatives::new(self.state.u.len());
        let mut tools = Vec::new();
        let mut faces = Vec::new();
        if let Some(contact) = tool_contact(&self.terms) {
            let force = seed.tool.map(|(tool, d)| (tool, units.force() * d));
            let mut slopes = contact.force_derivatives(u, terms, force, &mut weights);
            if let Some(v) = velocities {
                let to = (&mut weights, &mut slopes[..]);
                contact.add_friction_derivatives(StateRef { u, v }, terms, force, to);
            }
            tools.extend(slopes.iter().map(|d| ToolSlopes {
                translation: d.translation / units.length,
                rotation: d.rotation,
                gap: d.gap / units.length,
                friction: d.friction,
            }));
        }
        if let Some(term) = self_contact(&self.terms) {
            term.add_weight_derivatives(u, terms, &mut weights);
            if let Some(v) = velocities {
                term.add_friction_weights(StateRef { u, v }, terms, &mut weights);
            }
            faces = weights.of_faces(term.surface.hull());
        } else if let Some(contact) = tool_contact(&self.terms) {
            faces = weights.of_faces(&contact.hull);
        }
        faces.iter_mut().for_each(|f| *f /= units.force());
        AdjointSolution {
            amplitudes: (0..seed.amplitudes)
                .map(|level| {
                    let levels = (level, seed.amplitudes);
                    self.amplitude_derivative(levels, [terms, loads], loaded)
                })
                .collect(),
            terms: self.to_network(terms, 1.0 / units.force()),
            loads: self.to_network(loads, 1.0 / units.force()),
            supports: vec![DVec3::ZERO; self.node_count()],
            tools,
            faces,
            static_speed: weights.static_speed / units.velocity(),
            ..AdjointSolution::default()
        }
    }

    /// Returns the derivative by the amplitude of index `level` of `count`: λ times the forces of
    /// unit pressure at the displacements `loaded`, and of full activation.
    fn amplitude_derivative(
        &self,
        (level, count): (usize, usize),
        [terms, loads]: [&[V4<f64>]; 2],
        loaded: &[V4<f64>],
    ) -> f64 {
        let mut levels = vec![0.0; count];
        levels[level] = 1.0;
        let u = &self.state.u;
        let mut pressures = vec![zero(); u.len()];
        self.loads
            .add_pressures_at(&self.plan, &levels, loaded, &mut pressures);
        let mut muscles = vec![zero(); u.len()];
        for term in &self.terms {
            let term: &dyn Any = term.as_ref();
            let Some(muscle) = term.downcast_ref::<MuscleTerm<f64>>() else {
                continue;
            };
            let mut full = muscle.clone();
            full.set_amplitudes(&levels);
            for chunk in 0..self.plan.chunks() {
                full.elastic_forces(chunk, u, &mut muscles[self.plan.range(chunk)]);
            }
        }
        let work = |f: &[V4<f64>], lambda: &[V4<f64>]| -> f64 {
            let all = f.iter().zip(lambda);
            all.map(|(f, l)| to_dvec(*f).dot(to_dvec(*l))).sum()
        };
        work(&pressures, loads) + work(&muscles, terms)
    }
}
