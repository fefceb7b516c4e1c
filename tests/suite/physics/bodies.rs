//! The user interface of bodies: materials, loads, and callers who write on the GPU themselves.

use super::common::{Twins, solver, step_truth};
use glam::DVec3;
use palpate::Error;
use palpate::generate;
use palpate::gpu::{Gpu, Recorder};
use palpate::mesh::{Field, Location, TetMesh};
use palpate::physics::reference::springs::ReferenceSprings;
use palpate::physics::{
    DiscreteModel, GpuBody, Material, RegionMaterial, Report, SolverKind, Stiffness,
};

/// Returns the strain along x of the middle half of a beam under tensile `stress` at its end.
fn strain(gpu: &Gpu, mesh: &TetMesh, young: f64, stress: f64) -> f64 {
    let material = Material {
        damping_time: 0.02,
        ..Material::from_young(young)
    };
    let (_, high) = mesh.bounds();
    let mut body = GpuBody::new(gpu, mesh, &material).unwrap();
    body.pin(|p| p.x < 1e-6);
    let force = DVec3::new(stress * high.y * high.z, 0.0, 0.0);
    body.add_force(force, |p| p.x > high.x - 1e-6).unwrap();
    let mut implicit = solver(gpu, &body, SolverKind::Implicit);
    implicit.run(&mut body, 150, 0.05).unwrap();
    let x = body.positions().unwrap();
    let mean = |at: f64| {
        let section: Vec<f64> = (0..x.len())
            .filter(|i| (mesh.nodes[*i].x - at).abs() < 1e-6)
            .map(|i| x[i].x)
            .collect();
        section.iter().sum::<f64>() / section.len() as f64
    };
    let (a, b) = (0.25 * high.x, 0.75 * high.x);
    (mean(b) - mean(a)) / (b - a) - 1.0
}

/// A regular split is anisotropic: along its axes the five-tet bar, with C11 = 4/3 E and C12 = 1/3
/// E, has the modulus 1.2 E. A finer mesh approximates it better.
#[test]
fn stretched_beam_has_modulus_of_its_lattice() {
    let gpu = Gpu::new().unwrap();
    let size = DVec3::new(0.4, 0.1, 0.1);
    let found = [[8, 2, 2], [16, 4, 4]].map(|cells| {
        let mesh = generate::bar(cells, size).unwrap();
        100.0 / strain(&gpu, &mesh, 1e4, 100.0) / 1.2e4
    });
    assert!((found[0] - 1.0).abs() < 0.04, "{found:?}");
    assert!((found[1] - 1.0).abs() < 0.02, "{found:?}");
    // Twice the modulus, half the strain.
    let mesh = generate::bar([8, 2, 2], size).unwrap();
    let ratio = strain(&gpu, &mesh, 1e4, 100.0) / strain(&gpu, &mesh, 2e4, 100.0);
    assert!((ratio - 2.0).abs() < 0.03, "{ratio}");
}

/// Stretched by s along every direction in turn, a body of modulus E at ν = ¼ stores the mean
/// energy 3/5 E s² per volume: C1111 = 6/5 E. With this average, the formula is exact on any mesh.
#[test]
fn spring_constants_give_youngs_modulus_on_any_mesh() {
    let duct = generate::duct([6, 6, 3], DVec3::ONE, generate::Bore::Round).unwrap();
    for mesh in [
        generate::ball(0.3, 6).unwrap(),
        generate::paper_bar().unwrap(),
        duct,
    ] {
        let model = DiscreteModel::new(&mesh, &Material::from_young(1e5)).unwrap();
        let mut p = ReferenceSprings::new(model);
        let stretch = 1e-5;
        let mut mean = 0.0;
        // The six diagonals of the icosahedron average fourth powers exactly.
        let golden = 0.5 * (1.0 + 5f64.sqrt());
        for k in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut n = [0.0; 3];
                n[k] = 1.0;
                n[(k + 1) % 3] = sign * golden;
                let n = DVec3::from(n).normalize();
                for (x, rest) in p.x.iter_mut().zip(&p.model.rest_positions) {
                    *x = *rest + stretch * n * n.dot(*rest);
                }
                mean += p.elastic_energy() / 6.0;
            }
        }
        let modulus = mean / (0.6 * stretch * stretch * mesh.volume());
        assert!((modulus / 1e5 - 1.0).abs() < 1e-4, "{modulus}");
    }
}

#[test]
fn force_array_written_on_gpu_is_applied() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    for kind in SolverKind::ALL {
        let mut twins = Twins::new(&gpu, &mesh, &Material::from_young(1e5));
        twins.pin(|p| p.x < 0.001);
        let h = if kind == SolverKind::Implicit {
            0.01
        } else {
            1e-4
        };
        let mut stepper = solver(&gpu, &twins.body, kind);
        stepper.step(&mut twins.body, h).unwrap();
        // No load yet.
        assert_eq!(
            Report::new(&twins.body, &mesh)
                .unwrap()
                .max_displacement
                .round(),
            0.0
        );
        twins.take_over();
        let pull: Vec<[f32; 4]> = mesh
            .nodes
            .iter()
            .map(|p| [0.0, 0.0, if p.x > 0.119 { -2.0 } else { 0.0 }, 0.0])
            .collect();
        twins.truth.external = pull.iter().map(|f| DVec3::Z * f64::from(f[2])).collect();
        gpu.write_array(twins.body.force_array(), &pull).unwrap();
        let steps = if kind == SolverKind::Implicit {
            10
        } else {
            300
        };
        // Into the caller's encoder, as in an application.
        let mut encoder = gpu
            .device()
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut work = Recorder::with_encoder(&gpu, &mut encoder);
        stepper
            .record(&mut work, &mut twins.body, steps, h)
            .unwrap();
        work.submit().unwrap();
        gpu.queue().submit([encoder.finish()]);
        stepper.poll(&twins.body).unwrap();
        step_truth(kind, &mut twins.truth, steps, h);
        let moved = Report::new(&twins.body, &mesh).unwrap().max_displacement;
        assert!(moved > 0.01 * 0.12, "{kind}: {moved}");
        // Verlet's own start differs by half a kick of the first step's force.
        let slack = if kind == SolverKind::Verlet {
            2e-2
        } else {
            1e-3
        };
        let (dx, _) = twins.difference();
        assert!(dx < slack * moved, "{kind}: {dx} of {moved}");
    }
}

#[test]
fn regions_and_scale_fields_scale_stiffness() {
    let mut mesh = generate::bar([4, 2, 2], DVec3::new(0.12, 0.06, 0.06)).unwrap();
    let labels: Vec<f64> = (0..mesh.tets.len())
        .map(|t| {
            f64::from(u8::from(
                mesh.tet_nodes(t).iter().map(|p| p.x).sum::<f64>() > 0.24,
            ))
        })
        .collect();
    mesh.set_field(Field::scalar("tissue", Location::Cell, labels.clone()))
        .unwrap();
    let factors = mesh.nodes.iter().map(|p| 1.0 + p.x).collect();
    mesh.set_field(Field::scalar("factor", Location::Node, factors))
        .unwrap();
    let tenfold = labels.iter().map(|l| 1.0 + 9.0 * l).collect();
    mesh.set_field(Field::scalar("tenfold", Location::Cell, tenfold))
        .unwrap();
    let springs = |material: &Material| DiscreteModel::new(&mesh, material).unwrap().edges;
    for stiffness in [Stiffness::Young(1e5), Stiffness::Uniform(3e3)] {
        let (Stiffness::Young(value) | Stiffness::Uniform(value)) = stiffness;
        let plain = Material {
            stiffness,
            ..Material::from_young(1.0)
        };
        let regions = Material {
            region_field: Some("tissue".into()),
            regions: [(
                1,
                RegionMaterial {
                    stiffness: 10.0 * value,
                    density: 500.0,
                    poisson: 0.4,
                },
            )]
            .into(),
            ..plain.clone()
        };
        let by_node = Material {
            stiffness_scale_field: Some("factor".into()),
            ..plain.clone()
        };
        let by_tet = Material {
            stiffness_scale_field: Some("tenfold".into()),
            ..plain.clone()
        };
        let base = springs(&plain);
        let mass = |material: &Material| -> f64 {
            let model = DiscreteModel::new(&mesh, material).unwrap();
            model.masses.iter().sum()
        };
        // Half of the bar belongs to the region, which has half the density.
        assert!((mass(&regions) / mass(&plain) - 0.75).abs() < 1e-9);
        for (a, b) in base.iter().zip(springs(&regions)) {
            let [i, j] = a.nodes.map(|v| mesh.nodes[v as usize].x);
            let factor = b.stiffness / a.stiffness;
            let expected = match (i.max(j) < 0.059, i.min(j) > 0.061) {
                (true, _) => factor - 1.0,
                (_, true) => factor - 10.0,
                _ => f64::from(u8::from(!(1.0 - 1e-9..=10.0 + 1e-9).contains(&factor))),
            };
            assert!(expected.abs() < 1e-9, "{i} {j} {factor}");
        }
        // A factor on each tet acts like a region with the scaled stiffness, and leaves masses
        // unchanged.
        for (a, b) in springs(&regions).iter().zip(springs(&by_tet)) {
            assert!((b.stiffness / a.stiffness - 1.0).abs() < 1e-12);
        }
        assert_eq!(mass(&by_tet), mass(&plain));
        for (a, b) in base.iter().zip(springs(&by_node)) {
            let [i, j] = a.nodes.map(|v| 1.0 + mesh.nodes[v as usize].x);
            assert!((b.stiffness / a.stiffness - 0.5 * (i + j)).abs() < 1e-12);
        }
    }
    let missing = Material {
        region_field: Some("organ".into()),
        ..Material::from_young(1.0)
    };
    let error = DiscreteModel::new(&mesh, &missing).unwrap_err();
    assert!(error.to_string().contains("tissue"), "{error}");
}

#[test]
fn rejects_invalid_materials_and_loads() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    for material in [
        Material::from_young(f64::NAN),
        Material::from_young(-1.0),
        Material {
            density: 0.0,
            ..Material::from_young(1e5)
        },
        Material {
            length_unit: 0.0,
            ..Material::from_young(1e5)
        },
        Material {
            damping: -1.0,
            ..Material::from_young(1e5)
        },
    ] {
        assert!(
            matches!(GpuBody::new(&gpu, &mesh, &material), Err(Error::Input(_))),
            "{material:?}"
        );
    }
    let mut body = GpuBody::new(&gpu, &mesh, &Material::from_young(1e5)).unwrap();
    let mut other = GpuBody::new(&gpu, &mesh, &Material::from_young(1e5)).unwrap();
    assert!(body.pin_nodes(&[45]).is_err());
    assert!(body.set_positions(&mesh.nodes[1..]).is_err());
    assert!(body.set_velocities(&vec![DVec3::NAN; 45]).is_err());
    assert!(body.add_force(DVec3::X, |p| p.x > 1.0).is_err());
    let mut implicit = solver(&gpu, &body, SolverKind::Implicit);
    for dt in [0.0, -0.01, f64::NAN, f64::INFINITY] {
        assert!(
            matches!(implicit.step(&mut body, dt), Err(Error::Input(_))),
            "{dt}"
        );
    }
    assert!(implicit.step(&mut other, 0.01).is_err());
    let error = "euler".parse::<SolverKind>().unwrap_err().to_string();
    for kind in SolverKind::ALL {
        assert_eq!(kind.to_string().parse::<SolverKind>().unwrap(), kind);
        assert!(error.contains(kind.name()), "{error}");
    }
}

#[test]
fn clamp_one_end_reports_pins_and_gravity() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::bar([4, 2, 2], DVec3::new(0.06, 0.06, 0.12)).unwrap();
    let mut body = GpuBody::new(&gpu, &mesh, &Material::soft_tissue()).unwrap();
    let message = body.clamp_one_end(9.81);
    assert_eq!(body.gravity(), DVec3::new(0.0, -9.81, 0.0));
    let pinned = body.pinned().iter().filter(|p| **p).count();
    assert!(
        pinned > 0 && message.contains(&format!("{pinned} nodes")) && message.contains('z'),
        "{message}"
    );
}

/// A caller may set loads before every step: no scheme loses its state.
#[test]
fn resetting_loads_every_step_preserves_motion() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    for kind in SolverKind::ALL {
        let (steps, h) = if kind == SolverKind::Implicit {
            (20, 0.01)
        } else {
            (200, 2e-4)
        };
        let run = |each_step: bool| {
            let mut body = GpuBody::new(&gpu, &mesh, &Material::from_young(1e5)).unwrap();
            body.pin(|p| p.x < 0.001);
            body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
            let pull: Vec<DVec3> = mesh.nodes.iter().map(|p| DVec3::Z * -8.0 * p.x).collect();
            body.set_forces(&pull).unwrap();
            let mut stepper = solver(&gpu, &body, kind);
            if each_step {
                for _ in 0..steps {
                    body.set_forces(&pull).unwrap();
                    body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
                    body.pin(|_| false);
                    stepper.step(&mut body, h).unwrap();
                }
            } else {
                stepper.run(&mut body, steps, h).unwrap();
            }
            assert_eq!(stepper.poll(&body).unwrap().steps, u64::from(steps));
            body.positions().unwrap()
        };
        let (once, again) = (run(false), run(true));
        let largest = |a: &[DVec3], b: &[DVec3]| {
            let apart = a.iter().zip(b).map(|(a, b)| a.distance(*b));
            apart.fold(0.0, f64::max)
        };
        let moved = largest(&once, &mesh.nodes);
        assert!(moved > 0.01 * 0.12, "{kind}: {moved}");
        let apart = largest(&once, &again);
        assert!(apart < 1e-4 * moved, "{kind}: {apart} of {moved}");
    }
}
