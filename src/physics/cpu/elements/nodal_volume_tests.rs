//! Tests of steps of bodies with averaged nodal volumes.
#![allow(clippy::unwrap_used)]

use super::tests::bar;
use crate::physics::cpu::body::CpuBody;
use crate::physics::cpu::scalar::Real;
use crate::physics::{
    CgSettings, ConstitutiveModel, DiscreteModel, Element, NewtonSettings, SolverKind,
    VolumetricFormulation,
};
use glam::DVec3;

const EXACT: NewtonSettings = NewtonSettings {
    iterations: 40,
    tolerance: 1e-10,
    linear_tolerance: 1e-3,
};

const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);

/// The bar with ν = 0.49.
fn soft_bar(cells: [usize; 3], law: ConstitutiveModel) -> DiscreteModel {
    let mut network = bar(cells, law, false);
    let rest = network.rest_positions.clone();
    let elements = network.elements_mut().unwrap();
    elements.volume = VolumetricFormulation::NodalAveraged;
    for e in &mut elements.tets {
        let corners = e.nodes.map(|v| rest[v as usize]);
        *e = Element::new(e.nodes, corners, 1e6, 0.49, law).unwrap();
    }
    network
}

fn body<T: Real>(network: &DiscreteModel, chunks: usize, settings: NewtonSettings) -> CpuBody<T> {
    let (kind, cg) = (SolverKind::Implicit, CgSettings::default());
    let mut body = CpuBody::new(network, kind, cg, Some(chunks)).unwrap();
    body.set_newton(settings).unwrap();
    body.set_pinned(&end(network)).unwrap();
    body.set_gravity(GRAVITY);
    body
}

/// Marks the nodes of the end at low x.
fn end(network: &DiscreteModel) -> Vec<bool> {
    let low = network
        .rest_positions
        .iter()
        .map(|p| p.x)
        .fold(f64::MAX, f64::min);
    network
        .rest_positions
        .iter()
        .map(|p| p.x < low + 1e-9)
        .collect()
}

#[test]
fn step_solves_its_equation() {
    for (law, chunks) in [
        (ConstitutiveModel::NeoHookean, 1),
        (ConstitutiveModel::Corotated, 3),
    ] {
        let network = soft_bar([5, 3, 2], law);
        let mut body = body::<f64>(&network, chunks, EXACT);
        let h = 0.004;
        for _ in 0..5 {
            let before = body.velocities();
            body.run(1, h).unwrap();
            let (x, v) = (body.positions(), body.velocities());
            let elements = network.elements().unwrap().forces(&x);
            let pinned = end(&network);
            let (mut worst, mut largest) = (0.0f64, 0.0f64);
            for i in (0..x.len()).filter(|i| !pinned[*i]) {
                let m = network.masses[i];
                let off = m * GRAVITY + elements[i] - (v[i] - before[i]) * m / h;
                worst = worst.max(off.length());
                largest = largest.max(elements[i].length());
            }
            assert!(worst < 1e-7 * largest, "{law:?} {worst} {largest}");
        }
    }
}

#[test]
fn f32_and_chunked_steps_match_f64() {
    let network = soft_bar([12, 3, 3], ConstitutiveModel::NeoHookean);
    let mut truth = body::<f64>(&network, 1, EXACT);
    let mut shared = body::<f64>(&network, 2, EXACT);
    let mut quick = body::<f32>(&network, 2, NewtonSettings::default());
    let (mut errors, mut motion) = ([0.0f64; 2], 0.0);
    for _ in 0..40 {
        truth.run(1, 0.01).unwrap();
        shared.run(1, 0.01).unwrap();
        quick.run(1, 0.01).unwrap();
        let x = truth.positions();
        let square =
            |a: &[DVec3]| -> f64 { a.iter().zip(&x).map(|(a, x)| a.distance_squared(*x)).sum() };
        errors[0] += square(&shared.positions());
        errors[1] += square(&quick.positions());
        motion += square(&network.rest_positions);
    }
    let worst = errors.map(|e| (e / motion).sqrt());
    println!("two chunks {:.1e}, default {:.1e}", worst[0], worst[1]);
    assert!(worst[0] < 1e-8 && worst[1] < 1e-2, "{worst:?}");
}

/// Starts from almost random positions, from which a body of ν = 0.49 may stay tangled with any
/// volumetric formulation.
#[test]
#[ignore = "long: scripts/test --full"]
fn inverted_states_recover() {
    for law in [ConstitutiveModel::NeoHookean, ConstitutiveModel::Corotated] {
        let mut network = soft_bar([8, 4, 4], law);
        network.elements_mut().unwrap().mass_damping = 4.0;
        let mut settled = body::<f64>(&network, 1, NewtonSettings::default());
        settled.run(400, 0.01).unwrap();
        let rest = settled.positions();
        for name in ["flat", "mirrored", "stretched"] {
            let mut body = body::<f32>(&network, 1, NewtonSettings::default());
            let pinned = end(&network);
            let ruin = |p: DVec3| match name {
                "flat" => p * DVec3::new(1.0, 1.0, 0.0),
                "mirrored" => p * DVec3::new(1.0, 1.0, -1.0),
                _ => p * DVec3::new(3.0, 1.0, 1.0),
            };
            let places = network.rest_positions.iter().zip(&pinned);
            let wreck: Vec<DVec3> = places
                .map(|(p, pinned)| if *pinned { *p } else { ruin(*p) })
                .collect();
            body.set_state(&wreck, &vec![DVec3::ZERO; wreck.len()])
                .unwrap();
            body.run(400, 0.01).unwrap();
            let x = body.positions();
            let tets = network.tets().iter();
            let inverted =
                tets.filter(|e| e.deformation_gradient(&e.node_positions(&x)).determinant() <= 0.0);
            let inverted = inverted.count();
            let apart = x.iter().zip(&rest).map(|(a, b)| a.distance(*b));
            let apart = apart.fold(0.0, f64::max);
            println!("{law:?} {name}: {inverted} inverted, {apart:.1e} m from rest");
            assert!(inverted == 0 && apart < 0.01, "{law:?} {name}");
        }
    }
}
