//! Tests of grid bodies against their float64 reference.
#![allow(clippy::unwrap_used)]

use super::body::CpuGridBody;
use crate::mesher::Domain;
use crate::physics::Material;
use crate::physics::cpu::body::tests::some;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::runtime::energy_guard::StepFailure;
use crate::physics::cpu::scalar::Real;
use crate::physics::grid::reference::GridReference;
use crate::physics::grid::{GridModel, GridShape};
use glam::{DMat3, DVec3};

/// A ball with a hole through it, in metres.
struct Ball;

impl Domain for Ball {
    fn bounds(&self) -> (DVec3, DVec3) {
        (DVec3::splat(-0.05), DVec3::splat(0.05))
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        let inside = (0.05 - p.length()).min(p.truncate().length() - 0.012);
        weights.push((1, inside));
    }
}

fn model(wanted: usize) -> GridModel {
    let axes = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(0.2);
    let shape = GridShape::from_domain_with_count(&Ball, wanted, axes).unwrap();
    let mut model = GridModel::new(shape, &Material::from_young(1e4)).unwrap();
    for (i, f) in model.stiffness_scales.iter_mut().enumerate() {
        *f *= 1.0 + 0.3 * (i as f64).sin();
    }
    model.damping = 3.0;
    model
}

/// Returns a deformed, moving body and its reference, with pins, forces and attachments.
fn pair<T: Real>(
    model: &GridModel,
    slabs: usize,
) -> (CpuGridBody<T>, GridReference, Vec<NodeConstraint>) {
    let mut body = CpuGridBody::<T>::with_slabs(model, slabs);
    let mut twin = model.reference();
    let count = twin.x.len();
    let has = |i: usize| model.masses[i] > 0.0;
    let spacing = model.shape.spacing.x * model.length_unit;
    let low = twin.x.iter().map(|x| x.z).fold(f64::MAX, f64::min);
    let mut pinned = vec![false; count];
    let (moves, forces) = (some(count, 3, 0.05 * spacing), some(count, 4, 1e-4));
    for i in (0..count).filter(|i| has(*i)) {
        twin.x[i] += moves[i];
        twin.forces[i] = forces[i];
        pinned[i] = twin.x[i].z < low + 0.02;
        if pinned[i] {
            twin.inverse_masses[i] = 0.0;
        }
    }
    twin.gravity = DVec3::new(1.0, 2.0, -9.0);
    let h = 0.4 * model.conservative_step();
    let speeds = some(count, 5, 0.02 * spacing / h);
    let v: Vec<DVec3> = (0..count)
        .map(|i| {
            if has(i) && !pinned[i] {
                speeds[i]
            } else {
                DVec3::ZERO
            }
        })
        .collect();
    let last = twin.particles.last().copied().unwrap();
    let held = twin.particles[twin.particles.len() - 9];
    let place = twin.x[held as usize] + DVec3::splat(0.1 * spacing);
    let attachments = vec![
        NodeConstraint::Fixed { node: held, place },
        NodeConstraint::Spring {
            node: last,
            target: twin.x[last as usize] + DVec3::splat(spacing),
            stiffness: 0.1,
            limit: 1e-4,
        },
    ];
    body.set_pinned(&pinned).unwrap();
    body.set_gravity(twin.gravity);
    body.set_forces(&twin.forces).unwrap();
    body.set_state(&twin.x, &v).unwrap();
    body.set_node_constraints(&attachments).unwrap();
    twin.x[held as usize] = place;
    twin.inverse_masses[held as usize] = 0.0;
    for (i, v) in v.iter().enumerate() {
        twin.previous[i] = twin.x[i] - h * (1.0 + 0.5 * model.damping * h) * *v;
    }
    (body, twin, attachments)
}

fn step_both<T: Real>(
    body: &mut CpuGridBody<T>,
    twin: &mut GridReference,
    pull: &NodeConstraint,
    h: f64,
    n: u32,
) {
    let NodeConstraint::Spring {
        node,
        target,
        stiffness,
        limit,
    } = *pull
    else {
        return;
    };
    let i = node as usize;
    let plain = twin.forces[i];
    for step in 0..n {
        let f = stiffness * (target - twin.x[i]);
        twin.forces[i] = plain + f * (limit / f.length()).min(1.0);
        if step == 0 && body.steps() == 0 {
            twin.first_step(h);
        } else {
            twin.step(h);
        }
        body.run(1, h).unwrap();
    }
    twin.forces[i] = plain;
}

fn error<T: Real>(body: &CpuGridBody<T>, twin: &GridReference, model: &GridModel) -> f64 {
    let rest = model.reference().x;
    let (mut off, mut motion) = (0.0, 0.0);
    for (i, x) in body.positions().iter().enumerate() {
        off += x.distance_squared(twin.x[i]);
        motion += twin.x[i].distance_squared(rest[i]);
    }
    (off / motion).sqrt()
}

#[test]
fn grid_step_matches_reference() {
    let model = model(3000);
    let h = 0.4 * model.conservative_step();
    for slabs in [1, 2, 5] {
        let (mut body, mut twin, attached) = pair::<f64>(&model, slabs);
        step_both(&mut body, &mut twin, &attached[1], h, 100);
        let exact = error(&body, &twin, &model);
        let (mut single, mut twin, attached) = pair::<f32>(&model, slabs);
        step_both(&mut single, &mut twin, &attached[1], h, 100);
        let rounded = error(&single, &twin, &model);
        println!("{slabs} slabs: {exact:.1e}, in f32 {rounded:.1e}");
        assert!(exact < 1e-10 && rounded < 1e-5, "{exact} {rounded}");
        // Normals.
        for (i, n) in body.normals().iter().enumerate() {
            let sum = twin.normal(i);
            let wanted = if sum.length() >= 0.5 {
                sum.normalize()
            } else {
                DVec3::ZERO
            };
            let near = (sum.length() - 0.5).abs() < 1e-3;
            assert!(near || n.distance(wanted) < 1e-4, "{i}: {n} {wanted}");
        }
        // The comparison detects a small perturbation.
        let (mut body, mut twin, attached) = pair::<f64>(&model, slabs);
        twin.stiffness[4] *= 1.001;
        step_both(&mut body, &mut twin, &attached[1], h, 100);
        assert!(error(&body, &twin, &model) > 1e-6);
    }
}

#[test]
fn cut_removes_springs_and_resumed_run_is_identical() {
    let model = model(2000);
    let h = 0.4 * model.conservative_step();
    let (mut body, mut twin, attached) = pair::<f64>(&model, 2);
    step_both(&mut body, &mut twin, &attached[1], h, 10);
    let particle = twin.particles[twin.particles.len() / 2] as usize;
    for kind in 0..9 {
        for (bit, sign) in [(2 * kind, 1), (2 * kind + 1, -1)] {
            if twin.springs[particle] >> bit & 1 == 1 {
                let j = (particle as i64 + sign * twin.offsets[kind]) as usize;
                twin.springs[j] &= !(1 << (bit ^ 1));
            }
        }
    }
    twin.springs[particle] = 0;
    body.set_springs(&twin.springs).unwrap();
    step_both(&mut body, &mut twin, &attached[1], h, 30);
    assert!(error(&body, &twin, &model) < 1e-10);
    // A change of the step length keeps the velocity.
    let state = body.state();
    body.run(5, 0.5 * h).unwrap();
    let (mut other, _, _) = pair::<f64>(&model, 2);
    other.set_springs(&twin.springs).unwrap();
    other.resume(&state).unwrap();
    other.run(5, 0.5 * h).unwrap();
    assert_eq!(body.state(), other.state());
    assert!(other.set_springs(&vec![1 << 20; twin.x.len()]).is_err());
    assert!(other.set_pinned(&[true]).is_err());
}

#[test]
fn diverged_grid_keeps_last_valid_state() {
    let model = model(1000);
    let (mut body, _, _) = pair::<f32>(&model, 2);
    let h = 4.0 * model.conservative_step();
    let mut before = body.positions();
    let failure = loop {
        match body.run(1, h) {
            Ok(()) => before = body.positions(),
            Err(failure) => break failure,
        }
        assert!(body.steps() < 1000);
    };
    assert!(
        matches!(failure, StepFailure::Diverged | StepFailure::NonFinite),
        "{failure}"
    );
    assert_eq!(before, body.positions());
    assert!(matches!(
        body.run(1, f64::NAN),
        Err(StepFailure::BadStep { .. })
    ));
    body.set_forces(&vec![DVec3::splat(1e300); before.len()])
        .unwrap();
    assert_eq!(body.run(1, 1e-3), Err(StepFailure::NonFinite));
    assert_eq!(before, body.positions());
}
