//! Bodies and motions of the motion study.

use super::trial::MotionTrial;
use crate::generate;
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::mesher::Domain;
use crate::physics::grid::{GridModel, GridShape};
use crate::physics::{
    CpuGrid, EngineChoice, Material, MaterialModel, Precision, RegionMaterial, Simulator,
    SolverKind,
};
use crate::scene::{Motion, Scene};
use crate::study::reference_motion::MotionState;
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use std::path::Path;

/// Earth's gravity, m/s².
const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);

/// Duration of most motions, s.
const DURATION: f64 = 0.128;

/// Returns all trials, or those of a quick run.
pub fn all(gpu: &Gpu, quick: bool) -> Result<Vec<MotionTrial>> {
    let mut trials = vec![
        released(gpu, 3_000.0)?,
        released(gpu, 30_000.0)?,
        swinging(gpu)?,
        falling(gpu)?,
        breathing(gpu)?,
    ];
    if !quick {
        trials.push(twisted(gpu)?);
        trials.push(pressed(gpu)?);
        trials.push(pulled(gpu)?);
    }
    Ok(trials)
}

/// Creates a body of `mesh` and `material` on the available engine, pinned where `held` is true.
fn body(
    gpu: &Gpu,
    mesh: TetMesh,
    material: &Material,
    held: impl Fn(DVec3) -> bool,
) -> Result<Box<dyn Simulator>> {
    let nodes = nodes_where(&mesh, held);
    let kind = SolverKind::Symplectic;
    let mut simulator = EngineChoice::Auto.build_tets(gpu, mesh, material, kind)?;
    simulator.pin_nodes(&nodes)?;
    Ok(simulator)
}

fn nodes_where(mesh: &TetMesh, wanted: impl Fn(DVec3) -> bool) -> Vec<u32> {
    let nodes = (0u32..).zip(&mesh.nodes);
    nodes.filter(|n| wanted(*n.1)).map(|n| n.0).collect()
}

/// The paper's bar, clamped at one end and released under gravity; undamped.
fn released(gpu: &Gpu, kappa: f64) -> Result<MotionTrial> {
    let mesh = generate::paper_bar()?;
    let mut body = body(gpu, mesh, &Material::uniform_springs(kappa, 0.0), |p| {
        p.x < 1e-6
    })?;
    body.loads_mut().set_gravity(GRAVITY);
    MotionTrial::of_model(gpu, "released", (kappa, "N/m"), DURATION, body, None)
}

/// The paper's bar of finite elements, released for about one oscillation.
fn swinging(gpu: &Gpu) -> Result<MotionTrial> {
    let mesh = generate::paper_bar()?;
    let material = Material {
        model: MaterialModel::NeoHookean,
        ..Material::from_young(5e4)
    };
    let mut body = body(gpu, mesh, &material, |p| p.x < 1e-6)?;
    body.loads_mut().set_gravity(GRAVITY);
    let stiffness = (5e4, "Pa");
    MotionTrial::of_model(gpu, "swinging", stiffness, 4.0 * DURATION, body, None)
}

/// A bar clamped at one end, the other twisted by one radian and released; damped.
fn twisted(gpu: &Gpu) -> Result<MotionTrial> {
    let size = generate::PAPER_BAR_SIZE;
    let mesh = generate::bar_of_about(640, size)?;
    let material = Material {
        damping_time: 1e-3,
        ..Material::from_young(5e4)
    };
    let body = body(gpu, mesh, &material, |p| p.x < 1e-6)?;
    let mut start = MotionState::rest(body.as_ref());
    let (frame, unit) = body.loads().frame_and_unit();
    let middle = DVec3::new(0.0, 0.5 * size.y, 0.5 * size.z);
    for (x, p) in start.x.iter_mut().zip(&body.mesh().nodes) {
        let turn = DMat3::from_rotation_x(p.x / size.x);
        *x = (middle + turn * (*p - middle) - frame.origin) * unit;
    }
    let stiffness = (5e4, "Pa");
    MotionTrial::of_model(gpu, "twisted", stiffness, DURATION, body, Some(start))
}

/// The limb phantom, clamped at the elbow and pressed on the back of its hand; damped, its bones
/// ten times as stiff as the rest.
fn pressed(gpu: &Gpu) -> Result<MotionTrial> {
    let mesh = generate::limb(2_500)?;
    let soft = Material {
        density: 1060.0,
        damping_time: 5e-4,
        region_field: Some("label".into()),
        ..Material::from_young(5e4)
    };
    let bone = RegionMaterial {
        stiffness: 5e5,
        density: 1800.0,
        poisson: 0.4,
    };
    let hard = generate::TISSUES
        .iter()
        .filter(|t| t.name.ends_with("bone"));
    let material = Material {
        regions: hard.map(|t| (i64::from(t.label), bone)).collect(),
        ..soft
    };
    let mut body = body(gpu, mesh, &material, |p| p.x < 0.04)?;
    let hand = nodes_where(body.mesh(), |p| p.x > 0.18 && p.x < 0.24);
    let loads = body.loads_mut();
    loads.add_force(DVec3::new(0.0, 0.0, -2.0), &hand)?;
    MotionTrial::of_model(gpu, "pressed", (5e4, "Pa"), 2.0 * DURATION, body, None)
}

/// A block of grid particles, clamped at one end, the other pulled and bent; damped.
fn pulled(gpu: &Gpu) -> Result<MotionTrial> {
    let size = generate::PAPER_BAR_SIZE;
    let shape = GridShape::from_domain(&Block(size), DVec3::splat(0.01), DMat3::IDENTITY)?;
    let mut model = GridModel::new(shape, &Material::from_young(5e4))?;
    model.damping = 2.0;
    let mesh = model.shape.mesh(&model.springs)?;
    let of_body = |wanted: &dyn Fn(f64) -> bool| -> Vec<u32> {
        let particles = model.shape.particles();
        let there = particles.filter(|i| wanted(model.shape.rest_position(*i).x));
        there.map(|i| i as u32).collect()
    };
    let held = of_body(&|x| x < 1e-6);
    let end = of_body(&|x| x > size.x - 1e-6);
    let mut both: [Box<dyn Simulator>; 2] = [
        EngineChoice::Auto.build_grid(gpu, mesh.clone(), model.clone())?,
        Box::new(CpuGrid::new(gpu, model, mesh, Precision::Double)?),
    ];
    for body in &mut both {
        body.pin_nodes(&held)?;
        let loads = body.loads_mut();
        loads.add_force(DVec3::new(2.0, 0.0, -1.0), &end)?;
    }
    Ok(MotionTrial::new(
        "pulled",
        (5e4, "Pa"),
        DURATION,
        both,
        None,
    ))
}

/// The axis-aligned box from the origin to a corner.
struct Block(DVec3);

impl Domain for Block {
    fn bounds(&self) -> (DVec3, DVec3) {
        (DVec3::ZERO, self.0)
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        // The particles on the faces count as inside.
        let inside = p.min(self.0 - p).min_element() + 1e-6 * self.0.max_element();
        weights.push((1, inside));
    }
}

/// The bar in ballistic flight: x = x₀ + v t + ½ g t².
fn falling(gpu: &Gpu) -> Result<MotionTrial> {
    let kappa = 3_000.0;
    let mesh = generate::paper_bar()?;
    let mut body = body(gpu, mesh, &Material::uniform_springs(kappa, 0.0), |_| false)?;
    body.loads_mut().set_gravity(GRAVITY);
    let thrown = DVec3::new(1.0, 0.5, 2.0);
    let rest = MotionState::rest(body.as_ref()).x;
    let exact = move |t: f64| MotionState {
        x: rest
            .iter()
            .map(|x| *x + t * thrown + 0.5 * t * t * GRAVITY)
            .collect(),
        v: vec![thrown + t * GRAVITY; rest.len()],
    };
    let (stiffness, start) = ((kappa, "N/m"), Some(exact(0.0)));
    let trial = MotionTrial::of_model(gpu, "falling", stiffness, DURATION, body, start)?;
    Ok(trial.with_exact_solution(Box::new(exact)))
}

/// A regular tet in its breathing mode: its six springs oscillate together, s'' = −(4κ/m)(s − L),
/// at any amplitude.
fn breathing(gpu: &Gpu) -> Result<MotionTrial> {
    let (kappa, stretch) = (10.0, 0.1);
    let corners = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]];
    let nodes = corners.map(|c| 0.05 * DVec3::from(c.map(f64::from)));
    let mesh = TetMesh::new(nodes.to_vec(), vec![[0, 1, 2, 3]], Vec::new(), Vec::new())?;
    let body = body(gpu, mesh, &Material::uniform_springs(kappa, 0.0), |_| false)?;
    let rest = MotionState::rest(body.as_ref()).x;
    let omega = (4.0 * kappa / body.masses()[0]).sqrt();
    let middle = rest.iter().sum::<DVec3>() / 4.0;
    let exact = move |t: f64| {
        let of = |by: f64, x: &DVec3| by * (*x - middle);
        let (sin, cos) = (omega * t).sin_cos();
        MotionState {
            x: rest.iter().map(|x| *x + of(stretch * cos, x)).collect(),
            v: rest.iter().map(|x| of(-stretch * omega * sin, x)).collect(),
        }
    };
    let (stiffness, start) = ((kappa, "N/m"), Some(exact(0.0)));
    let trial = MotionTrial::of_model(gpu, "spring", stiffness, 2.0 * DURATION, body, start)?;
    Ok(trial.with_exact_solution(Box::new(exact)))
}

/// Maximum cost of the reference motion of a scene, in spring evaluations: a minute or two.
const REFERENCE_BUDGET: f64 = 5e9;
/// Overhead per step, in spring evaluations.
const STEP: f64 = 1e3;

/// Returns the trial of the user's scene, over the duration of its steps.
pub fn of_file(gpu: &Gpu, path: &Path) -> Result<MotionTrial> {
    let scene = Scene::read(path)?;
    let refused = |what: &str| {
        Error::Input(format!(
            "{}: the motion study supports tetrahedral bodies with pins, gravity and forces, not {what}; remove it from the scene",
            path.display()
        ))
    };
    if scene.grid.is_some() {
        return Err(refused("grids"));
    }
    if scene.floor.is_some() {
        return Err(refused("floors"));
    }
    if !(scene.grab.is_empty() && scene.cut.is_empty()) {
        return Err(refused("grabs or cuts"));
    }
    if let Some(entry) = scene.tets_only_entry() {
        return Err(refused(entry));
    }
    let mesh = scene.mesh_of_one()?;
    let kind = scene.solver.name.as_deref().unwrap_or("implicit").parse()?;
    let (motion, _) = Motion::new(gpu, &scene, kind, mesh, None)?;
    let duration = motion.dt * f64::from(scene.solver.steps.unwrap_or(50).max(1));
    let simulator = motion.simulator;
    let Some(discrete_model) = simulator.model() else {
        return Err(refused("cages"));
    };
    if !discrete_model.rigid_bodies().is_empty() {
        return Err(refused("rigid regions (unsupported by explicit solvers)"));
    }
    let springs = discrete_model.edges.len();
    let material = &scene.material;
    let stiffness = match material.stiffness {
        Some(kappa) => (kappa, "N/m"),
        None => (material.young.unwrap_or(f64::NAN), "Pa"),
    };
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned());
    let name = stem.unwrap_or_else(|| "scene".into());
    let trial = MotionTrial::of_model(gpu, &name, stiffness, duration, simulator, None)?;
    // The reference takes at least three motions, the last with four times as many steps.
    let steps = 4.0 * 7.0 * f64::from(trial.fewest_stable(SolverKind::VelocityVerlet));
    if steps * (STEP + springs as f64) > REFERENCE_BUDGET {
        return Err(Error::Input(format!(
            "{}: the reference motion of {springs} springs over {duration} s needs {steps:.1e} steps in float64, which takes too long; use a coarser mesh, fewer steps, less stiffness or less damping",
            path.display()
        )));
    }
    Ok(trial)
}
