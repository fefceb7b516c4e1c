//! Limits of the methods: behaviour in numbers, as described in `docs/explanation/failure-modes.md`.

use super::common::{Noise, Twins, solver, step_truth};
use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{Field, Location, TetMesh, signed_volume};
use palpate::physics::reference::springs::ReferenceSprings;
use palpate::physics::{
    CgSettings, DiscreteModel, GpuBody, ImplicitEuler, Material, RegionMaterial, Report, Solver,
    SolverKind, largest_stable_step,
};

fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

/// Returns the smallest value found of pᵀAp/pᵀMp, by descent from a random p.
fn smallest_quotient(p: &ReferenceSprings, product: impl Fn(&[DVec3]) -> Vec<DVec3>) -> f64 {
    let masses = &p.model.masses;
    let weigh =
        |v: &[DVec3]| -> Vec<DVec3> { v.iter().zip(masses).map(|(v, m)| *v * *m).collect() };
    // An upper bound of the eigenvalues of M⁻¹A, by power iteration; M⁻¹A minus the bound has its
    // largest-magnitude eigenvalue where M⁻¹A has its smallest.
    let iterate = |shift: f64, steps: usize| {
        let mut v = Noise(9).vectors(p.x.len());
        let mut quotient = 0.0;
        for _ in 0..steps {
            let a = product(&v);
            quotient = dot(&v, &a) / dot(&v, &weigh(&v));
            let next = (0..v.len()).map(|i| a[i] / masses[i] - shift * v[i]);
            let next: Vec<DVec3> = next.collect();
            let length = dot(&next, &weigh(&next)).sqrt();
            v = next.iter().map(|x| *x / length).collect();
        }
        quotient
    };
    let largest = iterate(0.0, 300);
    iterate(1.05 * largest, 4000)
}

/// A bar compressed to 70 % of its length: the exact Jacobian makes the system of an implicit step
/// indefinite, so conjugate gradients fail; the clamped Jacobian does not.
#[test]
fn compressed_springs_require_clamped_hessian() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    let mut twins = Twins::new(&gpu, &mesh, &Material::uniform_springs(30_000.0, 0.0));
    let pressed: Vec<DVec3> = mesh
        .nodes
        .iter()
        .map(|p| DVec3::new(0.7 * p.x, p.y, p.z))
        .collect();
    twins.body.set_positions(&pressed).unwrap();
    twins.take_over();
    let (p, h) = (&twins.truth, 0.01);
    let exact = |v: &[DVec3]| -> Vec<DVec3> {
        let k = p.stiffness_product(v, false);
        (0..v.len())
            .map(|i| p.model.masses[i] * v[i] - h * h * k[i])
            .collect()
    };
    let unclamped = smallest_quotient(p, exact);
    assert!(unclamped < -10.0, "{unclamped}");
    let clamped = smallest_quotient(p, |v| p.system_product(h, v));
    assert!((clamped - 1.0).abs() < 1e-3, "{clamped}");
    // With the clamped one the bar recovers.
    let mut implicit = solver(&gpu, &twins.body, SolverKind::Implicit);
    implicit.run(&mut twins.body, 200, h).unwrap();
    let report = Report::new(&twins.body, &mesh).unwrap();
    assert!((report.volume_ratio - 1.0).abs() < 1e-3, "{report:?}");
    assert_eq!(report.inverted_tets, 0);
}

/// Springs have no volume term: a mirrored body is at rest, a flat one stays planar. Nothing fails;
/// the report counts inverted tets.
#[test]
fn mirrored_and_flattened_spring_bodies_persist_and_are_counted() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    let material = Material {
        damping_time: 1e-3,
        ..Material::from_young(1e5)
    };
    let run = |shape: &dyn Fn(DVec3) -> DVec3| {
        let mut body = GpuBody::new(&gpu, &mesh, &material).unwrap();
        let start: Vec<DVec3> = mesh.nodes.iter().map(|p| shape(*p)).collect();
        body.set_positions(&start).unwrap();
        let mut implicit = solver(&gpu, &body, SolverKind::Implicit);
        implicit.run(&mut body, 300, 0.01).unwrap();
        Report::new(&body, &mesh).unwrap()
    };
    let middle = 0.03;
    let mirrored = run(&|p| DVec3::new(p.x, p.y, 2.0 * middle - p.z));
    assert_eq!(mirrored.inverted_tets, mesh.tets.len());
    assert!((mirrored.volume_ratio + 1.0).abs() < 1e-3, "{mirrored:?}");
    let flat = run(&|p| DVec3::new(p.x, p.y, middle));
    assert!(flat.volume_ratio.abs() < 1e-3, "{flat:?}");
    // At a thickness of 1 %, it recovers.
    let thin = run(&|p| DVec3::new(p.x, p.y, middle + 0.01 * (p.z - middle)));
    assert!(thin.volume_ratio > 0.5, "{thin:?}");
}

/// Nodes at random positions in the body's box: the implicit solver settles with inverted tets.
#[test]
#[ignore = "long: scripts/test --full"]
fn scrambled_spring_body_settles_tangled() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    let material = Material {
        damping_time: 1e-3,
        ..Material::from_young(1e5)
    };
    let (low, high) = mesh.bounds();
    let mut noise = Noise(17);
    let mut anywhere = || low + (high - low) * (0.5 + 0.5 * noise.vector());
    let start: Vec<DVec3> = mesh.nodes.iter().map(|_| anywhere()).collect();
    for kind in SolverKind::ALL {
        let mut body = GpuBody::new(&gpu, &mesh, &material).unwrap();
        body.set_positions(&start).unwrap();
        let before = Report::new(&body, &mesh).unwrap();
        let limit = largest_stable_step(body.model(), body.pinned(), kind);
        let (steps, h) = match limit {
            None => (300, 0.01),
            Some(limit) => (4000, 0.5 * limit),
        };
        solver(&gpu, &body, kind).run(&mut body, steps, h).unwrap();
        let report = Report::new(&body, &mesh).unwrap();
        assert!(report.energy.total < 0.5 * before.energy.total, "{kind}");
        assert!(report.max_displacement < 0.3, "{kind}: {report:?}");
        // At rest, but not in the original shape: the number of inverted tets is reported.
        let x = body.positions().unwrap();
        let volume = |t: &[u32; 4]| signed_volume(t.map(|v| x[v as usize]));
        let inverted = mesh.tets.iter().filter(|t| volume(t) <= 0.0).count();
        assert!(inverted > 0, "{kind}");
        assert_eq!(report.inverted_tets, inverted, "{kind}");
    }
}

/// Returns a bar with a different material in its far half.
fn two_halves(stiffness: [f64; 2], density: [f64; 2]) -> (TetMesh, Material) {
    let mut mesh = generate::paper_bar().unwrap();
    let far = |t: usize| mesh.tet_nodes(t).iter().map(|p| p.x).sum::<f64>() > 0.24;
    let labels = (0..mesh.tets.len()).map(|t| f64::from(u8::from(far(t))));
    let labels = labels.collect();
    mesh.set_field(Field::scalar("tissue", Location::Cell, labels))
        .unwrap();
    let other = RegionMaterial {
        stiffness: stiffness[1],
        density: density[1],
        poisson: 0.4,
    };
    let material = Material {
        density: density[0],
        damping_time: 1e-3,
        region_field: Some("tissue".into()),
        regions: [(1, other)].into(),
        ..Material::from_young(stiffness[0])
    };
    (mesh, material)
}

/// One body with a stiffness ratio of 1:10,000, another with such a mass ratio: implicit Euler with
/// its default tolerance stays close to float64, and its number of iterations is bounded.
#[test]
fn stiffness_and_mass_ratios_of_ten_thousand_converge() {
    let gpu = Gpu::new().unwrap();
    for (stiffness, density) in [
        ([1e3, 1e7], [1e3, 1e3]),
        ([1e7, 1e3], [1e3, 1e3]),
        ([1e5, 1e5], [10.0, 1e5]),
        ([1e5, 1e5], [1e5, 10.0]),
    ] {
        let (mesh, material) = two_halves(stiffness, density);
        let mut twins = Twins::new(&gpu, &mesh, &material);
        twins.pin(|p| p.x < 0.001);
        twins.gravity(DVec3::new(0.0, 0.0, -1.0));
        let mut implicit = solver(&gpu, &twins.body, SolverKind::Implicit);
        implicit.run(&mut twins.body, 40, 0.01).unwrap();
        let history = implicit.history(&twins.body).unwrap();
        let most = history.iter().map(|s| s.iterations).max().unwrap();
        step_truth(SolverKind::Implicit, &mut twins.truth, 40, 0.01);
        let model = &twins.truth.model;
        let moved = twins.truth.x.iter().zip(&model.rest_positions);
        let moved = moved.map(|(x, r)| x.distance(*r)).fold(0.0, f64::max);
        let (off, _) = twins.difference();
        assert!(off < 0.02 * moved, "{off} of {moved} m");
        assert!(most < 200, "{most} iterations");
        // An explicit scheme must use the step of the stiffest or lightest part.
        let limit = largest_stable_step(model, &twins.truth.pinned, SolverKind::Symplectic);
        assert!(limit.unwrap() < 2e-3);
    }
}

/// Changes below the resolution of f32 are not iterated on: a tolerance below the f32 limit ends
/// where a reasonable one does, at the same cost.
#[test]
fn conjugate_gradients_stop_at_f32_resolution() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::bar_of_about(1000, DVec3::new(0.4, 0.1, 0.1)).unwrap();
    let mut errors = Vec::new();
    let mut iterations = Vec::new();
    for tolerance in [1e-3, 1e-6, 1e-9] {
        let mut twins = Twins::new(&gpu, &mesh, &Material::from_young(1e6));
        twins.pin(|p| p.x < 0.001);
        twins.gravity(DVec3::new(0.0, 0.0, -9.81));
        let settings = CgSettings {
            tolerance,
            ..CgSettings::default()
        };
        let mut implicit = ImplicitEuler::with(&gpu, &twins.body, settings).unwrap();
        let progress = implicit.run(&mut twins.body, 1, 0.05).unwrap();
        step_truth(SolverKind::Implicit, &mut twins.truth, 1, 0.05);
        let fastest = twins.truth.v.iter().map(|v| v.length());
        let fastest = fastest.fold(0.0, f64::max);
        errors.push(twins.difference().1 / fastest);
        iterations.push(progress.last.iterations);
    }
    assert!(errors.iter().all(|e| *e < 1e-5), "{errors:?}");
    assert!(errors[2] > 1e-7, "{errors:?}");
    assert!(iterations[2] <= iterations[1] + 2, "{iterations:?}");
}

/// Half a million metres from the origin, beyond the resolution of f32: positions are stored in a
/// local frame of the body.
#[test]
fn body_far_from_origin_moves_identically() {
    let gpu = Gpu::new().unwrap();
    let run = |away: DVec3| {
        let mut mesh = generate::paper_bar().unwrap();
        mesh.nodes.iter_mut().for_each(|p| *p += away);
        let mut body = GpuBody::new(&gpu, &mesh, &Material::from_young(1e5)).unwrap();
        body.pin(|p| p.x < away.x + 0.001);
        body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
        let mut implicit = solver(&gpu, &body, SolverKind::Implicit);
        implicit.run(&mut body, 20, 0.01).unwrap();
        let moved = body.positions().unwrap();
        let moved: Vec<DVec3> = moved
            .iter()
            .zip(&mesh.nodes)
            .map(|(x, r)| *x - *r)
            .collect();
        moved
    };
    let home = run(DVec3::ZERO);
    let largest = home.iter().map(|d| d.length()).fold(0.0, f64::max);
    let far = run(DVec3::new(5e5, -3e5, 1e6));
    let off = home.iter().zip(&far).map(|(a, b)| a.distance(*b));
    let off = off.fold(0.0, f64::max);
    assert!(
        largest > 1e-3 && off < 1e-4 * largest,
        "{off} of {largest} m"
    );
    // In f32, a relative error of 10⁻³ would occur there.
    assert_eq!(1e6 + 1e-3 * largest as f32, 1e6f32);
}

/// Stability of explicit Euler at the paper's step: damping in a narrow band.
#[test]
fn explicit_euler_is_stable_in_narrow_damping_band() {
    let mesh = generate::paper_bar().unwrap();
    let limit = |damping_time: f64| {
        let material = Material {
            damping_kind: palpate::physics::Damping::Axial,
            damping_time,
            ..Material::uniform_springs(3_000.0, 0.0)
        };
        let model = DiscreteModel::new(&mesh, &material).unwrap();
        let free = vec![false; mesh.nodes.len()];
        largest_stable_step(&model, &free, SolverKind::Explicit).unwrap()
    };
    assert!(limit(0.9e-3) < 1e-3 && limit(1.2e-3) < 1e-3);
    assert!(limit(1.02e-3) > 1e-3 && limit(1.08e-3) > 1e-3);
}
