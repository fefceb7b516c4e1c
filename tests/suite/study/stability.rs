//! The stability limit: 0.95 of the theoretical step is stable for ten thousand steps, 1.05 of it
//! diverges and is detected, in float64 and on the GPU.

use glam::{DMat3, DVec3};
use palpate::generate;
use palpate::mesh::TetMesh;
use palpate::mesher::Domain;
use palpate::physics::grid::{GridModel, GridShape};
use palpate::physics::linearised_model::{LinearisedModel, StepLimit};
use palpate::physics::reference::integrators::ReferenceIntegrator;
use palpate::physics::reference::springs::ReferenceSprings;
use palpate::physics::{
    DiscreteModel, GpuBody, GridBody, Material, SolverKind, largest_stable_step,
};
use palpate::study::STUDIES;
use std::sync::atomic::AtomicBool;

const STEPS: usize = 10_000;

/// Initial maximum displacement as a fraction of the extent: the rotation of the springs is too
/// small to change their stiffness.
const AMPLITUDE: f64 = 1e-4;

const EXPLICIT: [SolverKind; 4] = [
    SolverKind::Explicit,
    SolverKind::Symplectic,
    SolverKind::Verlet,
    SolverKind::VelocityVerlet,
];

fn mesh() -> TetMesh {
    generate::bar([3, 1, 1], DVec3::new(0.3, 0.1, 0.1)).unwrap()
}

fn held(p: DVec3) -> bool {
    p.x < 0.001
}

/// Returns the mesh clamped at one end, linearised.
fn linearised(material: &Material) -> (ReferenceSprings, LinearisedModel) {
    let mesh = mesh();
    let discrete_model = DiscreteModel::new(&mesh, material).unwrap();
    let pinned: Vec<bool> = mesh.nodes.iter().map(|p| held(*p)).collect();
    let body = LinearisedModel::new(&discrete_model, &pinned);
    let mut particles = ReferenceSprings::new(discrete_model);
    particles.pinned = pinned;
    (particles, body)
}

/// Returns an undamped material; materials damped below and beyond the critical damping of the
/// stiffest mode; and the paper's, for which the modes do not decouple.
fn materials() -> [Material; 4] {
    let young = Material::from_young(1e5);
    let (_, body) = linearised(&young);
    let critical = 2.0 / body.stiffest_mode().stiffness.sqrt();
    let damped = |damping_time| Material {
        damping_time,
        ..young.clone()
    };
    [
        young.clone(),
        damped(0.5 * critical),
        damped(3.0 * critical),
        Material::uniform_springs(4000.0, 6.0),
    ]
}

/// Returns the energy after each of `steps` steps relative to the initial one, until it has grown a
/// thousandfold.
fn energies(start: &ReferenceSprings, kind: SolverKind, steps: usize, h: f64) -> Vec<f64> {
    let mut p = start.clone();
    let mut integrator = ReferenceIntegrator::new(kind, 1e-8);
    let before = p.elastic_energy();
    let mut energies = Vec::new();
    for _ in 0..steps {
        integrator.step(&mut p, h).unwrap();
        energies.push((p.elastic_energy() + p.kinetic_energy()) / before);
        if energies[energies.len() - 1].is_nan() || energies[energies.len() - 1] > 1e3 {
            break;
        }
    }
    energies
}

fn displace(p: &mut ReferenceSprings, displacement: &[DVec3]) {
    for (x, u) in p.x.iter_mut().zip(displacement) {
        *x += AMPLITUDE * 0.3 * *u;
    }
}

/// Returns the limit of `kind`; for explicit Euler with any damping by bisection on the growth.
fn limit(body: &LinearisedModel, kind: SolverKind) -> StepLimit {
    let mut limit = body.largest_step(kind).unwrap();
    if limit.exact {
        return limit;
    }
    let grows = |h: f64| body.growth_rate(kind, h, 4000).0 > 1.0 + 1e-4;
    let (mut low, mut high) = (limit.step, 2.0 * limit.step);
    assert!(!grows(low), "invalid lower bound of the stable step");
    while !grows(high) {
        high *= 2.0;
    }
    for _ in 0..12 {
        let middle = 0.5 * (low + high);
        match grows(middle) {
            true => high = middle,
            false => low = middle,
        }
    }
    limit.step = low;
    limit.displacement = body.growth_rate(kind, high, 4000).1;
    limit
}

#[test]
fn stability_limit_in_float64() {
    for (m, material) in materials().iter().enumerate() {
        let (mut rest, body) = linearised(material);
        rest.model.rest_positions = rest.x.clone();
        for kind in EXPLICIT {
            let undamped = m == 0;
            if kind == SolverKind::Explicit && undamped {
                assert_eq!(body.largest_step(kind).unwrap().step, 0.0);
                continue;
            }
            let limit = limit(&body, kind);
            let mut start = rest.clone();
            displace(&mut start, &limit.displacement);
            let held = energies(&start, kind, STEPS, 0.95 * limit.step);
            assert_eq!(held.len(), STEPS, "{kind}, material {m}");
            // Undamped, the energy of symplectic Euler oscillates by 1/(1 − hω/2), a factor of
            // twenty.
            let most = held.iter().copied().fold(0.0, f64::max);
            assert!(most < 25.0, "{kind}, material {m}: {most}");
            let broken = energies(&start, kind, STEPS, 1.05 * limit.step);
            let last = broken[broken.len() - 1];
            assert!(last.is_nan() || last > 1e3, "{kind}, material {m}: {last}");
        }
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn stability_limit_on_gpu() {
    let gpu = crate::support::gpu();
    let mesh = mesh();
    for (m, material) in materials().iter().enumerate() {
        let (_, linear) = linearised(material);
        for kind in EXPLICIT {
            if kind == SolverKind::Explicit && m == 0 {
                continue;
            }
            let limit = limit(&linear, kind);
            let moved = mesh.nodes.iter().zip(&limit.displacement);
            let start: Vec<DVec3> = moved.map(|(p, u)| *p + AMPLITUDE * 0.3 * *u).collect();
            let run = |factor: f64, steps: usize| {
                let mut body = GpuBody::new(&gpu, &mesh, material).unwrap();
                body.pin(held);
                body.set_positions(&start).unwrap();
                let mut solver = kind.solver(&gpu, &body).unwrap();
                let end = solver.run(&mut body, steps as u32, factor * limit.step);
                assert!(body.positions().unwrap().iter().all(|p| p.is_finite()));
                end
            };
            let error = run(1.05, STEPS).unwrap_err().to_string();
            assert!(error.contains("energy diverges"), "{kind}: {error}");
            // The long run of one material each: they differ in the closed form only.
            let steps = if m == 0 || m == 1 && kind == SolverKind::Explicit {
                STEPS
            } else {
                500
            };
            let end = run(0.95, steps);
            assert!(end.is_ok(), "{kind}, material {m}: {}", end.unwrap_err());
        }
    }
}

/// The limit reported to users is the same, and never larger.
#[test]
fn reported_step_equals_stability_limit() {
    for material in materials() {
        let (p, body) = linearised(&material);
        for kind in EXPLICIT {
            let reported = largest_stable_step(&p.model, &p.pinned, kind).unwrap();
            assert_eq!(reported, body.largest_step(kind).unwrap().step);
        }
        assert_eq!(
            largest_stable_step(&p.model, &p.pinned, SolverKind::Implicit),
            None
        );
    }
}

#[test]
fn linearised_growth_matches_stiffest_mode() {
    let [undamped, light, heavy, paper] = materials();
    for material in [undamped, light, heavy] {
        let (_, body) = linearised(&material);
        for kind in EXPLICIT {
            let limit = body.largest_step(kind).unwrap();
            let h = 1.05 * limit.step.max(1e-3);
            let exact = limit.mode.spectral_radius(kind, h);
            let (found, _) = body.growth_rate(kind, h, 4000);
            assert!(
                (found / exact - 1.0).abs() < 2e-3,
                "{kind}: {found} for {exact}"
            );
        }
    }
    // If the modes do not decouple, the limit is still where growth begins, and the stiffest mode
    // alone would not give it.
    let (_, body) = linearised(&paper);
    for kind in &EXPLICIT[1..] {
        let limit = body.largest_step(*kind).unwrap();
        assert!(body.growth_rate(*kind, 0.99 * limit.step, 4000).0 < 1.0 + 1e-3);
        assert!(body.growth_rate(*kind, 1.01 * limit.step, 4000).0 > 1.0 + 1e-3);
        let alone = body.stiffest_mode().largest_step(*kind);
        assert!(alone > 1.01 * limit.step, "{kind}: {alone} s");
    }
}

/// Implicit Euler is unconditionally stable: at a hundred times the others' limit, and ten thousand
/// times.
#[test]
#[ignore = "long: scripts/test --full"]
fn implicit_euler_is_stable_where_others_diverge() {
    let gpu = crate::support::gpu();
    let mesh = mesh();
    let material = Material::from_young(1e5);
    let (_, linear) = linearised(&material);
    let limit = linear.largest_step(SolverKind::Verlet).unwrap();
    let moved = mesh.nodes.iter().zip(&limit.displacement);
    let start: Vec<DVec3> = moved.map(|(p, u)| *p + AMPLITUDE * 0.3 * *u).collect();
    for factor in [1.05, 1e2, 1e4] {
        let mut body = GpuBody::new(&gpu, &mesh, &material).unwrap();
        body.pin(held);
        body.set_positions(&start).unwrap();
        let mut solver = SolverKind::Implicit.solver(&gpu, &body).unwrap();
        let end = solver.run(&mut body, 500, factor * limit.step);
        assert!(end.is_ok(), "{factor}: {}", end.unwrap_err());
    }
}

struct Block;

impl Domain for Block {
    fn bounds(&self) -> (DVec3, DVec3) {
        (-DVec3::new(0.05, 0.03, 0.02), DVec3::new(0.05, 0.03, 0.02))
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        let inside = (self.bounds().1 - p.abs()).min_element() + 1e-9;
        weights.push((1, inside));
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn stability_limit_of_grids() {
    let gpu = crate::support::gpu();
    let block = Block;
    let shape = GridShape::from_domain(&block, DVec3::splat(0.0101), DMat3::IDENTITY).unwrap();
    for damping in [0.0, 40.0] {
        let mut model = GridModel::new(shape.clone(), &Material::from_young(1e5)).unwrap();
        model.damping = damping;
        let mut truth = model.reference();
        let limit = LinearisedModel::from_grid(&model).grid_limit();
        // The bound without iteration is below it, and close.
        let bound = model.conservative_step();
        assert!(
            bound < limit.step && bound > 0.5 * limit.step,
            "{bound} for {}",
            limit.step
        );
        for (x, u) in truth.x.iter_mut().zip(&limit.displacement) {
            *x += AMPLITUDE * 0.1 * *u;
        }
        truth.previous = truth.x.clone();
        let moved: Vec<DVec3> = truth.x.iter().map(|x| model.frame.origin + *x).collect();
        let elastic = truth.energy(1.0)[1];
        for (factor, steps) in [(0.95, STEPS), (1.05, 400)] {
            let h = factor * limit.step;
            let mut p = truth.clone();
            // Rayon has little work for so few particles: a fraction of the steps suffices.
            let most = (0..steps.min(2000)).fold(0.0f64, |most, _| {
                p.step(h);
                most.max(p.energy(h)[1] / elastic)
            });
            assert_eq!(most < 12.0, factor < 1.0, "{factor}: {most}");
            let mut body = GridBody::new(&gpu, model.clone()).unwrap();
            body.set_positions(&moved).unwrap();
            let end = body.run(steps as u32, h);
            assert_eq!(end.is_ok(), factor < 1.0, "{factor}");
            if let Err(error) = end {
                assert!(error.to_string().contains("--dt"), "{error}");
            }
            assert!(body.positions().unwrap().iter().all(|p| p.is_finite()));
        }
    }
}

/// The quick study contains diverging cells, and theory predicts all of them.
#[test]
#[ignore = "long: scripts/test --full"]
fn quick_stability_study_maps_failures() {
    let dir = tempfile::tempdir().unwrap();
    let run = |stop: bool| {
        super::frame::run(dir.path(), &AtomicBool::new(stop), |run| {
            let (_, _, study) = STUDIES.iter().find(|s| s.0 == "stability").unwrap();
            study(run, None).unwrap();
        });
    };
    run(false);
    let mut reader = csv::Reader::from_path(dir.path().join("stability.csv")).unwrap();
    let columns = reader.headers().unwrap().clone();
    let at = |name: &str| columns.iter().position(|c| c == name).unwrap();
    let [solver, stiffness, step] = ["solver", "stiffness", "step_s"].map(at);
    let (state, limit, off) = (at("state"), at("limit_s"), at("error_percent"));
    let rows: Vec<csv::StringRecord> = reader.records().map(|r| r.unwrap()).collect();
    let distinct = |column: usize| {
        let mut values: Vec<&str> = rows.iter().map(|r| &r[column]).collect();
        values.sort_unstable();
        values.dedup();
        values.len()
    };
    assert!(distinct(solver) >= 3 && distinct(step) >= 4 && distinct(stiffness) >= 2);
    let number = |text: &str| -> f64 { text.parse().unwrap() };
    let mut diverged = 0;
    for row in &rows {
        let beyond = number(&row[step]) > number(&row[limit]);
        assert_eq!(&row[state] == "diverged", beyond, "{row:?}");
        diverged += usize::from(beyond);
        if &row[state] == "stable" {
            assert!(number(&row[off]) < 10.0, "{row:?}");
        }
    }
    assert!(diverged > 0 && diverged < rows.len());
    for name in [
        "stability.md",
        "stability-bar-verlet.svg",
        "stability_volume.md",
        "stability-default-bar-30.png",
        "stability-default-hollow-49.svg",
        "stability_default.md",
    ] {
        assert!(dir.path().join(name).exists(), "{name}");
    }
}
