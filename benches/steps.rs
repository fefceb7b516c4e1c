//! Milliseconds a step of every solver, on the GPU and of its float64 twin on the CPU.
//!
//!     cargo bench --bench steps -- [TETS …] [--solver NAME] [--dt S] [--no-twin]
//!
//! The body is the bar of the physics peers: 0.8 × 0.2 × 0.2 m, 1000 kg/m³, E = 1 MPa, one end
//! held, gravity across, 0.01 s a step; explicit solvers take half their largest stable step.

use glam::DVec3;
use palpate::gpu::Gpu;
use palpate::mesh::generate;
use palpate::physics::plain::springs::Particles;
use palpate::physics::plain::steppers;
use palpate::physics::{Body, Material, SolverKind, SpringNetwork, largest_stable_step};
use std::time::{Duration, Instant};

fn main() -> palpate::Result<()> {
    let mut sizes = Vec::new();
    let mut kinds = SolverKind::ALL.to_vec();
    let (mut twin, mut dt) = (true, 0.01);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--no-twin" => twin = false,
            "--solver" => kinds = vec![arguments.next().unwrap_or_default().parse()?],
            "--dt" => dt = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(dt),
            size => sizes.extend(size.parse::<usize>()),
        }
    }
    if sizes.is_empty() {
        sizes = vec![80, 4_320, 34_560];
    }
    let gpu = Gpu::new()?;
    println!("{}", gpu.adapter_name());
    println!("   tets   nodes  solver             dt s    GPU ms   CPU ms  iterations");
    for size in sizes {
        let mesh = generate::bar_of_about(size, DVec3::new(0.8, 0.2, 0.2))?;
        for &kind in &kinds {
            let material = Material::young(1e6);
            let mut body = Body::new(&gpu, &mesh, &material)?;
            body.pin(|p| p.x < 1e-6);
            body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
            let stable = largest_stable_step(body.network(), body.pinned(), kind);
            // Explicit Euler, never stable, gets a few steps before that shows.
            let h = match stable {
                None => dt,
                Some(0.0) => 1e-7,
                Some(step) => 0.5 * step,
            };
            let mut solver = kind.solver(&gpu, &body)?;
            solver.run(&mut body, 4, h)?;
            let (gpu_ms, iterations) = {
                let steps = repeat(|| solver.run(&mut body, 8, h).map(|_| ()))?;
                let history = solver.history(&body)?;
                let sum: u32 = history.iter().map(|s| s.iterations).sum();
                (steps / 8.0, f64::from(sum) / history.len() as f64)
            };
            let mut p = Particles::new(SpringNetwork::new(&mesh, &material)?);
            p.pinned = body.pinned().to_vec();
            p.gravity = body.gravity();
            let mut verlet = steppers::Verlet::default();
            let mut velocity_verlet = steppers::VelocityVerlet::default();
            let cpu_ms = match twin {
                false => f64::NAN,
                true => repeat(|| {
                    match kind {
                        SolverKind::Explicit => steppers::explicit_euler(&mut p, h),
                        SolverKind::Symplectic => steppers::symplectic_euler(&mut p, h),
                        SolverKind::Verlet => verlet.step(&mut p, h),
                        SolverKind::VelocityVerlet => velocity_verlet.step(&mut p, h),
                        SolverKind::Implicit => {
                            steppers::implicit_euler(&mut p, h, 1e-4);
                        }
                    }
                    Ok(())
                })?,
            };
            println!(
                "{:>7} {:>7}  {:<15} {h:>8.1e} {gpu_ms:>9.3} {cpu_ms:>8.3}  {iterations:>6.1}",
                mesh.tets.len(),
                mesh.nodes.len(),
                kind.name()
            );
        }
    }
    Ok(())
}

/// Median milliseconds of `work`, over about a second.
fn repeat(mut work: impl FnMut() -> palpate::Result<()>) -> palpate::Result<f64> {
    let mut times = Vec::new();
    let begin = Instant::now();
    while times.len() < 3 || begin.elapsed() < Duration::from_secs(1) {
        let start = Instant::now();
        work()?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}
