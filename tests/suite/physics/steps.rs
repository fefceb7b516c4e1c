//! One step and a hundred of every solver, against the float64 reference.

use super::common::{Twins, solver, step_truth};
use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::physics::{CgSettings, Damping, ImplicitEuler, Material, Solver, SolverKind};

fn disturbed(gpu: &Gpu, kind: Damping) -> Twins {
    let material = Material {
        damping: 0.05,
        damping_time: 1e-4,
        damping_kind: kind,
        ..Material::from_young(1e5)
    };
    let mut twins = Twins::new(gpu, &generate::paper_bar().unwrap(), &material);
    twins.pin(|p| p.x < 0.001);
    twins.gravity(DVec3::new(0.5, 0.0, -9.81));
    twins.disturb(0.02, 0.3, 11);
    twins
}

#[test]
fn one_step_of_every_solver_matches_reference() {
    let gpu = Gpu::new().unwrap();
    for damping in [Damping::Axial, Damping::Relative] {
        for kind in SolverKind::ALL {
            let mut twins = disturbed(&gpu, damping);
            let h = if kind == SolverKind::Implicit {
                0.01
            } else {
                2e-4
            };
            let before = twins.truth.clone();
            let mut tight: Box<dyn Solver> = match kind {
                SolverKind::Implicit => {
                    let settings = CgSettings {
                        tolerance: 1e-6,
                        ..CgSettings::default()
                    };
                    Box::new(ImplicitEuler::with(&gpu, &twins.body, settings).unwrap())
                }
                _ => solver(&gpu, &twins.body, kind),
            };
            let progress = tight.run(&mut twins.body, 1, h).unwrap();
            assert_eq!((progress.steps, progress.time), (1, h));
            step_truth(kind, &mut twins.truth, 1, h);
            let change = twins.truth.v.iter().zip(&before.v);
            let change = change.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
            let (dx, dv) = twins.difference();
            assert!(dx < 2e-5 * h * change + 2e-8, "{kind} {damping:?}: {dx} m");
            assert!(
                dv < 2e-5 * change,
                "{kind} {damping:?}: {dv} of {change} m/s"
            );
        }
    }
}

#[test]
fn hundred_steps_of_every_solver_match_reference() {
    let gpu = Gpu::new().unwrap();
    for kind in SolverKind::ALL {
        let mut twins = disturbed(&gpu, Damping::Axial);
        let h = if kind == SolverKind::Implicit {
            0.01
        } else {
            2e-4
        };
        solver(&gpu, &twins.body, kind)
            .run(&mut twins.body, 100, h)
            .unwrap();
        let start = twins.mesh.nodes.clone();
        step_truth(kind, &mut twins.truth, 100, h);
        let (dx, _) = twins.difference();
        let moved = twins.truth.x.iter().zip(&start);
        let moved = moved
            .map(|(x, s)| twins.truth.model.to_file(*x).distance(*s))
            .fold(0.0, f64::max);
        assert!(moved > 0.01 * 0.12, "{kind} moved by only {moved} m");
        // The bar is 0.12 m long.
        assert!(dx < 1e-4 * 0.12, "{kind}: {dx} m of {moved}");
        // The comparison is effective: an additional step changes the state.
        step_truth(kind, &mut twins.truth, 1, h);
        assert!(twins.difference().0 > 2.0 * dx, "{kind}");
    }
}

/// Steps made individually, or recorded in several ways, are identical.
#[test]
fn recorded_and_direct_steps_are_identical() {
    let gpu = Gpu::new().unwrap();
    for kind in SolverKind::ALL {
        let h = if kind == SolverKind::Implicit {
            0.01
        } else {
            2e-4
        };
        let mut run = disturbed(&gpu, Damping::Axial);
        solver(&gpu, &run.body, kind)
            .run(&mut run.body, 12, h)
            .unwrap();
        let mut stepped = disturbed(&gpu, Damping::Axial);
        let mut one = solver(&gpu, &stepped.body, kind);
        for _ in 0..5 {
            one.step(&mut stepped.body, h).unwrap();
        }
        let mut work = gpu.start_recording();
        one.record(&mut work, &mut stepped.body, 4, h).unwrap();
        one.record(&mut work, &mut stepped.body, 3, h).unwrap();
        work.submit().unwrap();
        let progress = one.poll(&stepped.body).unwrap();
        assert_eq!(progress.steps, 12);
        assert!((progress.time - 12.0 * h).abs() < 1e-12);
        assert_eq!(one.history(&stepped.body).unwrap().len(), 12);
        let (a, b) = (
            run.body.positions().unwrap(),
            stepped.body.positions().unwrap(),
        );
        let apart = a
            .iter()
            .zip(&b)
            .map(|(a, b)| a.distance(*b))
            .fold(0.0, f64::max);
        assert!(apart < 1e-7, "{kind}: {apart}");
    }
}

/// Steps recorded for a caller, as in a window: the number of iterations is predicted from the
/// steps before without waiting for any.
#[test]
fn recorded_steps_get_predicted_iterations() {
    let gpu = Gpu::new().unwrap();
    let mut stepped = disturbed(&gpu, Damping::Axial);
    let mut implicit = solver(&gpu, &stepped.body, SolverKind::Implicit);
    let mut counts = Vec::new();
    let name = "physics/implicit_euler_update";
    let recorded = || gpu.passes_recorded().get(name).copied().unwrap_or(0);
    for _ in 0..6 {
        let (before, read) = (recorded(), gpu.readbacks());
        implicit.step(&mut stepped.body, 0.01).unwrap();
        assert_eq!(gpu.readbacks(), read);
        counts.push(recorded() - before);
        gpu.wait().unwrap();
    }
    let steps = implicit.history(&stepped.body).unwrap();
    assert_eq!(steps.len(), 6);
    let most = steps.iter().map(|s| u64::from(s.iterations)).max().unwrap();
    // The first step has no prediction.
    assert_eq!(counts[0], 256);
    assert!(
        counts[2..].iter().all(|n| *n <= 2 * most + 8),
        "{counts:?} for {most}"
    );
    assert!(*counts.last().unwrap() >= most && most > 4, "{counts:?}");
    // A step that was recorded and discarded has no effect.
    let mut work = gpu.start_recording();
    implicit
        .record(&mut work, &mut stepped.body, 1, 0.01)
        .unwrap();
    drop(work);
    let before = recorded();
    for _ in 0..3 {
        implicit.step(&mut stepped.body, 0.01).unwrap();
        gpu.wait().unwrap();
    }
    assert!(
        recorded() - before < 3 * 4 * most,
        "{}",
        recorded() - before
    );
    assert_eq!(implicit.history(&stepped.body).unwrap().len(), 9);
}
