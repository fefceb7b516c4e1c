//! The paper's bar.

use super::common::solver;
use glam::DVec3;
use palpate::Error;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::physics::{GpuBody, Material, Report, SolverKind, largest_stable_step};

/// Returns the bar, pinned at one end, under gravity.
fn bar(gpu: &Gpu, stiffness: f64, damping: f64) -> GpuBody {
    let mesh = generate::paper_bar().unwrap();
    let mut body =
        GpuBody::new(gpu, &mesh, &Material::uniform_springs(stiffness, damping)).unwrap();
    assert_eq!(body.pin(|p| p.x < 0.001), 9);
    body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
    body
}

#[test]
fn stable_step_matches_paper() {
    let gpu = Gpu::new().unwrap();
    for (stiffness, limit) in [(3_000.0, 1.08e-3), (30_000.0, 3.42e-4)] {
        let body = bar(&gpu, stiffness, 0.0);
        let free = vec![false; body.node_count()];
        let step = largest_stable_step(body.model(), &free, SolverKind::Verlet).unwrap();
        assert!((step - limit).abs() < 0.005 * limit, "{step}");
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn implicit_euler_is_stable_for_a_thousand_large_steps() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    for stiffness in [30_000.0, 300_000.0] {
        for load in [0.0, 40.0] {
            let mut body = bar(&gpu, stiffness, 0.0);
            if load > 0.0 {
                let end = body
                    .add_force(DVec3::new(0.0, 0.0, -load), |p| p.x > 0.119)
                    .unwrap();
                assert_eq!(end, 9);
            }
            let mut implicit = solver(&gpu, &body, SolverKind::Implicit);
            let progress = implicit.run(&mut body, 1000, 0.01).unwrap();
            assert_eq!(progress.steps, 1000);
            let report = Report::new(&body, &mesh).unwrap();
            assert_eq!(report.inverted_tets, 0);
            assert!((report.volume_ratio - 1.0).abs() < 0.05, "{report:?}");
            // 10 seconds later it hangs at rest.
            assert!(report.energy.kinetic < 1e-6, "{report:?}");
            if load > 0.0 && stiffness == 30_000.0 {
                assert!(report.max_displacement > 0.01 * 0.12, "{report:?}");
            }
        }
    }
}

#[test]
fn verlet_is_stable_for_small_steps_and_rejects_large_ones() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    let mut body = bar(&gpu, 3_000.0, 0.0);
    body.add_force(DVec3::new(0.0, 0.0, -12.0), |p| p.x > 0.119)
        .unwrap();
    let mut verlet = solver(&gpu, &body, SolverKind::Verlet);
    verlet.run(&mut body, 1000, 0.001).unwrap();
    let report = Report::new(&body, &mesh).unwrap();
    // In the float32 of another driver it may differ in the fifth digit.
    assert!(
        (report.max_displacement / 5.951e-3 - 1.0).abs() < 0.01,
        "{report:?}"
    );

    let mut body = bar(&gpu, 3_000.0, 0.0);
    let mut verlet = solver(&gpu, &body, SolverKind::Verlet);
    let error = verlet.run(&mut body, 100, 0.01).unwrap_err();
    let text = error.to_string();
    let Error::Solver {
        solver: name,
        step,
        time,
        ..
    } = error
    else {
        panic!("{text}");
    };
    assert_eq!(name, "verlet");
    assert!(step > 1 && step < 30, "{text}");
    assert!((time - 0.01 * (step - 1) as f64).abs() < 1e-12, "{text}");
    assert!(text.contains("--dt 0.001 or less"), "{text}");
    assert!(text.contains("--solver implicit"), "{text}");
    // The last valid state is kept.
    let frozen = body.positions().unwrap();
    assert!(frozen.iter().all(|p| p.is_finite()));
    let report = Report::new(&body, &mesh).unwrap();
    assert!(report.max_displacement < 0.12, "{report:?}");
    verlet.step(&mut body, 0.01).unwrap();
    assert!(verlet.poll(&body).is_err());
    assert_eq!(frozen, body.positions().unwrap());
    // After an external change it continues.
    body.set_positions(&mesh.nodes).unwrap();
    body.set_velocities(&vec![DVec3::ZERO; mesh.nodes.len()])
        .unwrap();
    verlet.run(&mut body, 10, 0.001).unwrap();
}

/// The estimate of the largest stable step, including damping, is stable and nearly sharp.
#[test]
#[ignore = "long: scripts/test --full"]
fn estimated_stable_step_is_stable_and_sharp() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    let damped = |damping_time: f64, damping: f64| Material {
        damping_time,
        damping,
        ..Material::from_young(1e5)
    };
    for material in [damped(0.0, 0.0), damped(1e-3, 0.0), damped(0.0, 0.2)] {
        for kind in [
            SolverKind::Explicit,
            SolverKind::Symplectic,
            SolverKind::Verlet,
            SolverKind::VelocityVerlet,
        ] {
            let run = |factor: f64| {
                let mut body = GpuBody::new(&gpu, &mesh, &material).unwrap();
                let limit = largest_stable_step(body.model(), body.pinned(), kind).unwrap();
                let pushed: Vec<DVec3> = mesh
                    .nodes
                    .iter()
                    .map(|p| DVec3::new((900.0 * p.y).sin(), (700.0 * p.z).sin(), p.x))
                    .map(|v| 1e-3 * v)
                    .collect();
                body.set_velocities(&pushed).unwrap();
                let mut stepper = solver(&gpu, &body, kind);
                (limit, stepper.run(&mut body, 1500, factor * limit))
            };
            let undamped = material.damping + material.damping_time == 0.0;
            if kind == SolverKind::Explicit && undamped {
                let mut body = GpuBody::new(&gpu, &mesh, &material).unwrap();
                let limit = largest_stable_step(body.model(), body.pinned(), kind);
                assert_eq!(limit, Some(0.0));
                assert!(solver(&gpu, &body, kind).run(&mut body, 1, 1e-4).is_ok());
                continue;
            }
            let (limit, held) = run(0.97);
            assert!(held.is_ok(), "{kind}, {limit} s: {}", held.unwrap_err());
            let (limit, broken) = run(if undamped { 1.05 } else { 2.5 });
            assert!(
                broken.is_err(),
                "{kind} is stable far beyond the limit of {limit} s"
            );
        }
    }
}
