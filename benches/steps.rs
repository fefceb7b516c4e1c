//! Milliseconds per step of every solver on both engines, alternating: of the bar of the physics
//! peers, of a limb, or of a mesh file.
//!
//!     cargo bench --bench steps -- [TETS … | limb:TETS | FILE …] [--solver NAME] [--dt S]
//!                                  [--bone FACTOR] [--unit M] [--engine NAME]
//!                                  [--material MODEL] [--poisson RATIO] [--volume VOLUME]
//!                                  [--rod FACTOR] [--error]
//!
//! The bar is 0.8 × 0.2 × 0.2 m, 1000 kg/m³, E = 1 MPa; limb and files have 30 kPa, the bones of a
//! limb FACTOR times the stiffness (1,000 by default). One end is clamped, with transverse gravity
//! and steps of 0.01 s; explicit solvers use half their largest stable step. Linear solves have a
//! tolerance of 10⁻³. `--rod` makes the core of the bar FACTOR times as stiff from end to end.
//! `--error` prints the deviation over 100 steps from rest from those in float64 solved to the last
//! digits: root mean square over the masses and the steps, relative to the displacement.

use glam::DVec3;
use palpate::bench::{Timing, hold_one_end};
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{Field, Location, TetMesh};
use palpate::physics::{
    CgSettings, CpuTets, Engine, EngineChoice, Material, MaterialModel, Precision, RegionMaterial,
    Simulator, SolverKind, Stiffness, VolumetricFormulation,
};
use std::time::Duration;

fn main() -> palpate::Result<()> {
    let mut bodies = Vec::new();
    let mut kinds = SolverKind::ALL.to_vec();
    let mut engines = vec![Engine::Gpu, Engine::Cpu];
    let (mut dt, mut bone, mut unit) = (0.01, 1000.0, 1.0);
    let (mut model, mut poisson, mut rod, mut wants_error) =
        (MaterialModel::Springs, 0.3, 1.0, false);
    let mut volume = VolumetricFormulation::default();
    let mut arguments = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(argument) = arguments.next() {
        let mut number = |default: f64| {
            let next = arguments.next();
            next.and_then(|s| s.parse().ok()).unwrap_or(default)
        };
        match argument.as_str() {
            "--dt" => dt = number(dt),
            "--bone" => bone = number(bone),
            "--unit" => unit = number(unit),
            "--poisson" => poisson = number(poisson),
            "--rod" => rod = number(1000.0),
            "--error" => wants_error = true,
            "--material" => model = arguments.next().unwrap_or_default().parse()?,
            "--volume" => volume = arguments.next().unwrap_or_default().parse()?,
            "--solver" => kinds = vec![arguments.next().unwrap_or_default().parse()?],
            "--engine" => match arguments.next().unwrap_or_default().parse()? {
                EngineChoice::Exactly(engine) => engines = vec![engine],
                EngineChoice::Auto => {}
            },
            body => bodies.push(body.to_owned()),
        }
    }
    if bodies.is_empty() {
        bodies = ["80", "4320", "34560"].map(String::from).to_vec();
    }
    let gpu = Gpu::new()?;
    println!("{}", gpu.adapter_name());
    println!(
        "   tets   nodes  solver           engine      dt s ms per step  iterations     error"
    );
    for body in &bodies {
        let (mut mesh, mut material) = named(body, bone, unit)?;
        (material.model, material.poisson, material.volume) = (model, poisson, volume);
        if rod != 1.0 {
            stiffen(&mut mesh, &mut material, rod)?;
        }
        for &kind in &kinds {
            for &engine in &engines {
                let choice = EngineChoice::Exactly(engine);
                if SolverKind::ELEMENT_ONLY.contains(&kind)
                    && (model == MaterialModel::Springs || engine == Engine::Gpu)
                {
                    continue;
                }
                let mut body = choice.build_tets(&gpu, mesh.clone(), &material, kind)?;
                hold_one_end(body.as_mut())?;
                // Explicit Euler, never stable, runs a few steps before it diverges.
                let h = match body.largest_stable_step() {
                    None => dt,
                    Some(0.0) => 1e-7,
                    Some(step) => 0.5 * step,
                };
                let (ms, iterations) = timed(body.as_mut(), h)?;
                let off = match wants_error {
                    true => {
                        let mut tight = settings(1e-9);
                        tight.max_iterations = 20_000;
                        let (mesh, made) = (mesh.clone(), &material);
                        let mut truth =
                            CpuTets::new(&gpu, mesh, made, kind, tight, Precision::Double)?;
                        hold_one_end(&mut truth)?;
                        format!("{:.1e}", error(body.as_mut(), &mut truth, h)?)
                    }
                    false => String::new(),
                };
                println!(
                    "{:>7} {:>7}  {:<15}  {engine:<6} {h:>9.1e} {ms:>11.3}  {iterations:>10.1}  {off:>8}",
                    mesh.tets.len(),
                    mesh.nodes.len(),
                    kind.name()
                );
            }
        }
    }
    Ok(())
}

fn settings(tolerance: f64) -> CgSettings {
    CgSettings {
        tolerance,
        ..CgSettings::default()
    }
}

/// Returns the deviation of 100 steps of `body` from rest from those of `truth`, relative to the
/// displacement.
fn error(body: &mut dyn Simulator, truth: &mut dyn Simulator, h: f64) -> palpate::Result<f64> {
    body.restart()?;
    let masses = truth.masses().to_vec();
    let (mut off, mut way) = (0.0, 0.0);
    for _ in 0..100 {
        body.run(1, h)?;
        truth.run(1, h)?;
        let (found, expected) = (body.positions()?, truth.positions()?);
        for (i, m) in masses.iter().enumerate() {
            off += m * found[i].distance_squared(expected[i]);
            way += m * expected[i].distance_squared(truth.mesh().nodes[i]);
        }
    }
    Ok((off / way).sqrt())
}

/// Makes a rod through the core of a bar, from end to end, `factor` times as stiff.
fn stiffen(mesh: &mut TetMesh, material: &mut Material, factor: f64) -> palpate::Result<()> {
    let (low, high) = mesh.bounds();
    let middle = 0.5 * (low + high);
    let reach = 0.2 * (high - low).min_element();
    let inside = |t: usize| {
        let corners = mesh.tet_nodes(t);
        let away = (corners.iter().sum::<DVec3>() / 4.0 - middle).abs();
        away.y < reach && away.z < reach
    };
    let labels = (0..mesh.tets.len()).map(|t| f64::from(u8::from(inside(t))));
    let labels = labels.collect();
    mesh.fields
        .push(Field::scalar("rod", Location::Cell, labels));
    let Stiffness::Young(young) = material.stiffness else {
        return Ok(());
    };
    let rod = RegionMaterial {
        stiffness: factor * young,
        density: material.density,
        poisson: material.poisson,
    };
    material.region_field = Some("rod".into());
    material.regions.insert(1, rod);
    Ok(())
}

/// Returns the mesh and material of that name.
fn named(body: &str, bone: f64, unit: f64) -> palpate::Result<(TetMesh, Material)> {
    if let Ok(tets) = body.parse() {
        let mesh = generate::bar_of_about(tets, DVec3::new(0.8, 0.2, 0.2))?;
        return Ok((mesh, Material::from_young(1e6)));
    }
    if let Some(tets) = body.strip_prefix("limb:").and_then(|n| n.parse().ok()) {
        let hard = generate::TISSUES
            .iter()
            .filter(|t| t.name.ends_with("bone"));
        let stiff = RegionMaterial {
            stiffness: bone * 3e4,
            density: 1800.0,
            poisson: 0.4,
        };
        let material = Material {
            region_field: Some("label".into()),
            regions: hard.map(|t| (i64::from(t.label), stiff)).collect(),
            ..Material::from_young(3e4)
        };
        return Ok((generate::limb(tets)?, material));
    }
    let mesh = palpate::io::read(body)?;
    let material = Material {
        length_unit: mesh.length_unit.unwrap_or(unit),
        ..Material::from_young(3e4)
    };
    Ok((mesh, material))
}

/// Returns median milliseconds per step over about two seconds, and iterations per step.
fn timed(body: &mut dyn Simulator, h: f64) -> palpate::Result<(f64, f64)> {
    let steps = match body.integrator() {
        SolverKind::Implicit => 1,
        _ => 8,
    };
    let timing = Timing {
        budget: Duration::from_secs(2),
        least: 5,
        most: usize::MAX,
    };
    let taken = timing.measure(|| body.run(steps, h).map(drop))?;
    let iterations = body.iterations()?;
    let sum: u32 = iterations.iter().sum();
    let mean = f64::from(sum) / iterations.len().max(1) as f64;
    Ok((taken.median / f64::from(steps), mean))
}
