//! Common behaviour of all simulators, of any kind and engine: one trait, one set of tests.

use crate::support::gpu;
use glam::{DMat3, DVec3};
use palpate::Error;
use palpate::cage::{Cage, CageKind, EmbeddedSimulator};
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{Blade, TetMesh};
use palpate::mesher::Domain;
use palpate::physics::grid::{GridModel, GridShape};
use palpate::physics::{
    CpuGrid, CpuTets, DiscreteModel, Engine, EngineChoice, GpuGrid, GpuTets, GrabMode, GridBody,
    Material, MaterialModel, Member, MultiBody, Precision, Simulator, SolverKind,
};

const SIZE: DVec3 = DVec3::new(0.2, 0.05, 0.05);

pub(super) fn material() -> Material {
    Material {
        damping_time: 2e-3,
        ..Material::from_young(3e4)
    }
}

/// The box from the origin to a corner.
struct Block;

impl Domain for Block {
    fn bounds(&self) -> (DVec3, DVec3) {
        (DVec3::ZERO, SIZE)
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        weights.push((1, p.min(SIZE - p).min_element() + 1e-6));
    }
}

pub(super) fn bar() -> TetMesh {
    generate::bar_of_about(600, SIZE).unwrap()
}

fn particles() -> GridModel {
    let shape = GridShape::from_domain(&Block, DVec3::splat(0.0125), DMat3::IDENTITY).unwrap();
    let mut model = GridModel::new(shape, &material()).unwrap();
    model.damping = 4.0;
    model
}

fn gpu_grid(gpu: &Gpu) -> GpuGrid {
    let body = GridBody::new(gpu, particles()).unwrap();
    let mesh = body.mesh().clone();
    GpuGrid::new(gpu, body, mesh).unwrap()
}

pub(super) fn cpu_grid(gpu: &Gpu) -> CpuGrid {
    let model = particles();
    let mesh = model.shape.mesh(&model.springs).unwrap();
    CpuGrid::new(gpu, model, mesh, Precision::Single).unwrap()
}

pub(super) fn carried(gpu: &Gpu, choice: EngineChoice) -> EmbeddedSimulator {
    let (mesh, material) = (bar(), material());
    let fine = DiscreteModel::new(&mesh, &material).unwrap();
    let cage = Cage::new(&mesh, &fine, CageKind::Lattice, 100).unwrap();
    let own = (cage.mesh.clone(), cage.model.clone());
    let how = (SolverKind::Implicit, Default::default());
    let inner = choice
        .build_tets_from_model(gpu, own, &material, how)
        .unwrap();
    EmbeddedSimulator::new(gpu, mesh, cage, inner).unwrap()
}

const ELEMENTS: [MaterialModel; 2] = [MaterialModel::NeoHookean, MaterialModel::Corotated];

/// Returns a bar on the GPU and another behind it on the CPU, which takes two substeps.
fn two(gpu: &Gpu) -> MultiBody {
    let mut other = bar();
    other.nodes.iter_mut().for_each(|p| p.y += 0.07);
    let implicit = SolverKind::Implicit;
    let one = GpuTets::new(gpu, bar(), &material(), implicit).unwrap();
    let settings = Default::default();
    let other = CpuTets::new(
        gpu,
        other,
        &material(),
        implicit,
        settings,
        Precision::Single,
    )
    .unwrap();
    let member = |name: &str, simulator, step| Member {
        name: name.into(),
        simulator,
        step,
    };
    let members = vec![
        member("one", Box::new(one), 0.005),
        member("other", Box::new(other), 0.0025),
    ];
    MultiBody::new(gpu, members).unwrap()
}

/// Returns one simulator of each kind, by name, with a suitable step.
fn all() -> Vec<(String, Box<dyn Simulator>, f64)> {
    let gpu = gpu();
    let mut all: Vec<(String, Box<dyn Simulator>)> = Vec::new();
    for kind in SolverKind::ALL {
        let tets = GpuTets::new(&gpu, bar(), &material(), kind).unwrap();
        all.push((format!("gpu {kind}"), Box::new(tets)));
        let tets = CpuTets::new(
            &gpu,
            bar(),
            &material(),
            kind,
            Default::default(),
            Precision::Single,
        );
        all.push((format!("cpu {kind}"), Box::new(tets.unwrap())));
    }
    let settings = Default::default();
    let tets = CpuTets::new(
        &gpu,
        bar(),
        &material(),
        SolverKind::Implicit,
        settings,
        Precision::Double,
    );
    all.push(("cpu f64 implicit".into(), Box::new(tets.unwrap())));
    for model in ELEMENTS {
        let material = Material {
            model,
            ..material()
        };
        let tets = GpuTets::new(&gpu, bar(), &material, SolverKind::Implicit).unwrap();
        all.push((format!("gpu {model}"), Box::new(tets)));
        let tets = CpuTets::new(
            &gpu,
            bar(),
            &material,
            SolverKind::Implicit,
            settings,
            Precision::Single,
        );
        all.push((format!("cpu {model}"), Box::new(tets.unwrap())));
    }
    all.push(("gpu grid".into(), Box::new(gpu_grid(&gpu))));
    all.push(("cpu grid".into(), Box::new(cpu_grid(&gpu))));
    for engine in [Engine::Gpu, Engine::Cpu] {
        let choice = EngineChoice::Exactly(engine);
        all.push((
            format!("carried by {engine}"),
            Box::new(carried(&gpu, choice)),
        ));
    }
    all.push(("two bodies".into(), Box::new(two(&gpu))));
    let with_step = all.into_iter().map(|(name, simulator)| {
        let dt = simulator.largest_stable_step().map_or(0.005, |h| 0.4 * h);
        (name, simulator, dt)
    });
    with_step.collect()
}

/// Pins the lower end along x, and applies gravity.
pub(super) fn hold(simulator: &mut dyn Simulator) {
    let nodes = simulator.mesh().nodes.iter().enumerate();
    let held: Vec<u32> = nodes
        .filter(|(_, p)| p.x < 0.02)
        .map(|(i, _)| i as u32)
        .collect();
    simulator.pin_nodes(&held).unwrap();
    let gravity = DVec3::new(0.0, 0.0, -9.81);
    simulator.loads_mut().set_gravity(gravity);
}

fn tip(simulator: &dyn Simulator) -> f64 {
    let (rest, now) = (&simulator.mesh().nodes, simulator.positions().unwrap());
    let end = rest.iter().zip(&now).filter(|(p, _)| p.x > SIZE.x - 1e-6);
    let sunk: Vec<f64> = end.map(|(p, q)| p.z - q.z).collect();
    sunk.iter().sum::<f64>() / sunk.len() as f64
}

#[test]
fn all_simulators_bend_equally_under_weight() {
    let mut tips = Vec::new();
    for (name, mut simulator, dt) in all() {
        hold(simulator.as_mut());
        let time = 0.12;
        let steps = (time / dt).round() as u32;
        let progress = simulator.run(steps, dt).unwrap();
        assert_eq!(progress.steps, u64::from(steps), "{name}");
        assert!(
            (progress.time - f64::from(steps) * dt).abs() < 1e-9,
            "{name}"
        );
        println!("{name}: {:.5}", tip(simulator.as_ref()));
        tips.push((name.clone(), tip(simulator.as_ref())));
        let report = simulator.report().unwrap();
        assert!(report.energy.elastic > 0.0 && report.inverted_tets == 0);
        // That of a mesh in a cage is of the cage, and that of several bodies the largest.
        if name.starts_with("carried") || name.starts_with("two") {
            continue;
        }
        let speed = simulator.rms_speed();
        let mass: f64 = simulator.masses().iter().sum();
        // In body sizes per second.
        let kinetic = 0.5 * mass * (speed * SIZE.max_element()).powi(2);
        assert!(
            (kinetic / report.energy.kinetic - 1.0).abs() < 1e-3,
            "{name}: {kinetic} {:?}",
            report.energy
        );
    }
    let of = |name: &str| tips.iter().find(|t| t.0 == name).map_or(f64::NAN, |t| t.1);
    for kind in SolverKind::ALL {
        let (gpu, cpu) = (of(&format!("gpu {kind}")), of(&format!("cpu {kind}")));
        assert!((gpu / cpu - 1.0).abs() < 2e-3, "{kind}: {gpu} {cpu}");
    }
    let (single, double) = (of("cpu implicit"), of("cpu f64 implicit"));
    assert!((single / double - 1.0).abs() < 2e-3, "{single} {double}");
    // Newton starts from other initial guesses: the remaining errors differ.
    for model in ELEMENTS {
        let (gpu, cpu) = (of(&format!("gpu {model}")), of(&format!("cpu {model}")));
        assert!((gpu / cpu - 1.0).abs() < 2e-2, "{model}: {gpu} {cpu}");
    }
    let (gpu, cpu) = (of("carried by gpu"), of("carried by cpu"));
    assert!((gpu / cpu - 1.0).abs() < 2e-3, "{gpu} {cpu}");
    let (gpu, cpu) = (of("gpu grid"), of("cpu grid"));
    assert!((gpu / cpu - 1.0).abs() < 2e-3, "{gpu} {cpu}");
    assert!((gpu / 0.07443 - 1.0).abs() < 1e-3, "{gpu}");
}

#[test]
fn requested_steps_complete() {
    for (name, mut simulator, dt) in all() {
        hold(simulator.as_mut());
        simulator.advance(7, dt).unwrap();
        simulator.advance(5, dt).unwrap();
        let mut known = 0;
        let start = std::time::Instant::now();
        while known < 12 {
            let now = simulator.progress().unwrap().steps;
            assert!(now >= known && now <= 12, "{name}: {known} {now}");
            known = now;
            assert!(start.elapsed().as_secs() < 600, "{name}: {known} steps");
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        assert_eq!(simulator.finish().unwrap().steps, 12, "{name}");
        // The rendered positions are current, and the change is detected.
        let before = simulator.nodes().version();
        let gpu = gpu();
        simulator.run(3, dt).unwrap();
        let mut work = gpu.start_recording();
        simulator.update_nodes(&mut work).unwrap();
        work.submit().unwrap();
        assert_ne!(simulator.nodes().version(), before, "{name}");
        let drawn = simulator.nodes().positions().unwrap();
        let there = simulator.positions().unwrap();
        let apart = drawn.iter().zip(&there).map(|(a, b)| a.distance(*b));
        assert!(apart.fold(0.0, f64::max) < 1e-7, "{name}");
        assert!(simulator.advance(1, f64::NAN).is_err(), "{name}");
        assert!(simulator.advance(1, -dt).is_err(), "{name}");
    }
}

#[test]
fn resumed_state_is_bitwise_identical() {
    for ((name, mut one, dt), (_, mut other, _)) in all().into_iter().zip(all()) {
        for simulator in [&mut one, &mut other] {
            hold(simulator.as_mut());
        }
        let grab = |s: &mut dyn Simulator| {
            let at = DVec3::new(0.2, 0.025, 0.025);
            let grip = GrabMode::Spring {
                stiffness: 20.0,
                limit: 0.5,
            };
            let grab = s.grab(at, 0.02, grip).unwrap();
            s.set_target(grab, at + DVec3::new(0.0, 0.01, 0.0)).unwrap();
        };
        grab(one.as_mut());
        one.run(6, dt).unwrap();
        let state = one.checkpoint().unwrap().state().unwrap();
        other.checkpoint_mut().unwrap().set_state(&state).unwrap();
        assert_eq!(one.change_count(), other.change_count(), "{name}");
        let a = one.run(5, dt).unwrap();
        let b = other.run(5, dt).unwrap();
        assert_eq!(a, b, "{name}");
        assert_eq!(
            one.positions().unwrap(),
            other.positions().unwrap(),
            "{name}"
        );
        assert_eq!(one.velocities().unwrap(), other.velocities().unwrap());
        // The check is effective: an independent simulator is elsewhere.
        other.run(1, dt).unwrap();
        assert_ne!(one.positions().unwrap(), other.positions().unwrap());
    }
}

#[test]
fn grabs_hold_and_cuts_separate() {
    for (name, mut simulator, dt) in all() {
        hold(simulator.as_mut());
        let touched = simulator.change_count();
        let at = DVec3::new(0.2, 0.025, 0.025);
        let grab = simulator.grab(at, 0.02, GrabMode::Follow).unwrap();
        let rest = simulator.mesh().nodes.clone();
        let moves = |i: &usize| simulator.masses().get(*i).is_none_or(|m| *m > 0.0);
        let free = (0..rest.len()).filter(moves);
        let grabbed = free.filter(|i| rest[*i].distance(at) <= 0.02).count();
        let target = at + DVec3::new(0.0, 0.02, 0.0);
        simulator.set_target(grab, target).unwrap();
        assert_ne!(simulator.change_count(), touched, "{name}");
        simulator.run(4, dt).unwrap();
        let near = (0..rest.len())
            .filter(|i| simulator.masses().get(*i).is_none_or(|m| *m > 0.0))
            .min_by(|a, b| rest[*a].distance(at).total_cmp(&rest[*b].distance(at)))
            .unwrap();
        let moved = simulator.positions().unwrap()[near] - rest[near];
        // A mesh in a cage follows the grabbed nodes of the cage.
        let near = if name.starts_with("carried") {
            8e-3
        } else {
            1e-6
        };
        assert!((moved.y - 0.02).abs() < near, "{name}: {moved}");
        let released = simulator.release(grab).unwrap();
        if !name.starts_with("carried") {
            assert_eq!(released, grabbed, "{name}");
        }
        assert!(released > 0 && simulator.release(grab).is_err(), "{name}");
        let x = 0.101;
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let blade = Blade::from_quad(corners.map(|[y, z]| DVec3::new(x, y, z))).unwrap();
        let mass: f64 = simulator.masses().iter().sum();
        let ties = simulator.edge_nodes().len();
        if name.starts_with("carried") {
            assert!(simulator.cut(&blade).is_err());
            continue;
        }
        let nodes = rest.len();
        let change = simulator.cut(&blade).unwrap();
        assert!(!change.is_empty(), "{name}");
        let doubled = change.mesh.duplicated_nodes.len();
        assert_eq!(simulator.mesh().nodes.len(), nodes + doubled, "{name}");
        assert_eq!(simulator.nodes().len(), nodes + doubled, "{name}");
        assert_eq!(simulator.edge_nodes().len() > ties, doubled > 0, "{name}");
        assert!((simulator.masses().iter().sum::<f64>() / mass - 1.0).abs() < 1e-9);
        simulator.run(20, dt).unwrap();
        // A second cut in the same place hits nothing.
        let away = Blade::from_quad(corners.map(|[y, z]| DVec3::new(9.0, y, z))).unwrap();
        assert!(simulator.cut(&away).unwrap().is_empty(), "{name}");
    }
}

#[test]
fn failure_reports_cause_and_keeps_last_valid_state() {
    for (name, mut simulator, dt) in all() {
        hold(simulator.as_mut());
        if simulator.largest_stable_step().is_none() {
            continue;
        }
        simulator.run(3, dt).unwrap();
        let error = simulator.run(4000, 40.0 * dt).unwrap_err();
        let Error::Solver { advice, .. } = &error else {
            panic!("{name}: {error}");
        };
        assert!(advice.contains("--dt"), "{name}: {error}");
        let there = simulator.positions().unwrap();
        assert!(there.iter().all(|p| p.is_finite()), "{name}");
        // It continues with a stable step.
        let rest = simulator.mesh().nodes.clone();
        simulator.set_positions(&rest).unwrap();
        simulator
            .set_velocities(&vec![DVec3::ZERO; rest.len()])
            .unwrap();
        simulator.run(3, dt).unwrap();
    }
}
