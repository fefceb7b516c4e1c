//! A deformable body on the CPU: its state, its loads, and steps of any scheme.

mod constraints;
mod create;
pub(super) mod exact_positions;
pub(super) mod explicit;
pub(super) mod force_assembly;
mod force_balance;
mod freedoms;
pub(super) mod implicit_step;
mod motion_adjoint;
#[cfg(test)]
mod quadratic_load_tests;
#[cfg(test)]
mod quadratic_muscle_tests;
pub(super) mod rigid;
mod rigid_adjoint;
#[cfg(test)]
pub(super) mod scaled_load_tests;
pub(super) mod simulator;
pub(super) mod state;
mod static_adjoint;
pub(super) mod step;
mod step_adjoint;
mod steppable;
mod tangent;
#[cfg(test)]
pub(super) mod tests;
pub(super) mod tets;
pub(super) mod tools;

use super::elements::muscle::MuscleTerm;
use super::external_loads::ExternalLoads;
use super::implicit::linear_step::LinearStepSolver;
use super::implicit::newton::NewtonSolver;
use super::node_constraints::NodeConstraint;
use super::partition::Partition;
use super::pressure::{LoadedFace, Pressure};
use super::runtime::energy_guard::EnergyGuard;
use super::runtime::inversion::InversionCheck;
use super::scalar::Real;
use super::term::{StateRef, Term};
use super::vectors::{V4, from_metres, to_metres, zero};
use crate::physics::{DiscreteModel, LocalUnits, Muscle, SolverKind};
use crate::{Error, Result};
use force_assembly::ForceSources;
use glam::DVec3;
use std::sync::Arc;

/// A deformable body stepped on the CPU with scalars of type `T`: f32 for speed, f64 for accuracy.
///
/// Inputs and outputs are in the network's node order and SI units, with positions in metres from
/// the origin of the network's frame. Internally, the body stores displacements from rest in local
/// units ([`LocalUnits`]) and its own node order, so that f32 keeps its precision.
pub struct CpuBody<T: Real> {
    pub(super) kind: SolverKind,
    pub(super) units: LocalUnits,
    /// Rest positions in the network's order, m; then those of the proxy nodes of rigid bodies.
    pub(super) rest: Vec<DVec3>,
    /// The network's index of the engine's k-th node, and the inverse.
    pub(super) node_order: Vec<u32>,
    pub(super) engine_index: Vec<u32>,
    pub(super) plan: Arc<Partition>,
    pub(super) rest_local: Vec<V4<T>>,
    pub(super) masses: Vec<T>,
    pub(super) inverse_masses: Vec<T>,
    pub(super) free_mask: Vec<T>,
    pub(super) pinned: Vec<bool>,
    pub(super) attachments: Vec<NodeConstraint>,
    /// Constrained nodes that move to their positions in the next step.
    pub(super) moving_constraints: Vec<(usize, V4<T>)>,
    pub(super) gravity: DVec3,
    pub(super) external: Vec<DVec3>,
    pub(super) loads: ExternalLoads<T>,
    pub(super) terms: Vec<Box<dyn Term<T>>>,
    pub(super) state: KinematicState<T>,
    pub(super) next: KinematicState<T>,
    pub(super) implicit: Option<LinearStepSolver<T>>,
    /// For implicit bodies with elements.
    pub(super) newton: Option<NewtonSolver<T>>,
    pub(super) guard: EnergyGuard,
    pub(super) inversion: InversionCheck,
    pub(super) start: ForceStatus,
    /// Length of the last step, local units; 0 if the scheme restarts.
    pub(super) previous_dt: f64,
    pub(super) steps: u64,
}

/// A state and its forces, in local units.
#[derive(Clone, Debug, Default)]
pub(super) struct KinematicState<T> {
    pub u: Vec<V4<T>>,
    pub v: Vec<V4<T>>,
    /// For velocity Verlet: the velocities at which the forces were evaluated.
    pub damping_velocities: Vec<V4<T>>,
    pub f: Vec<V4<T>>,
}

/// Required work before the next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum ForceStatus {
    /// No work.
    Ready,
    /// The forces must be recomputed: the loads have changed.
    Resume,
    /// The forces must be recomputed and schemes restart: the state was set from outside.
    Restart,
}

impl<T: Real> CpuBody<T> {
    /// Returns the scheme.
    pub fn kind(&self) -> SolverKind {
        self.kind
    }

    /// Returns the number of nodes.
    pub fn node_count(&self) -> usize {
        self.pinned.len()
    }

    /// Returns the number of chunks of the partition.
    pub fn chunk_count(&self) -> usize {
        self.plan.chunks()
    }

    /// Returns the layout that a term is made for: node order, units and partition.
    pub fn layout(&self) -> (&[u32], LocalUnits, &Partition) {
        (&self.node_order, self.units, &self.plan)
    }

    /// Adds a term made for the partition, order and units of this body. Schemes restart.
    pub fn add_term(&mut self, term: Box<dyn Term<T>>) {
        self.terms.push(term);
        self.start = ForceStatus::Restart;
        if let Some(implicit) = &mut self.implicit {
            implicit.drop_coarse_space();
        }
    }

    /// Sets whether steps may invert tets.
    pub fn set_inversion_allowed(&mut self, allowed: bool) {
        self.inversion.allowed = allowed;
    }

    /// Sets gravity, m/s².
    pub fn set_gravity(&mut self, gravity: DVec3) {
        self.gravity = gravity;
        self.loads.set_gravity(gravity, &self.units);
        self.invalidate(ForceStatus::Resume);
    }

    /// Sets the external force on every node, N.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of forces or one that is not finite.
    pub fn set_forces(&mut self, forces: &[DVec3]) -> Result<()> {
        self.check_vectors("forces", forces)?;
        self.external.copy_from_slice(forces);
        match &self.newton {
            Some(newton) if !newton.rigid.is_empty() => {
                let mut all = forces.to_vec();
                all.resize(self.rest.len(), DVec3::ZERO);
                newton
                    .rigid
                    .transfer_to_carriers(&mut all, &self.node_order);
                self.loads.set_forces(&all, &self.node_order, &self.units);
            }
            _ => self.loads.set_forces(forces, &self.node_order, &self.units),
        }
        self.invalidate(ForceStatus::Resume);
        Ok(())
    }

    /// Adds pressure on faces with the amplitude of index `level`.
    pub fn add_pressure(&mut self, faces: &[LoadedFace], level: usize) {
        let nodes = (&self.engine_index[..], &self.rest[..]);
        let pressure = Pressure::new(faces, level, nodes, &self.units, &self.plan);
        self.loads.add_pressure(pressure);
        self.invalidate(ForceStatus::Resume);
    }

    /// Adds a muscle of `network`, the model of this body, with the amplitude of index `level`.
    pub fn add_muscle(
        &mut self,
        muscle: &Muscle,
        level: usize,
        (network, tets): (&DiscreteModel, &[[u32; 4]]),
    ) {
        let with = (&self.engine_index[..], self.units, &*self.plan);
        let fibres = MuscleTerm::new(muscle, level, (network, tets), with);
        self.add_term(Box::new(fibres));
    }

    /// Sets the amplitudes of pressures (Pa) and muscles (activation).
    pub fn set_levels(&mut self, levels: &[f64]) {
        self.loads.set_levels(levels);
        self.terms.iter_mut().for_each(|t| t.set_amplitudes(levels));
        if let Some(implicit) = &mut self.implicit {
            implicit.levels.clear();
            implicit.levels.extend_from_slice(levels);
        }
        self.invalidate(ForceStatus::Resume);
    }

    pub(super) fn invalidate(&mut self, start: ForceStatus) {
        self.start = self.start.max(start);
    }

    /// Returns the positions, m from the frame's origin.
    pub fn positions(&self) -> Vec<DVec3> {
        let nodes = self.rest.iter().zip(&self.engine_index);
        let mut positions: Vec<DVec3> = nodes
            .take(self.node_count())
            .map(|(x, k)| *x + to_metres(self.state.u[*k as usize], self.units.length))
            .collect();
        self.write_exact_positions(&mut positions);
        positions
    }

    /// Returns the velocities, m/s; for Verlet, the mean over the last step.
    pub fn velocities(&self) -> Vec<DVec3> {
        let places = self.engine_index.iter().take(self.node_count());
        places
            .map(|k| to_metres(self.state.v[*k as usize], self.units.velocity()))
            .collect()
    }

    /// Returns the force on every slot at the current displacements and the velocities `v`, local
    /// units.
    fn forces_at(&self, v: &[V4<T>]) -> Vec<V4<T>> {
        let mut forces = vec![zero(); self.engine_index.len()];
        let sources = ForceSources {
            plan: &self.plan,
            masses: &self.masses,
            loads: &self.loads,
            terms: &self.terms,
        };
        let at = StateRef {
            u: &self.state.u,
            v,
        };
        sources.forces(at, &mut forces);
        forces
    }

    /// Returns the force on every node at the current state, N: terms with damping, and loads.
    pub fn forces(&self) -> Vec<DVec3> {
        let forces = self.plan.in_pool(|| self.forces_at(&self.state.v));
        let places = self.engine_index.iter().take(self.node_count());
        places
            .map(|k| to_metres(forces[*k as usize], self.units.force()))
            .collect()
    }

    /// Sets node positions (m from the frame's origin) and velocities (m/s); fixed nodes are at
    /// rest. Schemes restart.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of vectors or one that is not finite.
    pub fn set_state(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        self.check_vectors("positions", positions)?;
        self.check_vectors("velocities", velocities)?;
        let units = self.units;
        for (k, v) in self.node_order.iter().enumerate() {
            let v = *v as usize;
            // Nodes outside the network are the proxy nodes of rigid bodies.
            let Some(position) = positions.get(v) else {
                continue;
            };
            self.state.u[k] = from_metres(*position - self.rest[v], units.length);
            self.state.v[k] = match self.free_mask[k] > T::ZERO {
                true => from_metres(velocities[v], units.velocity()),
                false => zero(),
            };
        }
        self.fit_rigid_bodies(positions, velocities);
        self.invalidate(ForceStatus::Restart);
        Ok(())
    }

    pub(super) fn check(&self, what: &str, given: usize) -> Result<()> {
        match given == self.node_count() {
            true => Ok(()),
            false => Err(Error::Input(format!(
                "got {given} {what} for a body of {} nodes",
                self.node_count()
            ))),
        }
    }

    fn check_vectors(&self, what: &str, given: &[DVec3]) -> Result<()> {
        self.check(what, given.len())?;
        match given.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(i) => Err(Error::Input(format!(
                "the {what} of node {i} are not finite"
            ))),
        }
    }
}
