//! Trials of motion candidates against the reference motion.

use super::motion_point::{Body, BodyKey, MotionPoint, bodies};
use super::search::Candidates;
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, TET_EDGES, TetMesh};
use crate::physics::SolverKind;
use crate::progress::ProgressScope;
use crate::scene::{Motion, OrderChoice, Scene};
use crate::{Error, ProgressFn, Result};
use glam::DVec3;
use std::collections::BTreeMap;
use web_time::Instant;

/// Number of times at which the motion is compared with the reference.
const COMPARISONS: u32 = 4;
/// Steps of a timing probe.
const PROBE_STEPS: u32 = 3;
/// Steps between two comparisons, relative to those with the scene's time step.
const STEP_RATIOS: [f64; 6] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
/// Tolerances of conjugate gradients.
const TOLERANCES: [f64; 2] = [0.1, 0.01];
/// Upper bound of the cost of an implicit step, in explicit steps.
const MAX_EXPLICIT_TETS: f64 = 32.0;
/// Approximate element evaluations per step.
const EVALUATIONS: f64 = 3.0;
/// Largest mesh for which order 2 is tried unless the scene sets it: the reference, which needs more
/// steps than any candidate, then takes minutes.
const MAX_QUADRATIC_TETS: usize = 10_000;
/// Solver tolerance of the reference.
const REFERENCE_TOLERANCE: f64 = 1e-4;
/// Minimum RMS displacement that counts as motion, relative to the body size.
const MIN_MOTION_RATIO: f64 = 1e-6;

/// Cost measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cost {
    /// Milliseconds per second of motion, on this machine.
    Time,
    /// Millions of spring visits per second of motion: machine-independent.
    Visits,
}

/// Motion candidates of a scene, and the reference motion.
pub struct MotionSearch<'a> {
    gpu: Gpu,
    scene: Scene,
    mesh: TetMesh,
    /// Nodes of `mesh` whose positions are compared: those that all bodies have, its corners.
    corners: Vec<usize>,
    cost: Cost,
    /// Time between two comparisons, s.
    pace: f64,
    points: Vec<MotionPoint>,
    /// Reference positions of the corners at each comparison.
    truth: Vec<Vec<DVec3>>,
    /// Σ |displacement|² over nodes and comparisons.
    moved: f64,
    /// Cache of simulations.
    made: BTreeMap<BodyKey, std::result::Result<Motion, String>>,
    progress: ProgressFn<'a>,
    /// Current task and its completed fraction.
    task: (&'static str, f64),
}

impl<'a> MotionSearch<'a> {
    /// Computes the reference for the first `seconds` of the motion of `scene`: with its own mesh
    /// (as quadratic tets, if the body supports them), by implicit Euler (BDF2 for finite elements
    /// on the CPU) with an eighth and a sixteenth of its time step, by Richardson extrapolation to
    /// zero.
    ///
    /// # Errors
    /// [`Error::Input`] for a grid body, a body that is cut, or no visible motion; otherwise as
    /// [`Motion::new`] and [`Motion::run`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        seconds: f64,
        cost: Cost,
        progress: ProgressFn<'a>,
    ) -> Result<MotionSearch<'a>> {
        if scene.grid.is_some() || !scene.cut.is_empty() {
            return Err(Error::Input(
                "tuning needs a tetrahedral body without cuts; remove [grid] and [[cut]]".into(),
            ));
        }
        if let Some(entry) = scene.tets_only_entry() {
            return Err(Error::Input(format!(
                "tuning supports pins, forces, grabs and gravity only; remove {entry}"
            )));
        }
        let mut scene = scene.clone();
        scene.solver.sleep = Some(false);
        let mesh = scene.whole_mesh_of_one()?;
        let pace = seconds / f64::from(COMPARISONS);
        let own = scene.solver.dt.unwrap_or(0.01).min(pace);
        let steps = (pace / own).ceil();
        let counts: Vec<u32> = STEP_RATIOS
            .map(|p| (p * steps).ceil().max(1.0) as u32)
            .to_vec();
        let finest = counts.iter().copied().max().unwrap_or(1);
        let mut counts = counts;
        counts.dedup();
        let mut corners: Vec<usize> = (0..mesh.nodes.len()).collect();
        if mesh.order == ElementOrder::Quadratic {
            let is_middle = mesh.mid_edge_nodes();
            corners.retain(|v| !is_middle[*v]);
        }
        let bodies = bodies(
            corners.len(),
            scene.supports_order_2(&mesh, MAX_QUADRATIC_TETS),
        );
        let mut points = Vec::new();
        for (body, order) in &bodies {
            for count in &counts {
                for tolerance in TOLERANCES {
                    points.push(MotionPoint {
                        body: *body,
                        order: *order,
                        solver: SolverKind::Implicit,
                        dt: pace / f64::from(*count),
                        tolerance,
                    });
                }
            }
        }
        let mut motions = MotionSearch {
            gpu: gpu.clone(),
            scene,
            mesh,
            corners,
            cost,
            pace,
            points,
            truth: Vec::new(),
            moved: 0.0,
            made: BTreeMap::new(),
            progress,
            task: ("reference", 0.0),
        };
        let orders: Vec<Option<ElementOrder>> = bodies
            .into_iter()
            .filter(|(body, _)| *body == Body::Own)
            .map(|(_, order)| order)
            .collect();
        let second_order = motions.add_second_order(&counts, &orders);
        motions.find_truth_of_highest_order(finest, (second_order, &orders))?;
        motions.add_explicit(MAX_EXPLICIT_TETS * f64::from(finest))?;
        Ok(motions)
    }

    /// Adds second-order candidates if the body has finite elements on the CPU; returns whether it
    /// does.
    fn add_second_order(&mut self, counts: &[u32], orders: &[Option<ElementOrder>]) -> bool {
        let mut found = false;
        let all = SolverKind::ELEMENT_ONLY.into_iter();
        for (solver, order) in all.flat_map(|s| orders.iter().map(move |order| (s, *order))) {
            let candidates = counts.iter().flat_map(|count| {
                TOLERANCES.map(|tolerance| MotionPoint {
                    body: Body::Own,
                    order,
                    solver,
                    dt: self.pace / f64::from(*count),
                    tolerance,
                })
            });
            let candidates: Vec<MotionPoint> = candidates.collect();
            if let Some(first) = candidates.first()
                && matches!(self.motion(first), Ok(Ok(_)))
            {
                found = true;
                self.points.extend(candidates);
            }
        }
        found
    }

    /// Finds the reference by the last of `orders`, the highest. If quadratic tets cannot run and the
    /// scene does not ask for them, drops their candidates and takes linear ones: those of a file may
    /// be folded, and soft ones invert where linear ones do not.
    fn find_truth_of_highest_order(
        &mut self,
        finest: u32,
        (second_order, orders): (bool, &[Option<ElementOrder>]),
    ) -> Result<()> {
        let order = orders.last().copied().flatten();
        let is_set = self.scene.material.order == order.map(OrderChoice::Exactly);
        match self.find_truth(finest, (second_order, order)) {
            Err(Error::Solver { .. } | Error::Input(_)) if orders.len() > 1 && !is_set => {
                self.points.retain(|point| point.order != order);
                self.find_truth(finest, (second_order, orders[0]))
            }
            found => found,
        }
    }

    fn find_truth(
        &mut self,
        finest: u32,
        (second_order, order): (bool, Option<ElementOrder>),
    ) -> Result<()> {
        // Halving the step reduces the error by a factor of 2 or 4.
        let (solver, left) = match second_order {
            true => (SolverKind::Bdf2, 0.25),
            false => (SolverKind::Implicit, 0.5),
        };
        let mut paths = Vec::new();
        for (n, count) in [finest, 2 * finest].into_iter().enumerate() {
            self.task = ("reference", 0.1 + 0.3 * n as f64);
            let point = MotionPoint {
                body: Body::Own,
                order,
                solver,
                dt: self.pace / f64::from(count),
                tolerance: REFERENCE_TOLERANCE,
            };
            let mut path = Vec::new();
            self.run(&point, &mut |positions| {
                path.push(positions.to_vec());
                true
            })?;
            paths.push(path);
        }
        let (coarse, fine) = (&paths[0], &paths[1]);
        let on = left / (1.0 - left);
        self.truth = fine
            .iter()
            .zip(coarse)
            .map(|(fine, coarse)| {
                let both = fine.iter().zip(coarse);
                both.map(|(f, c)| *f + on * (*f - *c)).collect()
            })
            .collect();
        let rest = at_corners(&self.corners, self.mesh.nodes.clone());
        let moved = |there: &Vec<DVec3>| sum_of_squared_distances(there, &rest);
        self.moved = self.truth.iter().map(moved).sum();
        let (low, high) = self.mesh.bounds();
        let least = MIN_MOTION_RATIO * (high - low).max_element();
        if self.moved <= least * least * rest.len() as f64 {
            return Err(Error::Input(
                "no visible motion to tune; increase --seconds, or add a load".into(),
            ));
        }
        Ok(())
    }

    /// Adds explicit candidates with their largest stable step, unless they need more than `most`
    /// steps between two comparisons.
    fn add_explicit(&mut self, most: f64) -> Result<()> {
        let mut bodies: Vec<(Body, Option<ElementOrder>)> = Vec::new();
        for point in &self.points {
            if !bodies.contains(&(point.body, point.order)) {
                bodies.push((point.body, point.order));
            }
        }
        for (body, order) in bodies {
            let mut point = MotionPoint {
                body,
                order,
                solver: SolverKind::Symplectic,
                dt: 0.0,
                tolerance: 0.0,
            };
            let mut scene = self.scene.clone();
            point.apply(&mut scene);
            scene.solver.dt = None;
            let made = Motion::new(&self.gpu, &scene, point.solver, self.mesh.clone(), None);
            let Ok((motion, _)) = made else {
                continue;
            };
            let count = (self.pace / motion.dt).ceil();
            if !(count.is_finite() && count <= most) {
                continue;
            }
            point.dt = self.pace / count;
            self.made.insert(point.body_key(), Ok(motion));
            self.points.push(point);
        }
        Ok(())
    }

    /// Returns the reference positions of the nodes of the mesh at the end. Of ten-node tets in a
    /// file the edges are not bent.
    pub fn final_reference(&self) -> Vec<DVec3> {
        let rest = &self.mesh.nodes;
        let mut positions = rest.clone();
        let end = self.truth.last().into_iter().flatten();
        for (v, x) in self.corners.iter().zip(end) {
            positions[*v] = *x;
        }
        for nodes in self.mesh.quadratic_elements().unwrap_or_default() {
            let nodes = nodes.map(|v| v as usize);
            for (middle, [a, b]) in nodes[4..].iter().zip(TET_EDGES) {
                let moved = |v: usize| positions[nodes[v]] - rest[nodes[v]];
                positions[*middle] = rest[*middle] + 0.5 * (moved(a) + moved(b));
            }
        }
        positions
    }

    /// Runs a candidate from rest and passes the positions of the corners at each comparison to
    /// `look`, until it returns false.
    fn run(&mut self, point: &MotionPoint, look: &mut dyn FnMut(&[DVec3]) -> bool) -> Result<()> {
        let steps = (self.pace / point.dt).round() as u32;
        let (what, share) = self.task;
        let part = ProgressScope::begin(self.progress, what, share)?;
        let corners = self.corners.clone();
        let motion = self.motion(point)?.map_err(Error::Input)?;
        for _ in 0..COMPARISONS {
            part.check_cancelled()?;
            motion.run(steps, &mut |_| {})?;
            if !look(&at_corners(&corners, motion.positions()?)) {
                break;
            }
        }
        Ok(())
    }

    /// Returns the simulation of a candidate at rest, or the reason why its body cannot be created.
    fn motion(&mut self, point: &MotionPoint) -> Result<std::result::Result<&mut Motion, String>> {
        let mut scene = self.scene.clone();
        point.apply(&mut scene);
        let (gpu, mesh) = (&self.gpu, &self.mesh);
        let made = self.made.entry(point.body_key()).or_insert_with(|| {
            let made = Motion::new(gpu, &scene, point.solver, mesh.clone(), None);
            made.map(|m| m.0).map_err(|e| e.to_string())
        });
        match made {
            Ok(motion) => {
                motion.restart(&scene)?;
                Ok(Ok(motion))
            }
            Err(why) => Ok(Err(format!("{}: {why}", point.body))),
        }
    }
}

impl Candidates for MotionSearch<'_> {
    type Point = MotionPoint;

    fn points(&self) -> Vec<MotionPoint> {
        self.points.clone()
    }

    fn cost(&mut self, point: &MotionPoint) -> Result<f64> {
        let cost = self.cost;
        let Ok(motion) = self.motion(point)? else {
            return Ok(f64::INFINITY);
        };
        // The first run is slower: it creates passes and estimates iteration counts.
        if motion.run(PROBE_STEPS, &mut |_| {}).is_err() {
            return Ok(f64::INFINITY);
        }
        let start = Instant::now();
        if motion.run(PROBE_STEPS, &mut |_| {}).is_err() {
            return Ok(f64::INFINITY);
        }
        let a_step = match cost {
            Cost::Time => start.elapsed().as_secs_f64() * 1e3 / f64::from(PROBE_STEPS),
            Cost::Visits => visits(motion)?,
        };
        Ok(a_step / point.dt)
    }

    fn error(&mut self, point: &MotionPoint, enough: f64) -> Result<f64> {
        let (truth, moved) = (std::mem::take(&mut self.truth), self.moved);
        let mut off = 0.0;
        let mut looks = truth.iter();
        let run = self.run(point, &mut |positions| {
            off += looks
                .next()
                .map_or(0.0, |there| sum_of_squared_distances(there, positions));
            // The accumulated error only grows, so the run can stop early.
            off <= enough * enough * moved
        });
        self.truth = truth;
        match run {
            Ok(()) => Ok((off / moved).sqrt()),
            Err(Error::Solver { .. }) => Ok(f64::INFINITY),
            Err(other) => Err(other),
        }
    }
}

/// Returns the positions of the corners of a mesh from those of a body with its nodes, and perhaps
/// with further ones after them, or with its corners only.
fn at_corners(corners: &[usize], positions: Vec<DVec3>) -> Vec<DVec3> {
    if positions.len() == corners.len() {
        return positions;
    }
    corners.iter().map(|v| positions[*v]).collect()
}

/// Returns the visits of edges (of springs and elements) in the last steps, in millions per step.
fn visits(motion: &Motion) -> Result<f64> {
    let simulator = motion.simulator.as_ref();
    let simulator = simulator.coarse_body().unwrap_or(simulator);
    let edges = simulator.edge_nodes().len() as f64;
    // Elements are evaluated a few times a step, with all pairs of their nodes; solver iterations
    // traverse edges.
    let elements = simulator.model().and_then(|model| model.elements());
    let pairs = elements.map_or(0, |elements| {
        let own = if elements.order() == 1 { 6 } else { 45 };
        own * elements.tets.len()
    });
    let elements = EVALUATIONS * pairs as f64;
    let last = simulator.iterations()?;
    let last = &last[last.len().saturating_sub(PROBE_STEPS as usize)..];
    if simulator.model().is_none() && last.is_empty() {
        return Ok(2e-6 * (edges + elements));
    }
    let iterations: u32 = last.iter().sum();
    let each = 3.0 + f64::from(iterations) / last.len().max(1) as f64;
    Ok(2e-6 * (edges * each + elements))
}

/// Σ |a − b|².
fn sum_of_squared_distances(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum()
}
