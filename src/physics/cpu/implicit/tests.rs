//! Tests of implicit steps of bodies with finite elements.
#![allow(clippy::unwrap_used)]

use super::schemes::ImplicitScheme;
use crate::generate;
use crate::mesh::ElementOrder;
use crate::physics::cpu::body::CpuBody;
use crate::physics::cpu::body::tests::{noise, some};
use crate::physics::cpu::elements::tests::bar;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::node_terms::NodeTerms;
use crate::physics::cpu::scalar::Real;
use crate::physics::{
    CgSettings, ConstitutiveModel, DiscreteModel, Floor, Material, MaterialModel, NewtonSettings,
    SolverKind,
};
use glam::{DMat3, DVec3};
use std::sync::Arc;

const EXACT: NewtonSettings = NewtonSettings {
    iterations: 40,
    tolerance: 1e-10,
    linear_tolerance: 1e-3,
};

const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);

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

/// Returns a body pinned at one end, under gravity.
fn body<T: Real>(network: &DiscreteModel, chunks: usize, settings: NewtonSettings) -> CpuBody<T> {
    let (kind, cg) = (SolverKind::Implicit, CgSettings::default());
    let mut body = CpuBody::new(network, kind, cg, Some(chunks)).unwrap();
    body.set_newton(settings).unwrap();
    body.set_pinned(&end(network)).unwrap();
    body.set_gravity(GRAVITY);
    body
}

/// Returns the mass-weighted difference relative to the motion of `b`.
fn off(network: &DiscreteModel, a: &[DVec3], b: &[DVec3]) -> f64 {
    let sum = |x: &[DVec3], y: &[DVec3]| -> f64 {
        let all = network.masses.iter().zip(x).zip(y);
        all.map(|((m, x), y)| m * x.distance_squared(*y)).sum()
    };
    (sum(a, b) / sum(b, &network.rest_positions)).sqrt()
}

/// Counts the elements that are inverted: quadratic tets at a quadrature point.
fn inverted(network: &DiscreteModel, x: &[DVec3]) -> usize {
    let elements = network.elements().unwrap();
    let is_inverted = |t: &usize| match elements.quadratic_nodes(*t) {
        None => {
            let element = &elements.tets[*t];
            element
                .deformation_gradient(&element.node_positions(x))
                .determinant()
                <= 0.0
        }
        Some(nodes) => {
            let shape = elements.quadratic_shape(*t).unwrap();
            let strains = shape.deformation_gradients(&nodes.map(|v| x[v as usize]));
            strains.iter().any(|f| f.determinant() <= 0.0)
        }
    };
    (0..elements.tets.len()).filter(is_inverted).count()
}

fn forces(network: &DiscreteModel, x: &[DVec3]) -> Vec<DVec3> {
    let mut f = vec![DVec3::ZERO; x.len()];
    let elements = network.elements().unwrap();
    for e in &elements.tets {
        let corners = e.nodes.map(|v| x[v as usize]);
        for (v, force) in e.nodes.iter().zip(e.forces(elements.law, &corners)) {
            f[*v as usize] += force;
        }
    }
    f
}

#[test]
fn step_solves_its_equation() {
    // Elements, their weight and a floor; the edges exert no forces.
    for (law, chunks) in [
        (ConstitutiveModel::NeoHookean, 1),
        (ConstitutiveModel::Corotated, 3),
    ] {
        let network = bar([5, 3, 2], law, true);
        let mut body = body::<f64>(&network, chunks, EXACT);
        let floor = Floor::new(DVec3::new(0.0, 0.0, -0.05), DVec3::Z, 3e4).unwrap();
        let floor = Arc::new(floor);
        let term = NodeTerms::new(floor.clone(), &network, body.layout());
        body.add_term(Box::new(term));
        let h = 0.004;
        for _ in 0..5 {
            let before = body.velocities();
            body.run(1, h).unwrap();
            let (x, v) = (body.positions(), body.velocities());
            let elements = forces(&network, &x);
            let pinned = end(&network);
            let (mut worst, mut largest) = (0.0f64, 0.0f64);
            for i in (0..x.len()).filter(|i| !pinned[*i]) {
                use crate::physics::NodeTerm;
                let m = network.masses[i];
                let push = m * GRAVITY + elements[i] + floor.force(m, x[i]);
                worst = worst.max((push - (v[i] - before[i]) * m / h).length());
                largest = largest.max(elements[i].length());
            }
            assert!(worst < 1e-7 * largest, "{law:?} {worst} {largest}");
        }
    }
}

/// Runs bodies of `network` from five inverted or distorted states until they are at rest.
fn check_recovery(network: &DiscreteModel) {
    let elements = network.elements().unwrap();
    let what = format!("{:?}, order {}", elements.law, elements.order());
    let mut settled = body::<f64>(network, 1, NewtonSettings::default());
    settled.run(300, 0.01).unwrap();
    let rest = settled.positions();
    let mut next = noise(3);
    let mut random = |p: DVec3| {
        let mut n = || 0.5 * (next() + 1.0);
        DVec3::new(0.8 * n(), 0.2 * n(), 0.2 * n()) + 0.0 * p
    };
    let middle = network.rest_positions.iter().sum::<DVec3>() / network.rest_positions.len() as f64;
    let mut ruin = |name: &str, p: DVec3| match name {
        "scrambled" => random(p) - 0.5 * DVec3::new(0.8, 0.2, 0.2) + middle,
        "flat" => p * DVec3::new(1.0, 1.0, 0.0),
        "point" => middle + 1e-3 * (random(p) - middle),
        "mirrored" => p * DVec3::new(1.0, 1.0, -1.0),
        _ => p * DVec3::new(3.0, 1.0, 1.0),
    };
    for name in ["scrambled", "flat", "point", "mirrored", "stretched"] {
        let mut body = body::<f32>(network, 1, NewtonSettings::default());
        let pinned = end(network);
        let wreck: Vec<DVec3> = network
            .rest_positions
            .iter()
            .zip(&pinned)
            .map(|(p, pinned)| if *pinned { *p } else { ruin(name, *p) })
            .collect();
        body.set_state(&wreck, &vec![DVec3::ZERO; wreck.len()])
            .unwrap();
        body.set_inversion_allowed(true);
        let mut good = None;
        for n in 0..300 {
            body.run(1, 0.01).unwrap();
            if good.is_none() && inverted(network, &body.positions()) == 0 {
                good = Some(n + 1);
            }
        }
        let x = body.positions();
        println!(
            "{what}, {name}: {} inverted at first, none after {good:?} steps, {:.1e} from rest",
            inverted(network, &wreck),
            off(network, &x, &rest)
        );
        assert_eq!(inverted(network, &x), 0, "{what}, {name}");
        assert!(off(network, &x, &rest) < 0.05, "{what}, {name}");
    }
}

#[test]
fn inverted_states_recover() {
    for law in [ConstitutiveModel::NeoHookean, ConstitutiveModel::Corotated] {
        let mut network = bar([8, 4, 4], law, false);
        network.elements_mut().unwrap().mass_damping = 4.0;
        check_recovery(&network);
    }
}

/// As many nodes as those of the linear tets, which start at the same places.
#[test]
fn inverted_states_of_quadratic_tets_recover() {
    for model in [MaterialModel::NeoHookean, MaterialModel::Corotated] {
        let mesh = generate::bar([4, 2, 2], DVec3::new(0.8, 0.2, 0.2)).unwrap();
        let material = Material {
            model,
            order: ElementOrder::Quadratic,
            poisson: 0.3,
            mass_damping: 4.0,
            ..Material::from_young(1e6)
        };
        let mesh = mesh.with_mid_edge_nodes().unwrap();
        check_recovery(&DiscreteModel::new(&mesh, &material).unwrap());
    }
}

#[test]
fn f32_and_chunked_steps_match_f64() {
    for law in [ConstitutiveModel::NeoHookean, ConstitutiveModel::Corotated] {
        let network = bar([12, 3, 3], law, false);
        let mut truth = body::<f64>(&network, 1, EXACT);
        let fine = NewtonSettings {
            iterations: 3,
            tolerance: 1e-5,
            linear_tolerance: 1e-3,
        };
        let mut narrow = body::<f32>(&network, 1, fine);
        let mut shared = body::<f64>(&network, 2, EXACT);
        let mut quick = body::<f32>(&network, 2, NewtonSettings::default());
        assert_eq!(shared.chunk_count(), 2);
        let (mut errors, mut motion) = ([0.0f64; 3], 0.0);
        for _ in 0..60 {
            truth.run(1, 0.01).unwrap();
            let x = truth.positions();
            let others = [
                {
                    narrow.run(1, 0.01).unwrap();
                    narrow.positions()
                },
                {
                    shared.run(1, 0.01).unwrap();
                    shared.positions()
                },
                {
                    quick.run(1, 0.01).unwrap();
                    quick.positions()
                },
            ];
            let square = |a: &[DVec3]| -> f64 {
                a.iter().zip(&x).map(|(a, x)| a.distance_squared(*x)).sum()
            };
            for (e, o) in errors.iter_mut().zip(&others) {
                *e += square(o);
            }
            motion += square(&network.rest_positions);
        }
        let worst = errors.map(|e| (e / motion).sqrt());
        println!(
            "{law:?}: f32 {:.1e}, two chunks {:.1e}, default {:.1e}",
            worst[0], worst[1], worst[2]
        );
        assert!(
            worst[0] < 1e-4 && worst[1] < 1e-8 && worst[2] < 5e-3,
            "{worst:?}"
        );
    }
}

#[test]
fn momentum_is_conserved() {
    for (law, rule) in [
        (ConstitutiveModel::NeoHookean, ImplicitScheme::Euler),
        (ConstitutiveModel::Corotated, ImplicitScheme::Midpoint),
        (ConstitutiveModel::NeoHookean, ImplicitScheme::Bdf2),
    ] {
        let mut network = bar([4, 2, 2], law, false);
        network.damping_time = 1e-3;
        // To the accuracy of the linear solves.
        let mut body = body::<f64>(&network, 2, EXACT);
        body.set_scheme(rule);
        body.set_pinned(&vec![false; network.rest_positions.len()])
            .unwrap();
        body.set_gravity(DVec3::ZERO);
        let x: Vec<DVec3> = network
            .rest_positions
            .iter()
            .zip(some(network.rest_positions.len(), 2, 0.02))
            .map(|(x, d)| *x + d)
            .collect();
        body.set_state(&x, &some(network.rest_positions.len(), 6, 1.0))
            .unwrap();
        let momentum = |body: &CpuBody<f64>| -> DVec3 {
            body.velocities()
                .iter()
                .zip(&network.masses)
                .map(|(v, m)| *v * *m)
                .sum()
        };
        let before = momentum(&body);
        body.run(30, 0.01).unwrap();
        let after = momentum(&body);
        assert!(
            after.distance(before) < 1e-6 * before.length(),
            "{rule:?} {before} {after}"
        );
        assert!(before.length() > 1e-3);
    }
}

#[test]
fn affine_patch_stays_affine() {
    let network = bar([4, 4, 4], ConstitutiveModel::NeoHookean, false);
    let mut body = body::<f64>(&network, 1, EXACT);
    body.set_gravity(DVec3::ZERO);
    body.set_pinned(&vec![false; network.rest_positions.len()])
        .unwrap();
    let turn = DMat3::from_cols_array(&[1.1, 0.05, 0.0, -0.1, 0.95, 0.1, 0.05, 0.0, 1.05]);
    let high = network
        .rest_positions
        .iter()
        .fold(DVec3::MIN, |a, b| a.max(*b));
    let inside = |p: &DVec3| (p.abs() - high).max_element() < -1e-9;
    let holds: Vec<NodeConstraint> = (0..network.rest_positions.len() as u32)
        .filter(|v| !inside(&network.rest_positions[*v as usize]))
        .map(|node| NodeConstraint::Fixed {
            node,
            place: turn * network.rest_positions[node as usize],
        })
        .collect();
    assert!(holds.len() < network.rest_positions.len() - 20);
    body.set_node_constraints(&holds).unwrap();
    body.run(200, 0.1).unwrap();
    for (x, p) in body.positions().iter().zip(&network.rest_positions) {
        assert!(x.distance(turn * *p) < 1e-8, "{x} {}", turn * *p);
    }
}

/// Returns the positions after the given number of steps.
fn end_of(network: &DiscreteModel, rule: ImplicitScheme, steps: u32, uneven: bool) -> Vec<DVec3> {
    let mut body = body::<f64>(network, 1, EXACT);
    body.set_scheme(rule);
    let h = 0.1 / f64::from(steps);
    for n in 0..steps {
        let by = if uneven {
            [0.8, 1.2][n as usize % 2]
        } else {
            1.0
        };
        body.run(1, by * h).unwrap();
    }
    body.positions()
}

#[test]
fn schemes_converge_at_expected_order() {
    for (beta, alpha, law) in [
        (0.0, 0.0, ConstitutiveModel::NeoHookean),
        (5e-3, 2.0, ConstitutiveModel::Corotated),
    ] {
        let mut network = bar([4, 1, 1], law, false);
        network.damping_time = beta;
        network.elements_mut().unwrap().mass_damping = alpha;
        let truth = end_of(&network, ImplicitScheme::Midpoint, 4096, false);
        for (rule, uneven, order) in [
            (ImplicitScheme::Euler, false, 1.0),
            (ImplicitScheme::Bdf2, false, 2.0),
            (ImplicitScheme::Bdf2, true, 2.0),
            (ImplicitScheme::Midpoint, false, 2.0),
        ] {
            let errors =
                [128, 256, 512].map(|n| off(&network, &end_of(&network, rule, n, uneven), &truth));
            let found = (errors[1] / errors[2]).log2();
            println!("damped {beta} {alpha}: {rule:?} {uneven} {errors:?}: {found:.2}");
            assert!((found - order).abs() < 0.25, "{rule:?} {found}");
        }
    }
}

#[test]
fn explicit_schemes_support_elements() {
    let mut network = bar([4, 1, 1], ConstitutiveModel::NeoHookean, false);
    network.damping_time = 1e-4;
    network.elements_mut().unwrap().mass_damping = 3.0;
    let truth = end_of(&network, ImplicitScheme::Midpoint, 1024, false);
    for law in [ConstitutiveModel::NeoHookean, ConstitutiveModel::Corotated] {
        let mut network = network.clone();
        let truth = match law {
            ConstitutiveModel::NeoHookean => truth.clone(),
            ConstitutiveModel::Corotated => {
                network = bar([4, 1, 1], law, false);
                network.damping_time = 1e-4;
                network.elements_mut().unwrap().mass_damping = 3.0;
                end_of(&network, ImplicitScheme::Midpoint, 1024, false)
            }
        };
        for kind in [
            SolverKind::VelocityVerlet,
            SolverKind::Verlet,
            SolverKind::Symplectic,
        ] {
            let cg = CgSettings::default();
            let mut body = CpuBody::<f64>::new(&network, kind, cg, Some(2)).unwrap();
            body.set_pinned(&end(&network)).unwrap();
            body.set_gravity(GRAVITY);
            body.run(20000, 0.1 / 20000.0).unwrap();
            let error = off(&network, &body.positions(), &truth);
            println!("{law:?} {kind}: {error:.1e}");
            assert!(error < 1e-3, "{kind} {error}");
        }
    }
}

#[test]
fn resumed_run_is_bitwise_identical() {
    for (beta, rule) in [(0.0, ImplicitScheme::Euler), (1e-3, ImplicitScheme::Bdf2)] {
        let mut network = bar([8, 2, 2], ConstitutiveModel::NeoHookean, false);
        network.damping_time = beta;
        for chunks in [1, 2] {
            let new = || {
                let mut body = body::<f32>(&network, chunks, NewtonSettings::default());
                body.set_scheme(rule);
                body
            };
            let (mut one, mut other) = (new(), new());
            one.run(13, 0.01).unwrap();
            let state = one.state();
            one.run(20, 0.01).unwrap();
            other.resume(&state).unwrap();
            other.run(20, 0.01).unwrap();
            assert_eq!(one.state(), other.state());
        }
    }
}
