//! Finite elements on the GPU against their float64 reference.

use super::common::{Noise, solver};
use super::element_truth::{Truth, relative};
use glam::{DMat3, DVec3};
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{Blade, TetMesh, Topology};
use palpate::physics::{
    CgSettings, ConstitutiveModel, DiscreteModel, EngineChoice, GpuBody, ImplicitEuler, Material,
    MaterialModel, Report, Solver, SolverKind,
};

/// In units of time: a step too short to move.
const SHORT: f64 = 1e-7;

const MODELS: [MaterialModel; 2] = [MaterialModel::NeoHookean, MaterialModel::Corotated];

fn material(model: MaterialModel) -> Material {
    Material {
        model,
        poisson: 0.35,
        ..Material::from_young(2e4)
    }
}

/// Returns a bar with nodes that f32 represents exactly.
fn bar() -> TetMesh {
    generate::bar([8, 2, 2], DVec3::new(1.0, 0.25, 0.25)).unwrap()
}

/// Returns the forces on the GPU for a state, from a step of `share` of the unit of time, and the
/// elastic energy after it.
fn gpu_forces(gpu: &Gpu, body: &mut GpuBody, share: f64) -> (Vec<DVec3>, f64) {
    let before = Truth::of(body);
    let h = share * body.units().time;
    body.set_inversion_allowed(true);
    let mut stepper = solver(gpu, body, SolverKind::Symplectic);
    let progress = stepper.run(body, 1, h).unwrap();
    let after = Truth::of(body);
    let change = after.v.iter().zip(&before.v).zip(&before.model.masses);
    let f = change.map(|((b, a), m)| *m * (*b - *a) / h).collect();
    (f, progress.last.elastic)
}

/// Returns random states: with small and large displacements, inverted, and flattened.
fn states(mesh: &TetMesh) -> Vec<(&'static str, Vec<DVec3>)> {
    let mut noise = Noise(3);
    let mut moved = |amount: f64| -> Vec<DVec3> {
        let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), 0.7);
        let nodes = mesh.nodes.iter();
        nodes
            .map(|p| turn * (*p + amount * noise.vector()))
            .collect()
    };
    let flat = mesh.nodes.iter().map(|p| DVec3::new(p.x, p.y, 0.0));
    // Anisotropic: otherwise the nearest rotation is not unique.
    let mirror = DVec3::new(1.0, 1.2, -0.8);
    vec![
        ("a little", moved(1e-3)),
        ("much", moved(0.02)),
        ("inside out", moved(0.15)),
        ("flat", flat.collect()),
        ("mirrored", mesh.nodes.iter().map(|p| *p * mirror).collect()),
    ]
}

#[test]
fn forces_and_energy_match_float64_in_any_state() {
    let gpu = Gpu::new().unwrap();
    let mesh = bar();
    for model in MODELS {
        for (name, x) in states(&mesh) {
            let mut body = GpuBody::new(&gpu, &mesh, &material(model)).unwrap();
            body.set_positions(&x).unwrap();
            let mut truth = Truth::of(&body);
            let (f, energy) = gpu_forces(&gpu, &mut body, SHORT);
            let expected = truth.forces(&truth.x, &truth.v);
            let (apart, energies) = (relative(&f, &expected), truth.energy(&truth.x));
            println!(
                "{model} {name}: forces {apart:.1e}, energy {:.1e}",
                energy / energies - 1.0
            );
            assert!(apart < 2e-4, "{model} {name}: {apart}");
            assert!((energy / energies - 1.0).abs() < 1e-4, "{model} {name}");
            let report = Report::new(&body, &mesh).unwrap();
            assert!((report.energy.elastic / energies - 1.0).abs() < 1e-4);
            // The check is effective: the other constitutive model gives other forces.
            truth.model.elements_mut().unwrap().law = match truth.law() {
                ConstitutiveModel::NeoHookean => ConstitutiveModel::Corotated,
                ConstitutiveModel::Corotated => ConstitutiveModel::NeoHookean,
            };
            let other = truth.forces(&truth.x, &truth.v);
            assert!(relative(&f, &other) > 1e-2, "{model} {name}");
        }
    }
}

#[test]
fn body_at_rest_has_no_forces() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::ball(0.037, 5).unwrap();
    for model in MODELS {
        let mut body = GpuBody::new(&gpu, &mesh, &material(model)).unwrap();
        let (f, energy) = gpu_forces(&gpu, &mut body, SHORT);
        assert!(f.iter().all(|f| *f == DVec3::ZERO), "{model}");
        assert_eq!(energy, 0.0);
    }
}

/// Damping forces are τ K v with K the Hessian of the energy, projected to positive semidefinite.
#[test]
fn damping_equals_projected_force_derivative() {
    let gpu = Gpu::new().unwrap();
    let mesh = bar();
    for model in MODELS {
        for (name, x) in states(&mesh) {
            let still = material(model);
            let damped = Material {
                damping_time: 0.05,
                ..material(model)
            };
            let mut body = GpuBody::new(&gpu, &mesh, &damped).unwrap();
            body.set_positions(&x).unwrap();
            let v: Vec<DVec3> = Noise(9).vectors(x.len());
            body.set_velocities(&v).unwrap();
            let truth = Truth::of(&body);
            let (f, _) = gpu_forces(&gpu, &mut body, 1e-3);
            let expected = truth.forces(&truth.x, &truth.v);
            let apart = relative(&f, &expected);
            println!("{model} {name}: {apart:.1e}");
            assert!(apart < 1e-3, "{model} {name}: {apart}");
            if name == "a little" {
                // Nearly relaxed tets have no negative eigenvalues.
                let plain = Truth {
                    model: DiscreteModel::new(&mesh, &still).unwrap(),
                    ..Truth::of(&body)
                };
                let at = |s: f64| {
                    let x = truth.x.iter().zip(&truth.v);
                    plain.forces(&x.map(|(x, v)| *x + s * *v).collect::<Vec<_>>(), &truth.v)
                };
                let (less, more, here) = (at(-1e-6), at(1e-6), at(0.0));
                let nodes = 0..here.len();
                let measured = nodes.map(|i| here[i] + 0.05 * (more[i] - less[i]) / 2e-6);
                let measured: Vec<DVec3> = measured.collect();
                let apart = relative(&f, &measured);
                assert!(apart < 2e-2, "{model}: {apart}");
                assert!(relative(&f, &here) > 0.5);
            }
        }
    }
}

fn swinging(gpu: &Gpu, model: MaterialModel, damping_time: f64) -> GpuBody {
    let mesh = bar();
    let material = Material {
        damping_time,
        ..material(model)
    };
    let mut discrete_model = DiscreteModel::new(&mesh, &material).unwrap();
    discrete_model.elements_mut().unwrap().mass_damping = 0.4;
    let mut body = GpuBody::from_model(gpu, &mesh, discrete_model, &material).unwrap();
    body.pin(|p| p.x < 1e-6);
    body.set_gravity(DVec3::new(0.0, 2.0, -9.81));
    body
}

#[test]
#[ignore = "long: scripts/test --full"]
fn explicit_steps_match_float64() {
    let gpu = Gpu::new().unwrap();
    for model in MODELS {
        let mut body = swinging(&gpu, model, 1e-4);
        let mut truth = Truth::of(&body);
        let (h, steps) = (2e-4, 300);
        let mut stepper = solver(&gpu, &body, SolverKind::Symplectic);
        stepper.run(&mut body, steps, h).unwrap();
        let rest = truth.x.clone();
        for _ in 0..steps {
            truth.symplectic(h);
        }
        let expected: Vec<DVec3> = truth.x.iter().zip(&rest).map(|(a, b)| *a - *b).collect();
        let there = Truth::of(&body);
        let displacement: Vec<DVec3> = there.x.iter().zip(&rest).map(|(a, b)| *a - *b).collect();
        let apart = relative(&displacement, &expected);
        println!(
            "{model}: {apart:.1e} of {:.3} m",
            expected.last().unwrap().length()
        );
        assert!(apart < 2e-3, "{model}: {apart}");
        truth.symplectic(h);
        let expected: Vec<DVec3> = truth.x.iter().zip(&rest).map(|(a, b)| *a - *b).collect();
        assert!(relative(&displacement, &expected) > 2.0 * apart, "{model}");
    }
}

/// Steps from random states equal the corresponding Newton iterations.
#[test]
fn implicit_steps_match_newton_iterations() {
    let gpu = Gpu::new().unwrap();
    let settings = CgSettings {
        tolerance: 1e-6,
        ..CgSettings::default()
    };
    let mesh = bar();
    for model in MODELS {
        for (name, x) in states(&mesh) {
            for damping_time in [0.0, 0.004] {
                let mut body = swinging(&gpu, model, damping_time);
                body.set_positions(&x).unwrap();
                let v = Noise(4).vectors(x.len()).into_iter().zip(body.pinned());
                let v = v.map(|(v, held)| if *held { DVec3::ZERO } else { 0.3 * v });
                body.set_velocities(&v.collect::<Vec<_>>()).unwrap();
                let mut truth = Truth::of(&body);
                let mut stepper = ImplicitEuler::with(&gpu, &body, settings).unwrap();
                stepper.run(&mut body, 1, 0.01).unwrap();
                let (start, v) = (truth.x.clone(), truth.v.clone());
                let picked = truth.step(&v, 0.01);
                let there = Truth::of(&body);
                let apart = relative(&there.v, &truth.v);
                println!("{model} {name} τ {damping_time}: from start {picked}, {apart:.1e}");
                assert!(apart < 2e-3, "{model} {name}: {apart}");
                // The check is effective: another step length gives another step.
                truth.x = start;
                truth.v = v.clone();
                truth.step(&v, 0.0101);
                assert!(relative(&there.v, &truth.v) > 2.0 * apart, "{model} {name}");
            }
        }
    }
}

/// Over a motion, steps are close to converged ones.
#[test]
#[ignore = "long: scripts/test --full"]
fn implicit_motion_matches_converged_steps() {
    let gpu = Gpu::new().unwrap();
    let settings = CgSettings {
        tolerance: 1e-6,
        ..CgSettings::default()
    };
    for model in MODELS {
        for damping_time in [0.0, 0.004] {
            let mut body = swinging(&gpu, model, damping_time);
            let mut truth = Truth::of(&body);
            let rest = truth.x.clone();
            let mut stepper = ImplicitEuler::with(&gpu, &body, settings).unwrap();
            stepper.run(&mut body, 40, 0.01).unwrap();
            (0..40).for_each(|_| truth.converged_step(0.01));
            let there = Truth::of(&body);
            let expected: Vec<DVec3> = truth.x.iter().zip(&rest).map(|(a, b)| *a - *b).collect();
            let displacement: Vec<DVec3> =
                there.x.iter().zip(&rest).map(|(a, b)| *a - *b).collect();
            let apart = relative(&displacement, &expected);
            println!(
                "{model} τ {damping_time}: {apart:.1e} of {:.3} m",
                expected.last().unwrap().length()
            );
            assert!(apart < 2e-2, "{model}: {apart}");
        }
    }
}

/// Patch test: a uniformly strained body of any mesh is in equilibrium inside. Hooke's law: under
/// the strain s along x, with lateral contraction ν s, its resistance per area is E s along x, and
/// zero laterally.
#[test]
fn affine_strain_is_in_equilibrium_and_obeys_hookes_law() {
    let gpu = Gpu::new().unwrap();
    let ball = generate::ball(0.5, 6).unwrap();
    let strain = DMat3::from_cols(
        DVec3::new(1.1, 0.05, -0.03),
        DVec3::new(-0.1, 0.93, 0.2),
        DVec3::new(0.04, 0.1, 1.2),
    );
    for model in MODELS {
        let mut body = GpuBody::new(&gpu, &ball, &material(model)).unwrap();
        let x: Vec<DVec3> = ball.nodes.iter().map(|p| strain * *p).collect();
        body.set_positions(&x).unwrap();
        let (f, _) = gpu_forces(&gpu, &mut body, SHORT);
        let most = f.iter().map(|f| f.length()).fold(0.0, f64::max);
        let inside = ball.nodes.iter().zip(&f).filter(|(p, _)| p.length() < 0.4);
        let inside = inside.map(|(_, f)| f.length()).fold(0.0, f64::max);
        println!("{model}: {inside:.1e} of {most:.1e} N inside");
        assert!(inside < 1e-4 * most && most > 0.0, "{model}");

        let (mesh, s) = (bar(), 1e-3);
        let stretched = |nu: f64| -> Vec<DVec3> {
            let by = DVec3::new(1.0 + s, 1.0 - nu * s, 1.0 - nu * s);
            mesh.nodes.iter().map(|p| *p * by).collect()
        };
        let mut found = Vec::new();
        for nu in [0.35, 0.25] {
            let mut body = GpuBody::new(&gpu, &mesh, &material(model)).unwrap();
            body.set_positions(&stretched(nu)).unwrap();
            let (f, _) = gpu_forces(&gpu, &mut body, SHORT);
            let of = |where_: fn(&DVec3) -> bool, axis: usize| -> f64 {
                let nodes = mesh.nodes.iter().zip(&f).filter(|(p, _)| where_(p));
                nodes.map(|(_, f)| f[axis]).sum()
            };
            let pull = -of(|p| p.x > 0.99, 0) / (0.25 * 0.25 * s);
            let side = of(|p| p.y > 0.24, 1) / (0.25 * s);
            found.push((pull, side));
        }
        println!("{model}: {found:?}");
        assert!((found[0].0 / 2e4 - 1.0).abs() < 5e-3, "{found:?}");
        assert!(found[0].1.abs() < 5e-3 * 2e4, "{found:?}");
        assert!(found[1].1.abs() > 5e-2 * 2e4, "{found:?}");
    }
}

/// Returns from any shape to the rest shape.
#[test]
#[ignore = "long: scripts/test --full"]
fn scrambled_bodies_recover() {
    let gpu = Gpu::new().unwrap();
    let mesh = bar();
    for model in MODELS {
        for (name, x) in states(&mesh) {
            let damped = Material {
                damping_time: 0.02,
                ..material(model)
            };
            let mut discrete_model = DiscreteModel::new(&mesh, &damped).unwrap();
            discrete_model.elements_mut().unwrap().mass_damping = 4.0;
            let mut body = GpuBody::from_model(&gpu, &mesh, discrete_model, &damped).unwrap();
            body.pin(|p| p.x < 1e-6);
            let nodes = x.iter().zip(&mesh.nodes).zip(body.pinned());
            let x: Vec<DVec3> = nodes
                .map(|((x, rest), held)| if *held { *rest } else { *x })
                .collect();
            body.set_positions(&x).unwrap();
            body.set_inversion_allowed(true);
            let mut stepper = solver(&gpu, &body, SolverKind::Implicit);
            stepper.run(&mut body, 300, 0.01).unwrap();
            let report = Report::new(&body, &mesh).unwrap();
            let left = report.energy.total;
            println!(
                "{model} {name}: {left:.1e} J, {} inverted",
                report.inverted_tets
            );
            assert_eq!(report.inverted_tets, 0, "{model} {name}");
        }
    }
}

#[test]
fn elements_follow_cuts() {
    let gpu = Gpu::new().unwrap();
    for kind in [SolverKind::Implicit, SolverKind::Symplectic] {
        let mut mesh = bar();
        let made_of = material(MaterialModel::NeoHookean);
        let mut body = GpuBody::new(&gpu, &mesh, &made_of).unwrap();
        body.pin(|p| p.x < 1e-6);
        body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
        let h = if kind == SolverKind::Implicit {
            0.01
        } else {
            2e-4
        };
        let mut stepper = solver(&gpu, &body, kind);
        stepper.run(&mut body, 5, h).unwrap();
        let mut topology = Topology::new(&mesh);
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let blade = Blade::from_quad(corners.map(|[y, z]| DVec3::new(0.51, y, z))).unwrap();
        let cut = body.cut(&mut mesh, &mut topology, &blade).unwrap();
        assert!(!cut.duplicated_nodes.is_empty());
        let fresh = DiscreteModel::new(&mesh, &made_of).unwrap();
        let nodes =
            |n: &DiscreteModel| -> Vec<[u32; 4]> { n.tets().iter().map(|e| e.nodes).collect() };
        assert_eq!(nodes(body.model()), nodes(&fresh));
        // The separated half falls freely.
        let steps = (0.2 / h) as u32;
        let loose: Vec<usize> = (0..mesh.nodes.len())
            .filter(|i| mesh.nodes[*i].x > 0.8)
            .collect();
        let before = Truth::of(&body);
        stepper.run(&mut body, steps, h).unwrap();
        let after = Truth::of(&body);
        let fallen = |i: &usize| before.x[*i].z + 0.2 * before.v[*i].z - after.x[*i].z;
        let mean = loose.iter().map(fallen).sum::<f64>() / loose.len() as f64;
        println!("{kind}: fallen {mean}");
        assert!(
            (mean / (0.5 * 9.81 * 0.04) - 1.0).abs() < 0.2,
            "{kind}: {mean}"
        );
    }
}

/// With the second-order scheme, a bar of elements has the same amplitude with a large step as with
/// small ones; implicit Euler loses half of it.
#[test]
fn second_order_schemes_preserve_amplitude() {
    let gpu = Gpu::new().unwrap();
    let soft = material(MaterialModel::NeoHookean);
    let after = |kind: SolverKind, steps: u32| {
        let body = EngineChoice::Auto.build_tets(&gpu, bar(), &soft, kind);
        let mut body = body.unwrap();
        body.pin(|p| p.x < 1e-6).unwrap();
        body.loads_mut().set_gravity(DVec3::new(0.0, 0.0, -2.0));
        body.run(steps, 0.4 / f64::from(steps)).unwrap();
        let positions = body.positions().unwrap();
        let sunk = body.mesh().nodes.iter().zip(positions);
        sunk.map(|(p, q)| p.z - q.z).fold(0.0, f64::max)
    };
    let truth = after(SolverKind::Midpoint, 400);
    let off = |kind| (after(kind, 20) / truth - 1.0).abs();
    let [euler, bdf2, midpoint] =
        [SolverKind::Implicit, SolverKind::Bdf2, SolverKind::Midpoint].map(off);
    println!("{truth}: {euler} {bdf2} {midpoint}");
    assert!(
        bdf2 < 0.5 * euler && midpoint < 0.5 * euler,
        "{euler} {bdf2} {midpoint}"
    );
    let springs = Material::from_young(1e4);
    for kind in SolverKind::ELEMENT_ONLY {
        let error = EngineChoice::Auto
            .build_tets(&gpu, bar(), &springs, kind)
            .err();
        assert!(
            error
                .unwrap()
                .to_string()
                .contains("--material neo-hookean")
        );
        let gpu_only: EngineChoice = "gpu".parse().unwrap();
        let error = gpu_only.build_tets(&gpu, bar(), &soft, kind).err().unwrap();
        assert!(error.to_string().contains("--engine cpu"), "{error}");
    }
}
