//! Creation of a body from its model.

use super::{CpuBody, ForceStatus, KinematicState};
use crate::physics::cpu::elements::batch::TetBatch;
use crate::physics::cpu::elements::quadratic_batch::QuadraticBatch;
use crate::physics::cpu::elements::term::ElementTerm;
use crate::physics::cpu::external_loads::ExternalLoads;
use crate::physics::cpu::implicit::linear_step::LinearStepSolver;
use crate::physics::cpu::implicit::newton::NewtonSolver;
use crate::physics::cpu::implicit::schemes::ImplicitScheme;
use crate::physics::cpu::linear::linear_tet_nodes::LinearTetNodes;
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::rigid::layout::build_layout;
use crate::physics::cpu::runtime::energy_guard::EnergyGuard;
use crate::physics::cpu::runtime::inversion::InversionCheck;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::springs::term::Springs;
use crate::physics::cpu::term::Term;
use crate::physics::cpu::vectors::{from_metres, zero};
use crate::physics::simulator::messages::requires_elements_error;
use crate::physics::{
    CgSettings, DiscreteModel, Discretisation, Edge, LocalUnits, NewtonSettings, SolverKind,
};
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
        check_settings(settings)?;
        check_model(network)?;
        let units = LocalUnits::from_model(network);
        let count = network.rest_positions.len();
        let (network, aggregates, rigid) =
            build_layout(network, kind, &units, nodes_per_aggregate)?;
        let network = network.as_ref();
        if SolverKind::ELEMENT_ONLY.contains(&kind) && network.elements().is_none() {
            return Err(requires_elements_error(kind));
        }
        let (order, starts) = (aggregates.order, aggregates.group_starts);
        let plan = match chunks {
            Some(chunks) => Partition::with_chunks(starts, chunks),
            None => Partition::new(starts),
        };
        let elements = network.elements().filter(|_| kind.is_implicit());
        let newton = elements.map(|elements| {
            let damping = elements.mass_damping * units.time;
            let mut newton = NewtonSolver::new(&plan, newton_settings(kind, settings), damping);
            newton.rigid = rigid;
            newton
        });
        let engine_index = inverse_order(&order);
        let implicit = kind.is_implicit().then(|| {
            let mut implicit = LinearStepSolver::new(&plan, settings);
            if let Some(newton) = &newton {
                implicit.solver.rigid_projection = newton.rigid.projection(&plan);
            }
            let first_rigid = implicit.solver.rigid_projection.first_node();
            let linear_tets =
                elements.and_then(|e| LinearTetNodes::new(e, &engine_index, &plan, first_rigid));
            if let Some(nodes) = linear_tets {
                implicit.set_linear_tets(nodes);
            }
            implicit
        });
        let nodes = network.rest_positions.len();
        let state = KinematicState::at_rest(nodes, plan.nodes(), kind);
        let rest = |v: &u32| from_metres(network.rest_positions[*v as usize], units.length);
        let mass = |v: &u32| T::from_f64(network.masses[*v as usize] / units.mass);
        let mut body = CpuBody {
            kind,
            units,
            rest: network.rest_positions.clone(),
            rest_local: order.iter().map(rest).collect(),
            masses: order.iter().map(mass).collect(),
            inverse_masses: vec![T::ZERO; nodes],
            free_mask: vec![T::ZERO; nodes],
            pinned: vec![false; count],
            attachments: Vec::new(),
            moving_constraints: Vec::new(),
            gravity: DVec3::ZERO,
            external: vec![DVec3::ZERO; count],
            loads: ExternalLoads::empty(nodes),
            terms: vec![material_term(network, kind, (&order, units, &plan))],
            newton,
            next: state.clone(),
            state,
            implicit,
            guard: EnergyGuard::default(),
            inversion: InversionCheck::default(),
            start: ForceStatus::Restart,
            previous_dt: 0.0,
            steps: 0,
            engine_index,
            node_order: order,
            plan: Arc::new(plan),
        };
        body.free_nodes();
        Ok(body)
    }
}

impl<T: Real> KinematicState<T> {
    /// The rest state of a body with `nodes` nodes, of which the plan has `planned`.
    fn at_rest(nodes: usize, planned: usize, kind: SolverKind) -> KinematicState<T> {
        let damped = match kind {
            SolverKind::VelocityVerlet => nodes,
            _ => 0,
        };
        KinematicState {
            u: vec![zero(); nodes],
            v: vec![zero(); nodes],
            damping_velocities: vec![zero(); damped],
            f: vec![zero(); planned],
        }
    }
}

/// Checks the stopping criteria of linear solves.
fn check_settings(settings: CgSettings) -> Result<()> {
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
    Ok(())
}

/// Checks that the nodes of a model are there, and its mass damping.
fn check_model(network: &DiscreteModel) -> Result<()> {
    let nodes = network.rest_positions.len();
    let strange = |e: &Edge| e.nodes.iter().any(|v| *v as usize >= nodes);
    if network.masses.len() != nodes || network.edges.iter().any(strange) {
        return Err(Error::Input(format!(
            "a model of {nodes} nodes has {} masses, or edges to nodes that do not exist; give one mass per node and existing nodes",
            network.masses.len()
        )));
    }
    let Some(elements) = network.elements() else {
        return Ok(());
    };
    let strange = |t: usize| elements.nodes_of(t).any(|v| v as usize >= nodes);
    let damped = elements.mass_damping;
    if (0..elements.tets.len()).any(strange) || !(damped >= 0.0 && damped.is_finite()) {
        return Err(Error::Input(format!(
            "a model of {nodes} nodes has elements of nodes that do not exist, or a mass damping of {damped} 1/s; give existing nodes and a finite mass damping ≥ 0"
        )));
    }
    Ok(())
}

/// Returns the largest number of nodes of an aggregate in a body of `nodes` nodes.
fn nodes_per_aggregate(nodes: usize) -> usize {
    let nodes = nodes as f64;
    let groups = (AGGREGATES_PER_SQRT_NODE * nodes.sqrt())
        .min(CUBE_ROOT_AGGREGATES_FROM)
        .max(AGGREGATES_PER_CBRT_NODE * nodes.cbrt());
    (nodes / groups).ceil() as usize
}

/// Returns the index in `order` of each of its numbers.
fn inverse_order(order: &[u32]) -> Vec<u32> {
    let mut place = vec![0u32; order.len()];
    for (k, v) in order.iter().enumerate() {
        place[*v as usize] = k as u32;
    }
    place
}

/// Returns the term of the springs or elements, in the given node order, units and partition.
fn material_term<T: Real>(
    network: &DiscreteModel,
    kind: SolverKind,
    layout: (&[u32], LocalUnits, &Partition),
) -> Box<dyn Term<T>> {
    match &network.discretisation {
        Discretisation::Springs(springs) => Box::new(Springs::new(network, springs, layout)),
        Discretisation::Elements(elements) => {
            let implicit = kind.is_implicit();
            match elements.order() {
                1 => Box::new(ElementTerm::<T, TetBatch<T>>::new(
                    (network, elements),
                    layout,
                    implicit,
                )),
                _ => Box::new(ElementTerm::<T, QuadraticBatch<T>>::new(
                    (network, elements),
                    layout,
                    implicit,
                )),
            }
        }
    }
}

/// Returns the stopping criteria of Newton's method and the scheme of a solver.
fn newton_settings(kind: SolverKind, settings: CgSettings) -> (NewtonSettings, ImplicitScheme) {
    let has_custom_tolerance = settings.tolerance != CgSettings::default().tolerance;
    let newton = match (has_custom_tolerance, kind) {
        (true, _) => NewtonSettings::with_tolerance(settings.tolerance),
        // The midpoint rule does not damp the errors of an inexact solve.
        (false, SolverKind::Midpoint) => NewtonSettings::with_tolerance(MIDPOINT_TOLERANCE),
        (false, _) => NewtonSettings::default(),
    };
    let scheme = match kind {
        SolverKind::Bdf2 => ImplicitScheme::Bdf2,
        SolverKind::Midpoint => ImplicitScheme::Midpoint,
        _ => ImplicitScheme::Euler,
    };
    (newton, scheme)
}
