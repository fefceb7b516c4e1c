//! Grabs of tet bodies, with every solver that reaches equilibrium.

use glam::DVec3;
use palpate::generate::{Split, box_mesh};
use palpate::gpu::Gpu;
use palpate::physics::{GpuBody, GrabMode, Material, SolverKind, largest_stable_step};

const SOLVERS: [SolverKind; 4] = [
    SolverKind::Symplectic,
    SolverKind::Verlet,
    SolverKind::VelocityVerlet,
    SolverKind::Implicit,
];

fn body(gpu: &Gpu) -> GpuBody {
    let mesh = box_mesh([8, 3, 3], DVec3::new(0.08, 0.03, 0.03), Split::Five).unwrap();
    let material = Material {
        damping_time: 0.0,
        ..Material::soft_tissue()
    };
    GpuBody::new(gpu, &mesh, &material).unwrap()
}

fn step(body: &GpuBody, kind: SolverKind) -> f64 {
    match kind {
        SolverKind::Implicit => 0.002,
        _ => 0.5 * largest_stable_step(body.model(), body.pinned(), SolverKind::Verlet).unwrap(),
    }
}

#[test]
fn grabbed_nodes_follow_and_are_released() {
    let gpu = Gpu::new().unwrap();
    for kind in SOLVERS {
        let mut body = body(&gpu);
        body.pin(|p| p.x < 0.001);
        let mut solver = kind.solver(&gpu, &body).unwrap();
        let h = step(&body, kind);
        let end = DVec3::new(0.08, 0.015, 0.015);
        let rest = body.positions().unwrap();
        let grab = body.grab(end, 0.017, GrabMode::Follow).unwrap();
        let moved = DVec3::new(0.004, 0.006, 0.0);
        for n in 1..=8 {
            body.set_target(grab, end + moved * f64::from(n) / 8.0)
                .unwrap();
            solver.run(&mut body, 4, h).unwrap();
        }
        let held = body.positions().unwrap();
        let mut near = 0;
        for (x, rest) in held.iter().zip(&rest) {
            if rest.distance(end) <= 0.017 {
                assert!(x.distance(*rest + moved) < 1e-8, "{kind}");
                near += 1;
            }
            assert!(rest.x > 0.001 || x.distance(*rest) < 1e-9);
        }
        assert!(near > 4);
        assert!(body.set_target(grab, DVec3::NAN).is_err());
        assert!(body.grab(DVec3::ONE, 0.01, GrabMode::Follow).is_err());
        assert_eq!(body.release(grab).unwrap(), near);
        assert!(body.set_target(grab, end).is_err());
        solver.run(&mut body, 20, h).unwrap();
        let free = body.positions().unwrap();
        let back = free.iter().zip(&held).map(|(a, b)| a.distance(*b));
        assert!(back.fold(0.0, f64::max) > 1e-4, "{kind}");
    }
}

#[test]
fn grab_springs_respect_force_limit() {
    let gpu = Gpu::new().unwrap();
    for kind in SOLVERS {
        // The first pulls with full stiffness, the second up to its force limit.
        for (stiffness, limit) in [(0.5, 1e9), (1e3, 0.02)] {
            let mut body = body(&gpu);
            let mass: f64 = body.model().masses.iter().sum();
            let mut solver = kind.solver(&gpu, &body).unwrap();
            let h = 0.25 * step(&body, kind);
            let centre = DVec3::new(0.04, 0.015, 0.015);
            let grab = body
                .grab(centre, 1.0, GrabMode::Spring { stiffness, limit })
                .unwrap();
            let away = DVec3::new(0.0, 0.05, 0.0);
            body.set_target(grab, centre + away).unwrap();
            let masses = body.model().masses.clone();
            let momentum = |body: &GpuBody| -> f64 {
                let v = body.velocities().unwrap();
                v.iter().zip(&masses).map(|(v, m)| m * v.y).sum()
            };
            solver.run(&mut body, 40, h).unwrap();
            let time = 40.0 * h;
            let exact = match stiffness * away.y < limit {
                true => {
                    let omega = (stiffness / mass).sqrt();
                    mass * away.y * omega * (omega * time).sin()
                }
                false => limit * time,
            };
            let found = momentum(&body);
            assert!(
                (found / exact - 1.0).abs() < 0.03,
                "{kind}: {found} for {exact}"
            );
            body.release(grab).unwrap();
            solver.run(&mut body, 20, h).unwrap();
            let after = momentum(&body);
            assert!(
                (after / found - 1.0).abs() < 0.03,
                "{kind}: {after} after {found}"
            );
        }
    }
}
