//! The signs and factors of the forces, by finite differences in float64.

use super::common::Noise;
use glam::DVec3;
use palpate::generate;
use palpate::physics::reference::springs::ReferenceSprings;
use palpate::physics::{Damping, DiscreteModel, Material};

fn particles(kind: Damping) -> ReferenceSprings {
    let mesh = generate::paper_bar().unwrap();
    let material = Material {
        damping_kind: kind,
        damping: 0.3,
        damping_time: 1e-4,
        ..Material::from_young(1e5)
    };
    let mut p = ReferenceSprings::new(DiscreteModel::new(&mesh, &material).unwrap());
    let mut noise = Noise(1);
    for (x, v) in p.x.iter_mut().zip(&mut p.v) {
        *x += 0.004 * noise.vector();
        *v = noise.vector();
    }
    p
}

/// Returns the largest difference between two lists, relative to the largest entry of the second.
fn relative(a: &[DVec3], b: &[DVec3]) -> f64 {
    let scale = b.iter().map(|b| b.length()).fold(0.0, f64::max);
    let error = a.iter().zip(b).map(|(a, b)| a.distance(*b));
    error.fold(0.0, f64::max) / scale
}

#[test]
fn force_equals_negative_energy_gradient() {
    let mut p = particles(Damping::Axial);
    p.model.springs_mut().unwrap().damping = 0.0;
    p.model.damping_time = 0.0;
    let forces = p.forces();
    let step = 1e-7;
    let mut measured = vec![DVec3::ZERO; p.x.len()];
    for (i, measured) in measured.iter_mut().enumerate() {
        for axis in 0..3 {
            let x = p.x[i];
            p.x[i][axis] = x[axis] + step;
            let more = p.elastic_energy();
            p.x[i][axis] = x[axis] - step;
            let less = p.elastic_energy();
            p.x[i] = x;
            measured[axis] = -(more - less) / (2.0 * step);
        }
    }
    assert!(relative(&forces, &measured) < 1e-6);
}

#[test]
fn exact_jacobian_equals_force_derivative() {
    let mut p = particles(Damping::Axial);
    p.model.springs_mut().unwrap().damping = 0.0;
    p.model.damping_time = 0.0;
    let direction = Noise(7).vectors(p.x.len());
    let exact = p.stiffness_product(&direction, false);
    let measured = differences(&p, &direction, |p, d, s| {
        for (x, d) in p.x.iter_mut().zip(d) {
            *x += s * *d;
        }
    });
    assert!(relative(&exact, &measured) < 1e-6);
    // The clamped Hessian differs: half of the springs are compressed.
    let clamped = p.stiffness_product(&direction, true);
    assert!(relative(&clamped, &measured) > 1e-3);
}

#[test]
fn damping_matrix_equals_velocity_derivative() {
    for kind in [Damping::Axial, Damping::Relative] {
        let p = particles(kind);
        let direction = Noise(8).vectors(p.x.len());
        let measured = differences(&p, &direction, |p, d, s| {
            for (v, d) in p.v.iter_mut().zip(d) {
                *v += s * *d;
            }
        });
        assert!(relative(&p.damping_product(&direction), &measured) < 1e-6);
    }
}

/// Returns the central difference of the forces along `direction`, applied by `change`.
fn differences(
    p: &ReferenceSprings,
    direction: &[DVec3],
    change: impl Fn(&mut ReferenceSprings, &[DVec3], f64),
) -> Vec<DVec3> {
    let step = 1e-7;
    let at = |s: f64| {
        let mut moved = p.clone();
        change(&mut moved, direction, s);
        moved.forces()
    };
    let (more, less) = (at(step), at(-step));
    more.iter()
        .zip(&less)
        .map(|(a, b)| (*a - *b) / (2.0 * step))
        .collect()
}

#[test]
fn damping_dissipates_and_axial_damping_spares_rotation() {
    for kind in [Damping::Axial, Damping::Relative] {
        let mut p = particles(kind);
        let power: f64 = p
            .damping_product(&p.v)
            .iter()
            .zip(&p.v)
            .map(|(f, v)| f.dot(*v))
            .sum();
        assert!(power < 0.0, "{kind:?}: power of damping {power} W");
        let spin = DVec3::new(0.3, -1.0, 2.0);
        p.v = p.x.iter().map(|x| spin.cross(*x)).collect();
        let brake: f64 = p.damping_product(&p.v).iter().map(|f| f.length()).sum();
        assert_eq!(brake < 1e-9, kind == Damping::Axial, "{kind:?}: {brake} N");
    }
}

#[test]
fn system_is_symmetric_positive_definite() {
    let mut p = particles(Damping::Axial);
    p.pinned[3] = true;
    let mut noise = Noise(5);
    let mut free = || -> Vec<DVec3> {
        let mut v = noise.vectors(p.x.len());
        v[3] = DVec3::ZERO;
        v
    };
    let dot = |a: &[DVec3], b: &[DVec3]| -> f64 { a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum() };
    for _ in 0..20 {
        let (a, b) = (free(), free());
        let (ab, ba) = (
            dot(&a, &p.system_product(0.01, &b)),
            dot(&b, &p.system_product(0.01, &a)),
        );
        assert!((ab - ba).abs() <= 1e-10 * dot(&a, &p.system_product(0.01, &a)));
        assert!(dot(&a, &p.system_product(0.01, &a)) > 0.0);
    }
}
