//! Motion candidates: the body or a cage, order of its elements, solver, time step and solver
//! tolerance.

use crate::cage::CageKind;
use crate::mesh::ElementOrder;
use crate::physics::SolverKind;
use crate::scene::{CageEntry, OrderChoice, Scene};
use std::fmt;

/// Maximum number of cage nodes relative to the nodes of the mesh.
const MAX_CAGE_FRACTION: f64 = 0.6;
/// Approximate size of the smallest cage, in nodes, and the maximum number of cages.
const MIN_CAGE_TETS: f64 = 60.0;
const CAGES: usize = 4;

/// Simulated body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Body {
    /// A lattice cage of about this number of nodes.
    Cage(usize),
    /// The mesh itself.
    Own,
}

/// A motion candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionPoint {
    /// Simulated body.
    pub body: Body,
    /// Order of its elements; `None` if the body does not support order 2.
    pub order: Option<ElementOrder>,
    /// Solver.
    pub solver: SolverKind,
    /// Time step, s.
    pub dt: f64,
    /// Tolerance of conjugate gradients; 0 for solvers without.
    pub tolerance: f64,
}

impl fmt::Display for Body {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Body::Cage(nodes) => write!(f, "cage of about {nodes} nodes"),
            Body::Own => write!(f, "tets of the mesh"),
        }
    }
}

impl fmt::Display for MotionPoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.body, self.order) {
            (Body::Own, Some(ElementOrder::Linear)) => write!(f, "linear tets of the mesh")?,
            (Body::Own, Some(ElementOrder::Quadratic)) => write!(f, "quadratic tets of the mesh")?,
            (body, _) => write!(f, "{body}")?,
        }
        write!(f, ", {} with time step {:.3e} s", self.solver, self.dt)?;
        match self.tolerance > 0.0 {
            true => write!(f, " and solver tolerance {}", self.tolerance),
            false => Ok(()),
        }
    }
}

impl MotionPoint {
    /// What distinguishes its body from those of other candidates.
    pub(super) fn body_key(&self) -> BodyKey {
        let order = self.order.map(ElementOrder::number);
        (self.body, order, self.solver.name())
    }

    /// Applies the candidate to a scene; the simulated time between two images is preserved.
    pub fn apply(&self, scene: &mut Scene) {
        let steps = scene.solver.steps.zip(scene.solver.dt);
        scene.cage = match self.body {
            Body::Own => None,
            Body::Cage(nodes) => Some(CageEntry {
                nodes: Some(nodes),
                kind: Some(CageKind::Lattice),
                damping: None,
            }),
        };
        if let Some(order) = self.order {
            scene.material.order = Some(OrderChoice::Exactly(order));
        }
        scene.solver.name = Some(self.solver.name().to_owned());
        scene.solver.dt = Some(self.dt);
        scene.solver.tolerance = (self.tolerance > 0.0).then_some(self.tolerance);
        if let Some((steps, dt)) = steps {
            let steps = (f64::from(steps) * dt / self.dt).round();
            scene.solver.steps = Some(steps.max(1.0) as u32);
        }
    }
}

/// Body, order as a number, and name of the solver.
pub(super) type BodyKey = (Body, Option<u32>, &'static str);

/// Returns the bodies to try, and the orders of their elements if order 2 is one of the choices: cages
/// of a mesh of `nodes` nodes, then the mesh, of linear and then of quadratic tets.
pub(super) fn bodies(nodes: usize, has_order_2: bool) -> Vec<(Body, Option<ElementOrder>)> {
    let most = MAX_CAGE_FRACTION * nodes as f64;
    let growth = (most / MIN_CAGE_TETS)
        .max(1.0)
        .powf(1.0 / CAGES as f64)
        .max(1.5);
    let linear = has_order_2.then_some(ElementOrder::Linear);
    let sizes = (0..CAGES).map(|k| most / growth.powi(k as i32 + 1));
    let mut bodies: Vec<(Body, Option<ElementOrder>)> = sizes
        .filter(|n| *n >= 0.5 * MIN_CAGE_TETS)
        .map(|n| (Body::Cage(n.round() as usize), linear))
        .collect();
    bodies.push((Body::Own, linear));
    if has_order_2 {
        bodies.push((Body::Own, Some(ElementOrder::Quadratic)));
    }
    bodies
}
