//! A deformable body on the CPU: its state, its loads, and steps of any scheme.

pub(super) mod exact_positions;
pub(super) mod explicit;
pub(super) mod force_assembly;
mod force_balance;
pub(super) mod implicit_step;
pub(super) mod rigid;
#[cfg(test)]
pub(super) mod scaled_load_tests;
pub(super) mod simulator;
pub(super) mod state;
pub(super) mod step;
mod steppable;
#[cfg(test)]
pub(super) mod tests;
pub(super) mod tools;

use super::aggregation::Aggregates;
use super::body::force_assembly::ForceSources;
use super::elements::muscle::MuscleTerm;
use super::elements::term::ElementTerm;
use super::implicit::contact_terms::self_contact;
use super::implicit::linear_step::LinearStepSolver;
use super::implicit::newton::NewtonSolver;
use super::implicit::schemes::ImplicitScheme;
use super::node_constraints::{Loads, NodeConstraint, check_attachments};
use super::partition::Partition;
use super::pressure::Pressure;
use super::rigid::layout::build_layout;
use super::rigid::target_springs::{RigidTargetSpring, RigidTargetSprings};
use super::runtime::energy_guard::EnergyGuard;
use super::runtime::inversion::InversionCheck;
use super::scalar::Real;
use super::springs::term::Springs;
use super::term::{StateRef, Term, find_term_mut};
use super::vectors::{V4, dot_f64, from_metres, sub, to_metres, zero};
use crate::physics::{CgSettings, DiscreteModel, LocalUnits, Muscle, SolverKind};
use crate::{Error, Result};
use glam::DVec3;
use std::sync::Arc;

/// Number of aggregates over the square root of the number of nodes, for small bodies. The
/// rigid-body modes of the aggregates span the coarse space: twice as many save a tenth of the
/// iterations, but make each more expensive.
const AGGREGATES_PER_SQRT_NODE: f64 = 3.0;

/// Above this number of aggregates it grows with the cube root of the number of nodes, with this
/// factor at least.
const CUBE_ROOT_AGGREGATES_FROM: f64 = 60.0;
const AGGREGATES_PER_CBRT_NODE: f64 = 3.5;

/// Default Newton tolerance of the midpoint rule.
const MIDPOINT_TOLERANCE: f64 = 1e-5;

/// Prescribed nodes that continue from within this fraction of the body's size of their positions
/// do not count as moved.
const CONTINUATION_DISTANCE: f64 = 1e-5;

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
    pub(super) loads: Loads<T>,
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
    /// Creates the body of `network` at rest, without pins or gravity, stepped by the scheme
    /// `kind`; `settings` are the stopping criteria of implicit linear solves. The nodes are
    /// partitioned into `chunks` chunks, or a suitable number.
    ///
    /// # Errors
    /// [`Error::Input`] for invalid settings or an invalid network.
    pub fn new(
        network: &DiscreteModel,
        kind: SolverKind,
        settings: CgSettings,
        chunks: Option<usize>,
    ) -> Result<CpuBody<T>> {
        let CgSettings {
            tolerance,
            acceptable,
            max_iterations,
        } = settings;
        if !(tolerance > 0.0 && tolerance < 1.0 && acceptable >= tolerance && max_iterations > 0) {
            return Err(Error::Input(format!(
                "invalid settings of conjugate gradients: tolerance {tolerance}, acceptable {acceptable}, {max_iterations} iterations; require 0 < tolerance < 1, tolerance ≤ acceptable and at least 1 iteration"
            )));
        }
        let nodes = network.rest_positions.len();
        let strange = |s: &crate::physics::Spring| s.nodes.iter().any(|v| *v as usize >= nodes);
        if network.masses.len() != nodes || network.springs.iter().any(strange) {
            return Err(Error::Input(format!(
                "a model of {nodes} nodes has {} masses, or springs to nodes that do not exist; give one mass per node and existing nodes",
                network.masses.len()
            )));
        }
        let elements = &network.elements;
        let strange = |e: &crate::physics::Element| e.nodes.iter().any(|v| *v as usize >= nodes);
        let damped = elements.mass_damping;
        if elements.tets.iter().any(strange) || !(damped >= 0.0 && damped.is_finite()) {
            return Err(Error::Input(format!(
                "a model of {nodes} nodes has elements of nodes that do not exist, or a mass damping of {damped} 1/s; give existing nodes and a finite mass damping ≥ 0"
            )));
        }
        let units = LocalUnits::from_model(network);
        let most = |nodes: usize| {
            let nodes = nodes as f64;
            let groups = (AGGREGATES_PER_SQRT_NODE * nodes.sqrt())
                .min(CUBE_ROOT_AGGREGATES_FROM)
                .max(AGGREGATES_PER_CBRT_NODE * nodes.cbrt());
            (nodes / groups).ceil() as usize
        };
        let real = nodes;
        let (network, lumps, rigid) = build_layout(network, kind, &units, most)?;
        let network = network.as_ref();
        let (nodes, elements) = (network.rest_positions.len(), &network.elements);
        let Aggregates {
            order,
            group_starts: starts,
        } = lumps;
        let mut place = vec![0u32; nodes];
        for (k, v) in order.iter().enumerate() {
            place[*v as usize] = k as u32;
        }
        let plan = match chunks {
            Some(chunks) => Partition::with_chunks(starts, chunks),
            None => Partition::new(starts),
        };
        let implicit = kind.is_implicit();
        if SolverKind::ELEMENT_ONLY.contains(&kind) && elements.is_empty() {
            return Err(kind.requires_elements_error());
        }
        let mut terms: Vec<Box<dyn Term<T>>> = Vec::new();
        // With elements, the springs only represent the edges of the mesh.
        if elements.is_empty() {
            terms.push(Box::new(Springs::new(network, &order, &units, &plan)));
        }
        if !elements.is_empty() {
            let with = (&order[..], units, &plan);
            terms.push(Box::new(ElementTerm::new(network, with, implicit)));
        }
        let newton = (implicit && !elements.is_empty()).then(|| {
            let own = settings.tolerance != CgSettings::default().tolerance;
            let newton = match (own, kind) {
                (true, _) => crate::physics::NewtonSettings::with_tolerance(settings.tolerance),
                // The midpoint rule does not damp the errors of an inexact solve.
                (false, SolverKind::Midpoint) => {
                    crate::physics::NewtonSettings::with_tolerance(MIDPOINT_TOLERANCE)
                }
                (false, _) => crate::physics::NewtonSettings::default(),
            };
            let rule = match kind {
                SolverKind::Bdf2 => ImplicitScheme::Bdf2,
                SolverKind::Midpoint => ImplicitScheme::Midpoint,
                _ => ImplicitScheme::Euler,
            };
            let mut minimiser = NewtonSolver::new(&plan, (newton, rule), damped * units.time);
            minimiser.rigid = rigid;
            minimiser
        });
        let seen = match kind {
            SolverKind::VelocityVerlet => nodes,
            _ => 0,
        };
        let motion = || KinematicState {
            u: vec![zero(); nodes],
            v: vec![zero(); nodes],
            damping_velocities: vec![zero(); seen],
            f: vec![zero(); plan.nodes()],
        };
        let mut implicit = implicit.then(|| LinearStepSolver::new(&plan, settings));
        if let (Some(implicit), Some(newton)) = (&mut implicit, &newton) {
            implicit.solver.rigid_projection = newton.rigid.projection(&plan);
        }
        let mut body = CpuBody {
            kind,
            units,
            rest: network.rest_positions.clone(),
            rest_local: order
                .iter()
                .map(|v| from_metres(network.rest_positions[*v as usize], units.length))
                .collect(),
            masses: order
                .iter()
                .map(|v| T::from_f64(network.masses[*v as usize] / units.mass))
                .collect(),
            inverse_masses: vec![T::ZERO; nodes],
            free_mask: vec![T::ZERO; nodes],
            pinned: vec![false; real],
            attachments: Vec::new(),
            moving_constraints: Vec::new(),
            gravity: DVec3::ZERO,
            external: vec![DVec3::ZERO; real],
            loads: Loads::empty(nodes),
            terms,
            newton,
            state: motion(),
            next: motion(),
            implicit,
            guard: EnergyGuard::default(),
            inversion: InversionCheck::default(),
            start: ForceStatus::Restart,
            previous_dt: 0.0,
            steps: 0,
            node_order: order,
            engine_index: place,
            plan: Arc::new(plan),
        };
        body.free_nodes();
        Ok(body)
    }

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

    /// Sets the pinned nodes, which stay at rest.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of flags.
    pub fn set_pinned(&mut self, pinned: &[bool]) -> Result<()> {
        self.check("pins", pinned.len())?;
        self.pinned.copy_from_slice(pinned);
        self.free_nodes();
        self.invalidate(ForceStatus::Resume);
        Ok(())
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

    /// Replaces the constraints and target springs of nodes. Constrained nodes are moved to their
    /// positions at once, or, with self-contact, in the next step up to the first collision;
    /// schemes restart, as after a change of the state.
    ///
    /// # Errors
    /// [`Error::Input`] for invalid attachments.
    pub fn set_attachments(&mut self, attachments: &[NodeConstraint]) -> Result<()> {
        check_attachments(attachments, self.node_count())?;
        let same_nodes = self.held().eq(held(attachments));
        self.attachments.clear();
        self.attachments.extend_from_slice(attachments);
        let (place, rest, units) = (&self.engine_index, &self.rest, &self.units);
        let rigid = self.newton.as_ref().map(|newton| &newton.rigid);
        // Target springs on rigid bodies are a separate term.
        let soft = |a: &&NodeConstraint| match a {
            NodeConstraint::Spring { node, .. } => !rigid
                .is_some_and(|rigid| rigid.is_target_spring_node(place[*node as usize] as usize)),
            _ => true,
        };
        let draws: Vec<NodeConstraint> = attachments.iter().filter(soft).copied().collect();
        self.loads.set_target_springs(&draws, place, rest, units);
        let tethers = rigid.map(|rigid| rigid.target_springs(attachments, (place, rest), units));
        self.set_target_springs(tethers.unwrap_or_default());
        if !same_nodes {
            self.free_nodes();
        }
        let gradually = self.newton.is_some() && self_contact(&self.terms).is_some();
        self.moving_constraints.clear();
        let mut goes_on = same_nodes && !attachments.is_empty();
        for a in attachments {
            let (node, to, velocity) = match *a {
                NodeConstraint::Fixed { node, place } => {
                    goes_on = false;
                    (node, place, DVec3::ZERO)
                }
                NodeConstraint::Prescribed {
                    node,
                    place,
                    velocity,
                } => (node, place, velocity),
                NodeConstraint::Spring { .. } => {
                    goes_on = false;
                    continue;
                }
            };
            let v = node as usize;
            let k = self.engine_index[v] as usize;
            let to = from_metres(to - self.rest[v], self.units.length);
            let off = sub(to, self.state.u[k]);
            if gradually && matches!(a, NodeConstraint::Fixed { .. }) {
                let rigid = self.newton.as_ref().and_then(|n| n.rigid.body_of(k));
                self.moving_constraints
                    .extend(rigid.is_none().then_some((k, to)));
                continue;
            }
            goes_on &= dot_f64(off, off) < CONTINUATION_DISTANCE * CONTINUATION_DISTANCE;
            self.state.u[k] = to;
            self.state.v[k] = from_metres(velocity, self.units.velocity());
        }
        self.apply_constraints(gradually);
        // Prescribed nodes that continue from their positions leave the history of schemes valid.
        self.invalidate(match goes_on {
            true => ForceStatus::Resume,
            false => ForceStatus::Restart,
        });
        Ok(())
    }

    fn set_target_springs(&mut self, tethers: Vec<RigidTargetSpring>) {
        let known: Option<&mut RigidTargetSprings<T>> = find_term_mut(&mut self.terms);
        if let Some(known) = known {
            known.set(tethers, &self.plan);
        } else if !tethers.is_empty() {
            let mut term = RigidTargetSprings::new(&self.plan);
            term.set(tethers, &self.plan);
            self.add_term(Box::new(term));
        }
    }

    /// Returns which nodes of the network are fixed.
    pub(super) fn fixed_nodes(&self) -> Vec<bool> {
        let mut stays = self.pinned.clone();
        for v in held(&self.attachments) {
            stays[v as usize] = true;
        }
        stays
    }

    /// Whether any node has a prescribed motion.
    pub(super) fn has_prescribed_motion(&self) -> bool {
        let led = |a: &NodeConstraint| matches!(a, NodeConstraint::Prescribed { velocity, .. } if *velocity != DVec3::ZERO);
        self.attachments.iter().any(led)
    }

    /// Adds pressure on faces, three nodes each, with the amplitude of index `level`.
    pub fn add_pressure(&mut self, faces: &[[u32; 3]], level: usize) {
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

    fn held(&self) -> impl Iterator<Item = u32> {
        held(&self.attachments)
    }

    /// Updates the free nodes.
    fn free_nodes(&mut self) {
        let stays = self.fixed_nodes();
        for (k, v) in self.node_order.iter().enumerate() {
            let m = self.masses[k];
            // A massless node has no equation of motion, so it is fixed.
            let over = T::ONE / m;
            let stay = stays.get(*v as usize).is_some_and(|stays| *stays);
            let free = !stay && m > T::ZERO && over.to_f64().is_finite();
            self.inverse_masses[k] = if free { over } else { T::ZERO };
            self.free_mask[k] = if free { T::ONE } else { T::ZERO };
            if !free {
                self.state.v[k] = zero();
            }
        }
        self.update_freedoms(&stays);
        if let Some(implicit) = &mut self.implicit {
            implicit.drop_coarse_space();
            implicit.clear_history();
        }
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

    /// Returns the force on every node at the current state, N: terms with damping, and loads.
    pub fn forces(&self) -> Vec<DVec3> {
        let mut forces = vec![zero(); self.engine_index.len()];
        let sources = ForceSources {
            plan: &self.plan,
            masses: &self.masses,
            loads: &self.loads,
            terms: &self.terms,
        };
        let at = StateRef {
            u: &self.state.u,
            v: &self.state.v,
        };
        self.plan.in_pool(|| sources.forces(at, &mut forces));
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

fn held(attachments: &[NodeConstraint]) -> impl Iterator<Item = u32> {
    attachments.iter().filter_map(|a| match a {
        NodeConstraint::Fixed { node, .. } | NodeConstraint::Prescribed { node, .. } => Some(*node),
        NodeConstraint::Spring { .. } => None,
    })
}
