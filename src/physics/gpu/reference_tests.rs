//! Tests of the kernels one by one against the float64 reference: forces, Jacobian products,
//! energies.
#![allow(clippy::unwrap_used)]

use super::integrator::{Integrator, Stage, Timing};
use super::status::gpu_data::Status;
use crate::generate;
use crate::gpu::{Array, Gpu};
use crate::mesh::TetMesh;
use crate::physics::reference::springs::ReferenceSprings;
use crate::physics::{
    Damping, DiscreteModel, Floor, GpuBody, ImplicitEuler, Material, NodeTerm, Solver,
};
use glam::DVec3;
use std::sync::Arc;

/// Reproducible pseudo-random numbers in −1..1.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    }
}

fn vectors(count: usize, seed: u64) -> Vec<DVec3> {
    let mut next = noise(seed);
    (0..count)
        .map(|_| DVec3::new(next(), next(), next()))
        .collect()
}

/// A perturbed body, and its float64 reference at the same state rounded to f32.
fn twins(
    gpu: &Gpu,
    mesh: &TetMesh,
    (damping_kind, terms): (Damping, Vec<Arc<dyn NodeTerm>>),
) -> (GpuBody, ReferenceSprings) {
    let material = Material {
        damping: 0.2,
        damping_time: 1e-3,
        damping_kind,
        ..Material::from_young(1e5)
    };
    let mut body = GpuBody::new(gpu, mesh, &material).unwrap();
    let mut truth = ReferenceSprings::new(DiscreteModel::new(mesh, &material).unwrap());
    body.set_gravity(DVec3::new(1.0, 2.0, -9.81));
    truth.gravity = body.gravity();
    let nodes = mesh.nodes.len();
    let extent = body.nodes().frame().scale;
    let x: Vec<DVec3> = mesh
        .nodes
        .iter()
        .zip(vectors(nodes, 1))
        .map(|(p, d)| *p + 0.02 * extent * d)
        .collect();
    body.set_positions(&x).unwrap();
    body.set_velocities(&vectors(nodes, 2)).unwrap();
    body.set_forces(&vectors(nodes, 3)).unwrap();
    truth.external = vectors(nodes, 3)
        .iter()
        .map(|f| f.as_vec3().as_dvec3())
        .collect();
    let model = DiscreteModel::new(mesh, &material).unwrap();
    truth.x = body
        .positions()
        .unwrap()
        .iter()
        .map(|p| model.to_metres(*p))
        .collect();
    truth.v = body.velocities().unwrap();
    for term in &terms {
        body.add_term(term.clone()).unwrap();
    }
    truth.terms = terms;
    (body, truth)
}

/// Both kinds of damping, with no node term, one floor, and two floors.
fn kinds() -> Vec<(Damping, Vec<Arc<dyn NodeTerm>>)> {
    let floor = |normal: DVec3| -> Arc<dyn NodeTerm> {
        // Passes through the middle of the body.
        Arc::new(Floor::new(0.001 * normal, normal, 400.0).unwrap())
    };
    let [a, b] = [DVec3::new(0.1, 0.2, 1.0), DVec3::new(-1.0, 0.3, 0.2)].map(floor);
    vec![
        (Damping::Axial, Vec::new()),
        (Damping::Relative, Vec::new()),
        (Damping::Axial, vec![a.clone()]),
        (Damping::Relative, vec![a, b]),
    ]
}

fn meshes() -> Vec<TetMesh> {
    vec![
        generate::paper_bar().unwrap(),
        generate::ball(0.07, 8).unwrap(),
        generate::bar_of_about(3000, DVec3::new(0.4, 0.1, 0.1)).unwrap(),
    ]
}

fn read(gpu: &Gpu, array: &Array, unit: f64) -> Vec<DVec3> {
    let values: Vec<[f32; 4]> = gpu.read_array(array).unwrap();
    values
        .iter()
        .map(|v| DVec3::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2])) * unit)
        .collect()
}

/// Largest error relative to its node's scale.
fn worst(found: &[DVec3], truth: &[DVec3], scale: &[f64]) -> f64 {
    let errors = found.iter().zip(truth).zip(scale);
    errors
        .map(|((a, b), s)| a.distance(*b) / s)
        .fold(
            0.0,
            |worst, e| if e.is_nan() { f64::NAN } else { worst.max(e) },
        )
}

#[test]
fn forces_and_energies_match_float64() {
    let gpu = Gpu::new().unwrap();
    for mesh in meshes() {
        for kind in kinds() {
            let (body, mut truth) = twins(&gpu, &mesh, kind.clone());
            let solver = ImplicitEuler::new(&gpu, &body).unwrap();
            let state = body.nodes().array();
            let mut work = gpu.start_recording();
            let passes = solver
                .core
                .force_passes(&body, state, &body.velocities, false);
            for pass in passes.unwrap() {
                pass.record(&mut work);
            }
            work.submit().unwrap();
            let found = read(&gpu, &solver.core.forces, body.units.force());
            let scale = truth.force_magnitude_sum();
            let error = worst(&found, &truth.forces(), &scale);
            assert!(error < 1e-5, "{kind:?}: {error}");

            let partials: Vec<[f32; 4]> = gpu.read_buffer(&solver.core.partials).unwrap();
            let sum = |k: usize| partials.iter().map(|p| f64::from(p[k])).sum::<f64>();
            let kinetic = sum(0) * body.units.energy() / truth.kinetic_energy();
            let elastic = sum(1) * body.units.energy() / truth.elastic_energy();
            assert!((kinetic - 1.0).abs() < 1e-5, "{kinetic}");
            assert!((elastic - 1.0).abs() < 1e-4, "{elastic}");
            assert_eq!(sum(3), 0.0);

            // Sensitivity check: the comparison detects a missing floor, and one spring that is
            // five hundredths stiffer.
            if !truth.terms.is_empty() {
                let floors = std::mem::take(&mut truth.terms);
                assert!(worst(&found, &truth.forces(), &scale) > 1e-4);
                truth.terms = floors;
            }
            truth.model.edges[7].stiffness *= 1.05;
            assert!(worst(&found, &truth.forces(), &scale) > 1e-5);
        }
    }
}

#[test]
fn system_products_match_float64() {
    let gpu = Gpu::new().unwrap();
    for mesh in meshes() {
        for kind in kinds() {
            let (mut body, mut truth) = twins(&gpu, &mesh, kind.clone());
            body.pin_nodes(&[2, 5]).unwrap();
            body.upload_changes().unwrap();
            truth.pinned[2] = true;
            truth.pinned[5] = true;
            let h = 0.01;
            let solver = ImplicitEuler::new(&gpu, &body).unwrap();
            let dt = (h / body.units.time) as f32;
            let timing = Timing {
                dt,
                previous_dt: dt,
            };
            let mut p: Vec<DVec3> = vectors(mesh.nodes.len(), 9)
                .iter()
                .map(|p| p.as_vec3().as_dvec3())
                .collect();
            p[2] = DVec3::ZERO;
            p[5] = DVec3::ZERO;
            let found = product(&gpu, &solver, &body, timing, &p);
            let exact = truth.system_product(h, &p);
            // Σ|A||p| of each node's row, from its blocks: the scale of the rounding error.
            let scale: Vec<f64> = truth
                .system_blocks(h)
                .iter()
                .map(|b| {
                    let rows = b.transpose();
                    [rows.x_axis, rows.y_axis, rows.z_axis]
                        .iter()
                        .map(|r| r.abs().element_sum())
                        .sum::<f64>()
                })
                .collect();
            let error = worst(&found, &exact, &scale);
            assert!(error < 1e-5, "{kind:?}: {error}");
            // Sensitivity check: the exact Jacobian differs from the clamped one.
            let k = truth.stiffness_product(&p, false);
            let c = truth.damping_product(&p);
            let unclamped: Vec<DVec3> = (0..p.len())
                .map(|i| match truth.pinned[i] {
                    true => DVec3::ZERO,
                    false => truth.model.masses[i] * p[i] - h * c[i] - h * h * k[i],
                })
                .collect();
            assert!(worst(&found, &unclamped, &scale) > 1e-3);
        }
    }
}

/// Computes A p on the GPU, in SI units: one iteration whose first direction is p.
fn product(
    gpu: &Gpu,
    solver: &ImplicitEuler,
    body: &GpuBody,
    timing: Timing,
    p: &[DVec3],
) -> Vec<DVec3> {
    let step = solver.scheme.step(&solver.core, body, timing).unwrap();
    let [Stage::Passes(begin), Stage::Loop { gate, rounds, .. }, ..] = &step.stages[..] else {
        panic!("an implicit step must begin with the system and its solve")
    };
    let mut work = gpu.start_recording();
    begin[0].record(&mut work);
    work.submit().unwrap();
    let first: Vec<[f32; 4]> = p
        .iter()
        .map(|p| p.as_vec3().extend(0.0).to_array())
        .collect();
    gpu.write_array(&solver.scheme.preconditioned[0], &first)
        .unwrap();
    let mut work = gpu.start_recording();
    gate.record(&mut work);
    rounds[0].record(&mut work);
    work.submit().unwrap();
    read(gpu, &solver.scheme.product, body.units.mass)
}

/// A solve with too few iterations continues in the passes recorded for the next steps, and reaches
/// the same state.
#[test]
fn unfinished_solve_is_continued() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::bar_of_about(3000, DVec3::new(0.4, 0.1, 0.1)).unwrap();
    let run = |iterations: u32| {
        let (mut body, _) = twins(&gpu, &mesh, (Damping::Axial, Vec::new()));
        let mut solver = ImplicitEuler::new(&gpu, &body).unwrap();
        let mut work = gpu.start_recording();
        solver
            .record_steps(&mut work, &mut body, 6, 0.01, iterations)
            .unwrap();
        work.submit().unwrap();
        let status: Vec<Status> = gpu.read_buffer(&solver.core.status).unwrap();
        if status[0].steps < 6 {
            assert_eq!(status[0].solving, 1);
            let left = 6 - status[0].steps;
            solver.run(&mut body, left, 0.01).unwrap();
        }
        (status[0].steps, body.positions().unwrap())
    };
    let (all, whole) = run(256);
    let (some, resumed) = run(8);
    assert_eq!(all, 6);
    assert!(some < 6, "{some} steps finished in 8 iterations each");
    let apart = whole.iter().zip(&resumed).map(|(a, b)| a.distance(*b));
    assert!(apart.fold(0.0, f64::max) < 1e-6);
}
