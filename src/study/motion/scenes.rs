//! The bodies that the study of motion moves.

use super::trial::Trial;
use crate::gpu::Gpu;
use crate::mesh::{TetMesh, generate};
use crate::mesher::Domain;
use crate::physics::grid::{GridBody, GridModel, GridShape};
use crate::physics::plain::truth::State;
use crate::physics::{Body, Material, RegionMaterial, SolverKind};
use crate::scene::{Motion, Scene};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use std::path::Path;

/// Earth's gravity, m/s².
const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);

/// Seconds that most of them move for.
const DURATION: f64 = 0.128;

/// All of them, or those for a quick look.
pub fn all(gpu: &Gpu, quick: bool) -> Result<Vec<Trial>> {
    let mut trials = vec![
        released(gpu, 3_000.0)?,
        released(gpu, 30_000.0)?,
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

/// The paper's bar, one end held, let go under gravity; undamped.
fn released(gpu: &Gpu, kappa: f64) -> Result<Trial> {
    let mesh = generate::paper_bar()?;
    let mut body = Body::new(gpu, &mesh, &Material::paper(kappa, 0.0))?;
    body.pin(|p| p.x < 1e-6);
    body.set_gravity(GRAVITY);
    let stiffness = (kappa, "N/m");
    Trial::tets(gpu, "released", stiffness, DURATION, (mesh, body), None)
}

/// A bar, one end held, the other turned by a radian and let go; damped.
fn twisted(gpu: &Gpu) -> Result<Trial> {
    let size = generate::PAPER_BAR_SIZE;
    let mesh = generate::bar_of_about(640, size)?;
    let material = Material {
        damping_time: 1e-3,
        ..Material::young(5e4)
    };
    let mut body = Body::new(gpu, &mesh, &material)?;
    body.pin(|p| p.x < 1e-6);
    let middle = DVec3::new(0.0, 0.5 * size.y, 0.5 * size.z);
    let turned = mesh.nodes.iter().map(|p| {
        let turn = DMat3::from_rotation_x(p.x / size.x);
        body.network().to_metres(middle + turn * (*p - middle))
    });
    let start = State {
        x: turned.collect(),
        v: vec![DVec3::ZERO; mesh.nodes.len()],
    };
    let stiffness = (5e4, "Pa");
    Trial::tets(
        gpu,
        "twisted",
        stiffness,
        DURATION,
        (mesh, body),
        Some(start),
    )
}

/// The limb phantom, held at the elbow and pressed on the back of its hand; damped, its bones
/// ten times as stiff as the rest.
fn pressed(gpu: &Gpu) -> Result<Trial> {
    let mesh = generate::limb(2_500)?;
    let soft = Material {
        density: 1060.0,
        damping_time: 5e-4,
        region_field: Some("label".into()),
        ..Material::young(5e4)
    };
    let bone = RegionMaterial {
        stiffness: 5e5,
        density: 1800.0,
    };
    let hard = generate::TISSUES
        .iter()
        .filter(|t| t.name.ends_with("bone"));
    let material = Material {
        regions: hard.map(|t| (i64::from(t.label), bone)).collect(),
        ..soft
    };
    let mut body = Body::new(gpu, &mesh, &material)?;
    body.pin(|p| p.x < 0.04);
    body.add_force(DVec3::new(0.0, 0.0, -2.0), |p| p.x > 0.18 && p.x < 0.24)?;
    Trial::tets(
        gpu,
        "pressed",
        (5e4, "Pa"),
        2.0 * DURATION,
        (mesh, body),
        None,
    )
}

/// A block of grid particles, one end held, the other pulled and bent; damped.
fn pulled(gpu: &Gpu) -> Result<Trial> {
    let size = generate::PAPER_BAR_SIZE;
    let shape = GridShape::carve(&Block(size), DVec3::splat(0.01), DMat3::IDENTITY)?;
    let mut model = GridModel::new(shape, &Material::young(5e4))?;
    model.damping = 2.0;
    let mut twin = model.twin();
    let mut body = GridBody::new(gpu, model)?;
    let particles = || body.model().shape.particles();
    let at = |i: usize| body.model().shape.place(i).x;
    let held: Vec<u32> = particles()
        .filter(|i| at(*i) < 1e-6)
        .map(|i| i as u32)
        .collect();
    let end: Vec<usize> = particles().filter(|i| at(*i) > size.x - 1e-6).collect();
    let share = DVec3::new(2.0, 0.0, -1.0) / end.len().max(1) as f64;
    for i in end {
        // As the GPU has it.
        twin.forces[i] = share.as_vec3().as_dvec3();
    }
    body.pin_nodes(&held)?;
    body.set_forces(&twin.forces)?;
    for i in held {
        twin.inverse_masses[i as usize] = 0.0;
    }
    Trial::grid(gpu, "pulled", (5e4, "Pa"), DURATION, body, twin)
}

/// The box from the origin to a corner.
struct Block(DVec3);

impl Domain for Block {
    fn bounds(&self) -> (DVec3, DVec3) {
        (DVec3::ZERO, self.0)
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        // The particles on the faces are in.
        let inside = p.min(self.0 - p).min_element() + 1e-6 * self.0.max_element();
        weights.push((1, inside));
    }
}

/// The bar thrown: x = x₀ + v t + ½ g t².
fn falling(gpu: &Gpu) -> Result<Trial> {
    let kappa = 3_000.0;
    let mesh = generate::paper_bar()?;
    let mut body = Body::new(gpu, &mesh, &Material::paper(kappa, 0.0))?;
    body.set_gravity(GRAVITY);
    let thrown = DVec3::new(1.0, 0.5, 2.0);
    let rest = body.network().rest.clone();
    let exact = move |t: f64| State {
        x: rest
            .iter()
            .map(|x| *x + t * thrown + 0.5 * t * t * GRAVITY)
            .collect(),
        v: vec![thrown + t * GRAVITY; rest.len()],
    };
    let start = exact(0.0);
    let stiffness = (kappa, "N/m");
    let trial = Trial::tets(
        gpu,
        "falling",
        stiffness,
        DURATION,
        (mesh, body),
        Some(start),
    )?;
    Ok(trial.exactly(Box::new(exact)))
}

/// A regular tet that breathes: its six springs swing as one, s'' = −(4κ/m)(s − L), however far.
fn breathing(gpu: &Gpu) -> Result<Trial> {
    let (kappa, stretch) = (10.0, 0.1);
    let corners = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]];
    let nodes = corners.map(|c| 0.05 * DVec3::from(c.map(f64::from)));
    let mesh = TetMesh::new(nodes.to_vec(), vec![[0, 1, 2, 3]], Vec::new(), Vec::new())?;
    let body = Body::new(gpu, &mesh, &Material::paper(kappa, 0.0))?;
    let rest = body.network().rest.clone();
    let omega = (4.0 * kappa / body.network().masses[0]).sqrt();
    let middle = rest.iter().sum::<DVec3>() / 4.0;
    let exact = move |t: f64| {
        let of = |by: f64, x: &DVec3| by * (*x - middle);
        let (sin, cos) = (omega * t).sin_cos();
        State {
            x: rest.iter().map(|x| *x + of(stretch * cos, x)).collect(),
            v: rest.iter().map(|x| of(-stretch * omega * sin, x)).collect(),
        }
    };
    let start = exact(0.0);
    let stiffness = (kappa, "N/m");
    let trial = Trial::tets(
        gpu,
        "spring",
        stiffness,
        2.0 * DURATION,
        (mesh, body),
        Some(start),
    )?;
    Ok(trial.exactly(Box::new(exact)))
}

/// What the truth of a scene may cost, in springs visited: a minute or two.
const AFFORDABLE: f64 = 5e9;
/// What a step costs besides, in springs.
const STEP: f64 = 1e3;

/// The body of a scene of the user's, for as long as the scene's steps take.
pub fn of_file(gpu: &Gpu, path: &Path) -> Result<Trial> {
    let scene = Scene::read(path)?;
    let refused = |what: &str| {
        Error::Input(format!(
            "{}: the study of motion knows bodies of tets under pins, gravity and forces, and not {what}; leave that out of the scene",
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
    let mesh = scene.mesh.load()?;
    let kind = scene.solver.name.as_deref().unwrap_or("implicit").parse()?;
    let (motion, _) = Motion::new(gpu, &scene, kind, mesh, None)?;
    let duration = motion.dt * f64::from(scene.solver.steps.unwrap_or(50).max(1));
    let simulator = motion.simulator;
    let Some(network) = simulator.network() else {
        return Err(refused("cages"));
    };
    let springs = network.springs.len();
    let material = &scene.material;
    let stiffness = match material.stiffness {
        Some(kappa) => (kappa, "N/m"),
        None => (material.young.unwrap_or(f64::NAN), "Pa"),
    };
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned());
    let name = stem.unwrap_or_else(|| "scene".into());
    let trial = Trial::of_springs(&name, stiffness, duration, simulator, None);
    // The truth takes at least three motions, the last of four times as many steps.
    let steps = 4.0 * 7.0 * f64::from(trial.fewest_stable(SolverKind::VelocityVerlet));
    if steps * (STEP + springs as f64) > AFFORDABLE {
        return Err(Error::Input(format!(
            "{}: the true motion of {springs} springs over {duration} s would take {steps:.1e} steps in float64, which takes too long; take a coarser mesh, fewer steps, less stiffness or less damping",
            path.display()
        )));
    }
    Ok(trial)
}
