//! Failures are detected, freeze the last valid state, and are reported with advice.

use super::common::{Twins, solver};
use glam::DVec3;
use palpate::gpu::Gpu;
use palpate::physics::{
    CgSettings, Engine, EngineChoice, GpuBody, ImplicitEuler, Material, MaterialModel, Solver,
    SolverKind,
};
use palpate::{Error, FailureCause, generate};

fn what(error: &Error) -> &str {
    match error {
        Error::Solver { what, .. } => what,
        other => panic!("{other}"),
    }
}

#[test]
fn non_finite_values_freeze_last_valid_state() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    for kind in SolverKind::ALL {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut body = GpuBody::new(&gpu, &mesh, &Material::from_young(1e5)).unwrap();
            body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
            let mut stepper = solver(&gpu, &body, kind);
            stepper.run(&mut body, 5, 1e-3).unwrap();
            let good = body.positions().unwrap();
            // One node of the caller's force array becomes invalid; thirty steps in one submission.
            let mut forces = vec![[0.0f32; 4]; mesh.nodes.len()];
            forces[17][1] = bad;
            gpu.write_array(body.force_array(), &forces).unwrap();
            let mut work = gpu.start_recording();
            stepper.record(&mut work, &mut body, 30, 1e-3).unwrap();
            work.submit().unwrap();
            let error = stepper.poll(&body).unwrap_err();
            assert!(what(&error).contains("finite"), "{kind}: {error}");
            assert!(
                error.to_string().contains("failed at step 6 (t = 0.005"),
                "{error}"
            );
            assert_eq!(body.positions().unwrap(), good, "{kind}");
            // Once corrected, it continues.
            body.set_forces(&vec![DVec3::ZERO; mesh.nodes.len()])
                .unwrap();
            let progress = stepper.run(&mut body, 5, 1e-3).unwrap();
            assert_eq!(progress.steps, 10, "{kind}");
        }
    }
}

#[test]
fn non_finite_state_is_reported_in_first_step() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    let mut body = GpuBody::new(&gpu, &mesh, &Material::from_young(1e5)).unwrap();
    let mut positions: Vec<[f32; 4]> = gpu.read_array(body.nodes().array()).unwrap();
    positions[3][2] = f32::NAN;
    gpu.write_array(body.nodes().array(), &positions).unwrap();
    let error = solver(&gpu, &body, SolverKind::Implicit)
        .run(&mut body, 3, 0.01)
        .unwrap_err();
    assert!(error.to_string().contains("failed at step 1"), "{error}");
}

#[test]
fn runaway_energy_is_stopped_before_overflow() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::bar_of_about(1000, DVec3::new(0.3, 0.1, 0.1)).unwrap();
    for kind in [
        SolverKind::Explicit,
        SolverKind::Symplectic,
        SolverKind::Verlet,
        SolverKind::VelocityVerlet,
    ] {
        let mut twins = Twins::new(&gpu, &mesh, &Material::from_young(1e6));
        twins.disturb(1e-4, 0.0, 5);
        let before = twins.truth.elastic_energy();
        let mut stepper = solver(&gpu, &twins.body, kind);
        let error = stepper.run(&mut twins.body, 500, 2e-3).unwrap_err();
        assert!(what(&error).contains("energy"), "{kind}: {error}");
        twins.take_over();
        let after = twins.truth.elastic_energy() + twins.truth.kinetic_energy();
        assert!(after < 60.0 * before, "{kind}: {after} J after {before} J");
        let text = error.to_string();
        assert_eq!(
            text.contains("never stable"),
            kind == SolverKind::Explicit,
            "{text}"
        );
    }
}

/// Free fall can add any amount of energy: neither it nor a fast throw is a failure.
#[test]
#[ignore = "long: scripts/test --full"]
fn free_fall_and_fast_throw_are_not_failures() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    for kind in SolverKind::ALL {
        let mut body = GpuBody::new(&gpu, &mesh, &Material::from_young(1e5)).unwrap();
        body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
        body.set_velocities(&vec![DVec3::new(20.0, 0.0, 5.0); mesh.nodes.len()])
            .unwrap();
        let (steps, h) = if kind == SolverKind::Implicit {
            (200, 0.01)
        } else {
            (2000, 1e-4)
        };
        let mut stepper = solver(&gpu, &body, kind);
        let time = stepper.run(&mut body, steps, h).unwrap().time;
        let x = body.positions().unwrap();
        let fallen = x[0] - mesh.nodes[0];
        let expected = DVec3::new(20.0 * time, 0.0, 5.0 * time - 0.5 * 9.81 * time * time);
        // Euler's schemes have an error of h/2 in the fall velocity of every step.
        let slack = 9.81 * time * h + 2e-3 * expected.length();
        assert!(
            fallen.distance(expected) < slack,
            "{kind}: {fallen} for {expected}"
        );
    }
}

#[test]
fn unconverged_conjugate_gradients_are_reported() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::bar_of_about(1000, DVec3::new(0.3, 0.1, 0.1)).unwrap();
    let mut twins = Twins::new(&gpu, &mesh, &Material::from_young(1e7));
    twins.disturb(0.01, 0.0, 6);
    let settings = CgSettings {
        tolerance: 1e-5,
        acceptable: 1e-4,
        max_iterations: 5,
    };
    let mut implicit = ImplicitEuler::with(&gpu, &twins.body, settings).unwrap();
    let good = twins.body.positions().unwrap();
    let error = implicit.run(&mut twins.body, 10, 0.01).unwrap_err();
    assert!(what(&error).contains("in 5 iterations"), "{error}");
    assert_eq!(twins.body.positions().unwrap(), good);
    // Valid settings are accepted.
    let settings = CgSettings {
        acceptable: 0.9,
        ..settings
    };
    let mut implicit = ImplicitEuler::with(&gpu, &twins.body, settings).unwrap();
    let progress = implicit.run(&mut twins.body, 10, 0.01).unwrap();
    assert_eq!((progress.steps, progress.last.iterations), (10, 5));
    assert!(progress.last.residual > 1e-5 && progress.last.residual < 0.9);
    // Invalid settings are rejected.
    let settings = CgSettings {
        tolerance: 0.0,
        ..settings
    };
    assert!(ImplicitEuler::with(&gpu, &twins.body, settings).is_err());
}

#[test]
fn step_that_inverts_tets_fails_with_last_valid_state() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::bar([6, 2, 2], DVec3::new(0.6, 0.2, 0.2)).unwrap();
    for engine in [Engine::Cpu, Engine::Gpu] {
        for kind in [SolverKind::Implicit, SolverKind::Symplectic] {
            let name = format!("{engine} {kind}");
            let material = Material {
                model: MaterialModel::NeoHookean,
                ..Material::from_young(1e4)
            };
            let choice = EngineChoice::Exactly(engine);
            let mut body = choice
                .build_tets(&gpu, mesh.clone(), &material, kind)
                .unwrap();
            let body = body.as_mut();
            body.pin(|p| p.z < 1e-6).unwrap();
            body.loads_mut().set_gravity(DVec3::new(0.0, 0.0, -3e4));
            let dt = body.largest_stable_step().map_or(1e-3, |limit| 0.2 * limit);
            let error = body.run(100, dt).unwrap_err();
            let Error::Solver { cause, .. } = &error else {
                panic!("{name}: {error}");
            };
            assert_eq!(*cause, FailureCause::InvertedTets, "{name}: {error}");
            let report = body.report().unwrap();
            assert_eq!(report.inverted_tets, 0, "{name}");
            // A body with inverted tets may recover in several steps.
            body.set_inversion_allowed(true);
            body.run(1, dt).unwrap();
            let inverted = body.report().unwrap().inverted_tets;
            assert!(inverted > 0, "{name}");
            body.set_inversion_allowed(false);
            body.loads_mut().set_gravity(DVec3::ZERO);
            body.run(1, dt).unwrap_or_else(|e| panic!("{name}: {e}"));
        }
    }
}
