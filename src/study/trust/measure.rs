//! One case of the study: the reported number and its estimated error, by linear and by quadratic
//! tets, and the converged number.

use super::case::{Case, Load};
use crate::accuracy::{
    EQUILIBRIUM_TOLERANCE, ErrorParts, RestBody, errors_at_rest, mesh_factor, quasi_static_step,
    settle,
};
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, TetMesh, Topology};
use crate::physics::SolverKind;
use crate::press::{Press, PressOptions};
use crate::random::Random;
use crate::scene::{Motion, Scene};
use crate::{Error, Result, no_progress};
use glam::{DMat3, DVec3};

/// Number of spaces, each finer than the one before, from which the converged number is extrapolated:
/// quadratic tets, each divided into eight, and into 64.
const FINER: usize = 2;
/// Fraction of the extent at an end that is fixed.
const END: f64 = 0.12;
/// Angle between the ends of a twisted body, rad.
const TWIST: f64 = 0.3;
/// Radius of the fingertip over the mean edge of the boundary, at least.
const RADIUS_IN_EDGES: f64 = 1.3;
/// Largest number of sites that are tried for a press.
const MAX_SITES: u32 = 8;

/// A reported number with its estimated error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reported {
    pub value: f64,
    /// Difference to the finer space.
    pub raw: f64,
    /// The parts of the reported error besides that of the mesh.
    pub rest: f64,
}

/// The numbers of a case.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Measured {
    /// By linear and by quadratic tets; `None` where the number was refused.
    pub reported: [Option<Reported>; 2],
    /// By quadratic tets and in the finer spaces.
    pub finer: Vec<f64>,
    /// Number of tets.
    pub tets: usize,
}

const ORDERS: [ElementOrder; 2] = [ElementOrder::Linear, ElementOrder::Quadratic];

/// Measures `case`.
///
/// # Errors
/// As a simulation; a body that cannot be loaded as the case asks.
pub(super) fn measure(gpu: &Gpu, case: &Case) -> Result<Measured> {
    match case.load {
        Load::Press => measure_press(gpu, case),
        Load::Sag | Load::Twist => measure_rest(gpu, case),
    }
}

fn reported(value: f64, parts: &ErrorParts, order: ElementOrder) -> Reported {
    Reported {
        value,
        raw: parts.mesh / mesh_factor(order),
        rest: parts.total() - parts.mesh,
    }
}

fn measure_press(gpu: &Gpu, case: &Case) -> Result<Measured> {
    let mesh = case.mesh()?;
    let mut random = case.random();
    let wanted = |random: &mut Random| PressOptions {
        at: Some(beside(&mesh, random)),
        radius: Some(radius(&mesh)),
        ..PressOptions::default()
    };
    let mut options = wanted(&mut random);
    for _ in 1..MAX_SITES {
        match Press::with_mesh(
            gpu,
            (&case.scene(ElementOrder::Linear)?, mesh.clone()),
            &options,
        ) {
            Err(Error::Input(_)) => options = wanted(&mut random),
            _ => break,
        }
    }
    let mut found = Measured {
        reported: [None; 2],
        finer: Vec::new(),
        tets: mesh.tets.len(),
    };
    for (order, reported_number) in ORDERS.into_iter().zip(&mut found.reported) {
        let scene = case.scene(order)?;
        let mut press = Press::with_mesh(gpu, (&scene, mesh.clone()), &options)?;
        while press.advance()?.is_some() {}
        press.estimate_error(&no_progress)?;
        let report = press.report(0.0);
        if report.warnings.is_empty() {
            let errors = report.error_parts.as_ref();
            *reported_number = errors.map(|e| reported(report.max_force_n, &e.max_force_n, order));
        }
        if order == ElementOrder::Quadratic {
            found.finer = vec![press.deepest_force()];
            found.finer.extend(press.finer_forces(FINER)?);
        }
    }
    Ok(found)
}

/// Returns a point at a random side of the body.
fn beside(mesh: &TetMesh, random: &mut Random) -> DVec3 {
    let (low, high) = mesh.bounds();
    0.5 * (low + high) + 0.5 * random.point() * (high - low)
}

/// Returns a radius of the fingertip for which the faces of `mesh` are small enough.
fn radius(mesh: &TetMesh) -> f64 {
    let topology = Topology::new(mesh);
    let edges = topology.boundary.iter().flat_map(|face| {
        let [a, b, c] = topology
            .boundary_nodes(mesh, *face)
            .map(|v| mesh.nodes[v as usize]);
        [a.distance(b), b.distance(c), c.distance(a)]
    });
    let (sum, count) = edges.fold((0.0, 0.0), |(sum, n), edge| (sum + edge, n + 1.0));
    let usual = crate::press::PressSite::default_radius(mesh, &topology);
    usual.max(RADIUS_IN_EDGES * sum / f64::max(count, 1.0))
}

fn measure_rest(gpu: &Gpu, case: &Case) -> Result<Measured> {
    let mesh = case.mesh()?;
    let setup = RestSetup::new(case, &mesh);
    let mut found = Measured {
        reported: [None; 2],
        finer: Vec::new(),
        tets: mesh.tets.len(),
    };
    for (order, reported_number) in ORDERS.into_iter().zip(&mut found.reported) {
        let mut scene = case.scene(order)?;
        scene.solver.gravity = Some(setup.gravity.to_array());
        scene.solver.tolerance = Some(EQUILIBRIUM_TOLERANCE);
        let (mut motion, _) = Motion::new(gpu, &scene, SolverKind::Implicit, mesh.clone(), None)?;
        motion.set_sleep_allowed(false);
        let nodes = motion.simulator.mesh().nodes.clone();
        let loads = motion.simulator.loads_mut();
        loads.unpin_all();
        loads.pin_nodes(&setup.fixed(&nodes, &mesh))?;
        let start: Vec<DVec3> = nodes.iter().map(|x| setup.start(*x)).collect();
        let start = straightened(&motion, start);
        let dt = quasi_static_step(&motion);
        let value = settle(&mut motion, (&start, dt), &mut |m| {
            Ok(vec![setup.number(m, &mesh)?])
        })?;
        let value = value.values.first().copied().unwrap_or(f64::NAN);
        let errors = errors_at_rest(gpu, (&scene, &mut motion), &no_progress)?;
        let parts = match case.load {
            Load::Twist => errors.elastic_energy,
            _ => errors.max_displacement,
        };
        *reported_number = Some(reported(value, &parts, order));
        if order == ElementOrder::Quadratic {
            found.finer = vec![value];
            found
                .finer
                .extend(finer_numbers(gpu, &scene, &motion, &mut |m| {
                    setup.number(m, &mesh)
                })?);
        }
    }
    Ok(found)
}

/// Returns `positions` with the nodes in the middle of straight edges in the middle again.
fn straightened(motion: &Motion, mut positions: Vec<DVec3>) -> Vec<DVec3> {
    let mesh = motion.simulator.mesh();
    for nodes in mesh.ten_node_tets().unwrap_or_default() {
        for (edge, [a, b]) in crate::mesh::TET_EDGES.into_iter().enumerate() {
            let ends = [a, b].map(|k| positions[nodes[k] as usize]);
            positions[nodes[4 + edge] as usize] = ends[0].midpoint(ends[1]);
        }
    }
    positions
}

/// Returns a number of the body of `motion` in the finer spaces.
fn finer_numbers(
    gpu: &Gpu,
    scene: &Scene,
    motion: &Motion,
    number: &mut dyn FnMut(&mut Motion) -> Result<f64>,
) -> Result<Vec<f64>> {
    let dt = quasi_static_step(motion);
    let mut positions = motion.positions()?;
    let (mut coarser, mut numbers) = (RestBody::new(scene, motion)?, Vec::new());
    for _ in 0..FINER {
        let mut finer = coarser.finer(gpu)?;
        positions = finer.positions_from(&positions);
        let settled = settle(&mut finer.motion, (&positions, dt), &mut |m| {
            Ok(vec![number(m)?])
        })?;
        numbers.extend(settled.values);
        positions = finer.motion.positions()?;
        coarser = RestBody::new(scene, &finer.motion)?;
    }
    Ok(numbers)
}

/// The supports and the load of a sagging or twisted body.
struct RestSetup {
    load: Load,
    /// The axis between its ends, and their coordinates along it.
    axis: DVec3,
    ends: [f64; 2],
    centre: DVec3,
    gravity: DVec3,
}

impl RestSetup {
    fn new(case: &Case, mesh: &TetMesh) -> RestSetup {
        let mut random = case.random();
        let (low, high) = mesh.bounds();
        let size = high - low;
        let axis = match case.load {
            Load::Twist => DVec3::AXES[size.max_position()],
            _ => DVec3::AXES[((3.0 * random.next()) as usize).min(2)],
        };
        let length = size.dot(axis);
        let density = crate::physics::Material::soft_tissue().density;
        // Slender bodies bend more.
        let slender = (size.min_element() / length).min(1.0);
        let strain = (0.02 + 0.08 * random.next()) * slender;
        let gravity = strain * case.young() / (density * length) * random.point().normalize();
        RestSetup {
            load: case.load,
            axis,
            ends: [low.dot(axis) + END * length, high.dot(axis) - END * length],
            centre: 0.5 * (low + high),
            gravity: match case.load {
                Load::Sag => gravity,
                _ => DVec3::ZERO,
            },
        }
    }

    /// Returns the fixed nodes among `nodes`, of which those of `mesh` come first; between them are
    /// only those of a mesh of order 2, fixed if both ends of their edges are.
    fn fixed(&self, nodes: &[DVec3], mesh: &TetMesh) -> Vec<u32> {
        let is_fixed = |x: DVec3| {
            let at = x.dot(self.axis);
            at <= self.ends[0] || (self.load == Load::Twist && at >= self.ends[1])
        };
        let corners: Vec<bool> = mesh.nodes.iter().map(|x| is_fixed(*x)).collect();
        let mut fixed = corners.clone();
        if nodes.len() > mesh.nodes.len() {
            let edges = mesh.edges();
            fixed.extend(edges.iter().map(|e| e.iter().all(|v| corners[*v as usize])));
        }
        let numbered = (0u32..).zip(fixed);
        numbered.filter(|(_, is)| *is).map(|(v, _)| v).collect()
    }

    /// Returns where a point starts: a twisted body turns along its axis.
    fn start(&self, x: DVec3) -> DVec3 {
        if self.load != Load::Twist {
            return x;
        }
        let [from, to] = self.ends;
        let share = ((x.dot(self.axis) - from) / (to - from)).clamp(0.0, 1.0);
        let turn = DMat3::from_axis_angle(self.axis, TWIST * share);
        self.centre + turn * (x - self.centre)
    }

    /// Returns the number that the study measures.
    fn number(&self, motion: &mut Motion, mesh: &TetMesh) -> Result<f64> {
        match self.load {
            Load::Twist => Ok(motion.report()?.energy.elastic),
            _ => {
                let x = motion.positions()?;
                let moved = x.iter().zip(&mesh.nodes);
                Ok(moved.map(|(x, rest)| x.distance(*rest)).fold(0.0, f64::max))
            }
        }
    }
}
