//! Tests of rigid bodies against closed-form solutions, and against very stiff bodies.
#![allow(clippy::unwrap_used)]

use crate::generate;
use crate::mesh::{Field, Location};
use crate::physics::cpu::body::CpuBody;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::scalar::Real;
use crate::physics::{
    CgSettings, DiscreteModel, Material, MaterialModel, NewtonSettings, RegionMaterial, SolverKind,
    Stiffness,
};
use glam::{DMat3, DQuat, DVec3};

const EXACT: NewtonSettings = NewtonSettings {
    iterations: 60,
    tolerance: 1e-11,
    linear_tolerance: 1e-4,
};

/// Returns a bar of soft material in which region 1, selected by `bone`, is rigid, or has the
/// Young's modulus `young` if given.
fn bar(
    cells: [usize; 3],
    bone: impl Fn(DVec3) -> bool,
    young: Option<f64>,
    damping_time: f64,
) -> DiscreteModel {
    let size = DVec3::new(0.8, 0.2, 0.2);
    let mut mesh = generate::bar(cells, size).unwrap();
    let labels = (0..mesh.tets.len()).map(|t| {
        let middle = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
        f64::from(u8::from(bone(middle / size)))
    });
    let labels = Field::scalar("label", Location::Cell, labels.collect());
    mesh.set_field(labels).unwrap();
    let mut material = Material {
        model: MaterialModel::NeoHookean,
        poisson: 0.3,
        damping_time,
        region_field: Some("label".into()),
        ..Material::from_young(1e5)
    };
    let made = RegionMaterial {
        stiffness: young.unwrap_or(1e5),
        density: 1900.0,
        poisson: 0.3,
    };
    material.regions.insert(1, made);
    if young.is_none() {
        material.rigid.insert(1);
    }
    assert!(matches!(material.stiffness, Stiffness::Young(_)));
    DiscreteModel::new(&mesh, &material).unwrap()
}

fn body<T: Real>(network: &DiscreteModel, kind: SolverKind, newton: NewtonSettings) -> CpuBody<T> {
    let mut body = CpuBody::new(network, kind, CgSettings::default(), Some(2)).unwrap();
    body.set_newton(newton).unwrap();
    body
}

fn low_end(network: &DiscreteModel) -> Vec<bool> {
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

/// Returns the mass, the centre of mass, and the angular momentum about it.
fn moments(network: &DiscreteModel, x: &[DVec3], v: &[DVec3]) -> (f64, DVec3, DVec3) {
    let mass: f64 = network.masses.iter().sum();
    let all = || network.masses.iter().zip(x).zip(v);
    let centre = all().map(|((m, x), _)| *m * *x).sum::<DVec3>() / mass;
    let spin = all().map(|((m, x), v)| *m * (*x - centre).cross(*v)).sum();
    (mass, centre, spin)
}

/// Returns the rotation of a free rigid body with this angular momentum after a time, by the
/// Runge–Kutta method with many small steps.
fn rotor(network: &DiscreteModel, spin: DVec3, time: f64) -> DQuat {
    let (_, centre, _) = moments(network, &network.rest_positions, &network.rest_positions);
    let mut inertia = DMat3::ZERO;
    for (m, x) in network.masses.iter().zip(&network.rest_positions) {
        let r = *x - centre;
        inertia += (DMat3::from_diagonal(DVec3::splat(r.length_squared()))
            - DMat3::from_cols(r * r.x, r * r.y, r * r.z))
            * *m;
    }
    let inverse = inertia.inverse();
    let rate = |q: DQuat| {
        let w = q * (inverse * (q.inverse() * spin));
        DQuat::from_xyzw(w.x, w.y, w.z, 0.0) * q * 0.5
    };
    let steps = 4000;
    let h = time / f64::from(steps);
    let mut q = DQuat::IDENTITY;
    for _ in 0..steps {
        let a = rate(q);
        let b = rate(q + a * (0.5 * h));
        let c = rate(q + b * (0.5 * h));
        let d = rate(q + c * h);
        q = (q + (a + b * 2.0 + c * 2.0 + d) * (h / 6.0)).normalize();
    }
    q
}

#[test]
fn free_rigid_body_matches_closed_form_motion() {
    let network = bar([4, 3, 2], |_| true, None, 0.0);
    assert!(network.tets().is_empty() && network.rigid_bodies().len() == 1);
    let gravity = DVec3::new(1.0, -2.0, -9.81);
    let (_, centre, _) = moments(&network, &network.rest_positions, &network.rest_positions);
    let (start, whirl) = (DVec3::new(0.3, 0.1, 2.0), DVec3::new(3.0, 1.0, -0.5));
    let speeds: Vec<DVec3> = network
        .rest_positions
        .iter()
        .map(|x| start + whirl.cross(*x - centre))
        .collect();
    let (_, _, spin) = moments(&network, &network.rest_positions, &speeds);
    let time = 0.4;
    let truth = rotor(&network, spin, time);
    let rules = [
        (SolverKind::Implicit, 1.0),
        (SolverKind::Bdf2, 2.0),
        (SolverKind::Midpoint, 2.0),
    ];
    for (kind, order) in rules {
        let mut errors = Vec::new();
        for steps in [80u32, 160, 320] {
            let mut body = body::<f64>(&network, kind, EXACT);
            body.set_gravity(gravity);
            body.set_state(&network.rest_positions, &speeds).unwrap();
            let h = time / f64::from(steps);
            body.run(steps, h).unwrap();
            let (x, v) = (body.positions(), body.velocities());
            let (_, at, after) = moments(&network, &x, &v);
            // Error of the scheme in free fall: implicit Euler falls ½ g h t too far.
            let fall = 0.5 * gravity * time * time;
            let lag = at - centre - start * time - fall;
            if order == 1.0 {
                assert!((lag - 0.5 * gravity * h * time).length() < 1e-12, "{lag}");
            } else {
                assert!(lag.length() < 12.0 * h * h, "{lag}");
            }
            let turned: f64 = x
                .iter()
                .zip(&network.rest_positions)
                .map(|(x, r)| (*x - at).distance(truth * (*r - centre)))
                .fold(0.0, f64::max);
            errors.push((after.distance(spin) / spin.length(), turned));
        }
        println!("{kind}: {errors:?}");
        for pair in errors.windows(2) {
            let rates = [pair[0].0 / pair[1].0, pair[0].1 / pair[1].1].map(f64::log2);
            // The midpoint rule conserves angular momentum exactly.
            let kept = kind == SolverKind::Midpoint && pair[1].0 < 1e-11;
            let spin = kept || rates[0] > order - 0.25;
            assert!(spin && rates[1] > order - 0.25, "{kind} {rates:?}");
        }
    }
}

#[test]
fn rigid_regions_keep_shape_and_eliminate_interior_nodes() {
    let network = bar([12, 6, 6], |p| p.x > 0.5 && p.x < 0.92, None, 1e-3);
    let rigid = &network.rigid_bodies()[0];
    let mut body = body::<f32>(&network, SolverKind::Implicit, NewtonSettings::default());
    body.set_pinned(&low_end(&network)).unwrap();
    body.set_gravity(DVec3::new(0.0, 3.0, -9.81));
    // All nodes except interior ones, and four of the rigid body itself.
    let inside = rigid.nodes.len() - rigid.surface.len();
    assert!(inside > 50);
    assert_eq!(body.active(), network.rest_positions.len() - inside + 4);
    let some: Vec<usize> = rigid.nodes.iter().step_by(7).map(|v| *v as usize).collect();
    let (mut worst, mut moved) = (0.0f64, 0.0f64);
    // A few tets at the edge of the rigid region invert while it swings.
    body.set_inversion_allowed(true);
    for _ in 0..200 {
        body.run(1, 0.01).unwrap();
        let x = body.positions();
        for i in &some {
            moved = moved.max(x[*i].distance(network.rest_positions[*i]));
            for j in &some {
                let rest = network.rest_positions[*i].distance(network.rest_positions[*j]);
                worst = worst.max((x[*i].distance(x[*j]) - rest).abs());
            }
        }
    }
    println!("distances change by {worst:.1e} m, nodes move {moved} m");
    assert!(moved > 0.05 && worst < 1e-15 * 8.0, "{moved} {worst}");
}

/// Returns the positions after some steps of a bar pinned at one end, with a rigid region at the
/// other.
fn swung<T: Real>(network: &DiscreteModel, kind: SolverKind, newton: NewtonSettings) -> Vec<DVec3> {
    let mut body = body::<T>(network, kind, newton);
    body.set_pinned(&low_end(network)).unwrap();
    body.set_gravity(DVec3::new(0.0, 2.0, -9.81));
    body.run(12, 0.02).unwrap();
    body.positions()
}

fn apart(network: &DiscreteModel, a: &[DVec3], b: &[DVec3]) -> f64 {
    let square = |a: &[DVec3], b: &[DVec3]| -> f64 {
        a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum()
    };
    (square(a, b) / square(b, &network.rest_positions)).sqrt()
}

#[test]
fn rigid_region_is_limit_of_high_stiffness() {
    let bone = |p: DVec3| p.x > 0.5 && p.x < 0.9;
    for kind in [SolverKind::Implicit, SolverKind::Bdf2] {
        let rigid = bar([8, 2, 2], bone, None, 0.0);
        let truth = swung::<f64>(&rigid, kind, EXACT);
        let quick = swung::<f32>(&rigid, kind, NewtonSettings::default());
        let off = apart(&rigid, &quick, &truth);
        let errors = [1e1, 1e2, 1e3, 1e4].map(|contrast| {
            let stiff = bar([8, 2, 2], bone, Some(1e5 * contrast), 0.0);
            let x = swung::<f64>(&stiff, kind, EXACT);
            apart(&rigid, &x, &truth)
        });
        println!("{kind}: stiffness ratios 10 to 1e4 {errors:?}, f32 at defaults {off:.1e}");
        for pair in errors.windows(2) {
            assert!(pair[1] < 0.13 * pair[0], "{errors:?}");
        }
        assert!(errors[3] < 3e-4 && off < 3e-3, "{errors:?} {off}");
    }
}

#[test]
fn second_order_schemes_keep_order_with_rigid_regions() {
    // A bone on a soft stalk, spinning while it swings: each scheme against a solution with much
    // smaller steps.
    let bone = |p: DVec3| p.x > 0.5;
    let network = bar([4, 2, 2], bone, None, 0.0);
    let centre = DVec3::new(0.2, 0.0, 0.0);
    let speeds: Vec<DVec3> = network
        .rest_positions
        .iter()
        .map(|x| match x.x > 0.01 {
            true => DVec3::new(6.0, 1.0, 3.0).cross(*x - centre),
            false => DVec3::ZERO,
        })
        .collect();
    let end = |kind: SolverKind, steps: u32| {
        let mut body = body::<f64>(&network, kind, EXACT);
        body.set_pinned(&low_end(&network)).unwrap();
        body.set_gravity(DVec3::new(0.0, 2.0, -9.81));
        body.set_state(&network.rest_positions, &speeds).unwrap();
        body.run(steps, 0.05 / f64::from(steps)).unwrap();
        body.positions()
    };
    let truth = end(SolverKind::Bdf2, 1600);
    for kind in [SolverKind::Bdf2, SolverKind::Midpoint] {
        let errors = [25, 50, 100].map(|steps| apart(&network, &end(kind, steps), &truth));
        println!("{kind}: {errors:?}");
        for pair in errors.windows(2) {
            assert!((pair[0] / pair[1]).log2() > 1.7, "{kind} {errors:?}");
        }
    }
}

/// Long because one potential is built and compared in all directions.
#[test]
fn step_is_stationary_over_rigid_motions() {
    // The end of a step is a stationary point of Φ with respect to poses and soft nodes, by finite
    // differences.
    use super::pose::Pose;
    let bone = |p: DVec3| p.x > 0.4 && p.x < 0.8;
    let damping = 5e-3;
    let network = bar([5, 2, 2], bone, None, damping);
    let mut body = body::<f64>(&network, SolverKind::Implicit, EXACT);
    body.set_pinned(&low_end(&network)).unwrap();
    let gravity = DVec3::new(0.0, 4.0, -9.81);
    body.set_gravity(gravity);
    body.run(5, 0.01).unwrap();
    let h = 0.02;
    let (x, v) = (body.positions(), body.velocities());
    body.run(1, h).unwrap();
    let after = body.positions();
    let goal: Vec<DVec3> = x
        .iter()
        .zip(&v)
        .map(|(x, v)| *x + h * *v + h * h * gravity)
        .collect();
    let potential = |at: &[DVec3]| -> f64 {
        let inertia = network.masses.iter().zip(at).zip(&goal);
        let inertia: f64 = inertia
            .map(|((m, x), g)| 0.5 * m * x.distance_squared(*g) / (h * h))
            .sum();
        let elements = network.elements().unwrap();
        let energy =
            |e: &crate::physics::Element| e.energy(elements.law, &e.nodes.map(|v| at[v as usize]));
        // Damping is evaluated at the start of the step.
        let loss = |e: &crate::physics::Element| {
            let corners = e.nodes.map(|v| x[v as usize]);
            let blocks = e.projected_stiffness(elements.law, &corners);
            let w = e.nodes.map(|v| (at[v as usize] - x[v as usize]) / h);
            let pairs = (0..16).map(|k| w[k / 4].dot(blocks[k / 4][k % 4] * w[k % 4]));
            0.5 * h * damping * pairs.sum::<f64>()
        };
        let tets = || elements.tets.iter();
        inertia + tets().map(energy).sum::<f64>() + tets().map(loss).sum::<f64>()
    };
    let nodes = &network.rigid_bodies()[0].nodes;
    let centre = nodes.iter().map(|v| after[*v as usize]).sum::<DVec3>() / nodes.len() as f64;
    let slope = |by: f64, change: &dyn Fn(f64, &mut [DVec3])| {
        let at = |s: f64| {
            let mut y = after.clone();
            change(s, &mut y);
            potential(&y)
        };
        (at(by) - at(-by)) / (2.0 * by)
    };
    let pinned = low_end(&network);
    let mut worst = 0.0f64;
    for axis in DVec3::AXES {
        worst = worst.max(
            slope(1e-6, &|s, y| {
                nodes.iter().for_each(|v| y[*v as usize] += s * axis);
            })
            .abs(),
        );
        let turned = slope(1e-6, &|s, y| {
            let turn = DQuat::from_axis_angle(axis, s);
            for v in nodes {
                let v = *v as usize;
                y[v] = centre + turn * (y[v] - centre);
            }
        });
        worst = worst.max(turned.abs() / 0.2);
        for i in (0..after.len()).filter(|i| !pinned[*i] && !nodes.contains(&(*i as u32))) {
            worst = worst.max(slope(1e-6, &|s, y| y[i] += s * axis).abs());
        }
    }
    // Scale of the forces: the weight of the bone.
    let weight: f64 = nodes
        .iter()
        .map(|v| network.masses[*v as usize] * 9.81)
        .sum();
    println!("gradient of Φ up to {worst:.1e} N for a weight of {weight:.1} N");
    assert!(worst < 1e-5 * weight, "{worst} {weight}");
    // A single node of the bone would reduce Φ: its gradient is balanced by the rigidity
    // constraint.
    let i = *network.rigid_bodies()[0].nodes.first().unwrap() as usize;
    let alone = slope(1e-6, &|s, y| y[i] += s * DVec3::X).abs();
    assert!(alone > 1e-2 * weight, "{alone}");
    assert_eq!(Pose::from_array([0.5; 7]).to_array(), [0.5; 7]);
}

#[test]
fn resume_is_bitwise_identical() {
    for kind in [SolverKind::Bdf2, SolverKind::Midpoint] {
        state_of(kind);
    }
}

fn state_of(kind: SolverKind) {
    let network = bar([8, 4, 4], |p| p.x > 0.5 && p.x < 0.9, None, 1e-3);
    let make = || {
        let mut body = body::<f32>(&network, kind, NewtonSettings::default());
        body.set_pinned(&low_end(&network)).unwrap();
        body.set_gravity(DVec3::new(0.0, 3.0, -9.81));
        body
    };
    let mut body = make();
    body.run(23, 0.01).unwrap();
    let state = body.state();
    let mut other = make();
    other.resume(&state).unwrap();
    for _ in 0..20 {
        body.run(1, 0.01).unwrap();
        other.run(1, 0.01).unwrap();
        assert_eq!(body.state(), other.state());
    }
    if kind != SolverKind::Bdf2 {
        return;
    }
    // The displacements are restored bit by bit.
    let mut third = make();
    third.set_displacements(&body.displacements()).unwrap();
    assert_eq!(third.displacements(), body.displacements());
    assert_eq!(third.positions(), body.positions());
    // Setting and reading back a state preserves it.
    let (x, v) = (body.positions(), body.velocities());
    third.set_state(&x, &v).unwrap();
    let off = |a: &[DVec3], b: &[DVec3]| {
        let all = a.iter().zip(b).map(|(a, b)| a.distance(*b));
        all.fold(0.0, f64::max)
    };
    assert!(off(&third.positions(), &x) < 1e-7);
    assert!(off(&third.velocities(), &v) < 2e-3 * off(&v, &vec![DVec3::ZERO; v.len()]));
}

#[test]
fn rigid_regions_rotate_about_pins_and_follow_fixed_nodes() {
    let network = bar([6, 3, 3], |_| true, None, 0.0);
    let gravity = DVec3::new(0.0, 0.0, -9.81);
    let corner = |p: DVec3| {
        let at = |v: &usize| network.rest_positions[*v].distance(p - DVec3::new(0.4, 0.1, 0.1));
        (0..network.rest_positions.len())
            .min_by(|a, b| at(a).total_cmp(&at(b)))
            .unwrap()
    };
    let pins = |nodes: &[usize]| {
        let mut pinned = vec![false; network.rest_positions.len()];
        nodes.iter().for_each(|v| pinned[*v] = true);
        pinned
    };
    let [a, b, c] = [
        corner(DVec3::ZERO),
        corner(DVec3::new(0.0, 0.2, 0.0)),
        corner(DVec3::new(0.0, 0.0, 0.2)),
    ];
    let swing = |nodes: &[usize], gravity: DVec3| {
        let mut body = body::<f64>(&network, SolverKind::Bdf2, EXACT);
        body.set_pinned(&pins(nodes)).unwrap();
        body.set_gravity(gravity);
        body.run(60, 0.005).unwrap();
        let x = body.positions();
        for v in nodes {
            assert!(x[*v].distance(network.rest_positions[*v]) < 1e-13);
        }
        x
    };
    let far = corner(DVec3::new(0.8, 0.0, 0.0));
    assert_eq!(swing(&[a, b, c], gravity), network.rest_positions);
    // A physical pendulum about y, with the angle from θ'' = m g l cos(θ + θ₀) / I.
    let hinged = swing(&[a, b], gravity);
    let (mut inertia, mut first) = (0.0, DVec3::ZERO);
    for (m, x) in network.masses.iter().zip(&network.rest_positions) {
        let r = *x - network.rest_positions[a];
        inertia += m * (r.x * r.x + r.z * r.z);
        first += *m * r;
    }
    let (mut angle, mut rate, h) = (0.0f64, 0.0, 1e-5);
    for _ in 0..30_000 {
        let arm = first.x * angle.cos() + first.z * angle.sin();
        rate += h * 9.81 * arm / inertia;
        angle += h * rate;
    }
    let at = hinged[far] - network.rest_positions[a];
    let found = (-at.z).atan2(at.x);
    println!("pendulum at {found} rad after 0.3 s, expected {angle}");
    assert!((found - angle).abs() < 2e-3 && angle > 0.5);
    // A sideways force rotates it about a single pinned point, but not about a hinge.
    let aside = gravity + DVec3::new(0.0, 5.0, 0.0);
    let (ball, hinge) = (swing(&[a], aside), swing(&[a, b], aside));
    assert!((ball[far].y - network.rest_positions[far].y) > 0.05);
    assert!((hinge[far].y - network.rest_positions[far].y).abs() < 1e-12);
    // Fixed nodes move the bone with them: here by a quarter turn about z, and upwards.
    let mut body = body::<f32>(&network, SolverKind::Implicit, NewtonSettings::default());
    let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let place = |x: DVec3| turn * x + DVec3::Z;
    let holds = [a, b, c].map(|v| NodeConstraint::Fixed {
        node: v as u32,
        place: place(network.rest_positions[v]),
    });
    body.set_node_constraints(&holds).unwrap();
    body.run(2, 0.01).unwrap();
    for (x, r) in body.positions().iter().zip(&network.rest_positions) {
        assert!(x.distance(place(*r)) < 1e-7, "{x}");
    }
}

#[test]
fn forces_on_rigid_region_act_as_force_and_torque() {
    let network = bar([6, 4, 4], |_| true, None, 0.0);
    let inside = network.rigid_bodies()[0]
        .nodes
        .iter()
        .find(|v| !network.rigid_bodies()[0].surface.contains(v))
        .copied()
        .unwrap() as usize;
    let (mass, centre, _) = moments(&network, &network.rest_positions, &network.rest_positions);
    let force = DVec3::new(0.3, -1.0, 2.0) * mass;
    let h = 1e-4;
    let still = vec![DVec3::ZERO; network.rest_positions.len()];
    let of = |set: &dyn Fn(&mut CpuBody<f64>)| {
        let mut body = body::<f64>(&network, SolverKind::Implicit, EXACT);
        body.set_state(&network.rest_positions, &still).unwrap();
        set(&mut body);
        body.run(1, h).unwrap();
        let (x, v) = (body.positions(), body.velocities());
        let (_, _, spin) = moments(&network, &x, &v);
        let momentum: DVec3 = network.masses.iter().zip(&v).map(|(m, v)| *m * *v).sum();
        (momentum / h, spin / h)
    };
    for node in [inside, 0] {
        let torque = (network.rest_positions[node] - centre).cross(force);
        let mut forces = still.clone();
        forces[node] = force;
        let pushed = of(&|body| body.set_forces(&forces).unwrap());
        // A spring that pulls with its maximum force.
        let pull = NodeConstraint::Spring {
            node: node as u32,
            target: network.rest_positions[node] + force.normalize(),
            stiffness: 1e9,
            limit: force.length(),
        };
        let pulled = of(&|body| body.set_node_constraints(&[pull]).unwrap());
        for (f, t) in [pushed, pulled] {
            assert!(
                f.distance(force) < 1e-6 * force.length(),
                "{node} {f} {force}"
            );
            assert!(
                t.distance(torque) < 1e-4 * torque.length(),
                "{node} {t} {torque}"
            );
        }
    }
}

#[test]
fn high_stiffness_contrast_converges_without_rigid_regions() {
    let bone = |p: DVec3| p.x > 0.4 && p.x < 0.9;
    let rigid = bar([16, 4, 4], bone, None, 0.0);
    let still = rigid.clone();
    let stiff = bar([16, 4, 4], bone, Some(1e10), 0.0);
    let soft = bar([16, 4, 4], bone, Some(1e5), 0.0);
    let fine = NewtonSettings {
        iterations: 40,
        tolerance: 1e-6,
        linear_tolerance: 1e-3,
    };
    let iterations = |network: &DiscreteModel, newton: NewtonSettings| {
        let mut body = body::<f64>(network, SolverKind::Implicit, newton);
        body.set_pinned(&low_end(network)).unwrap();
        body.set_gravity(DVec3::new(0.0, 2.0, -9.81));
        let all = (0..20).map(|_| body.run(1, 0.01).unwrap().iterations);
        (all.sum::<u32>(), body.positions())
    };
    for (name, newton) in [("default", NewtonSettings::default()), ("to 1e-6", fine)] {
        let all = [&soft, &stiff, &rigid].map(|n| iterations(n, newton));
        let [soft, stiff, rigid] = all.each_ref().map(|a| a.0);
        let off = apart(&still, &all[1].1, &all[2].1);
        println!(
            "{name}: iterations of 20 steps: all soft {soft}, 1:100,000 {stiff}, rigid {rigid}; {off:.1e} apart"
        );
        assert!(
            stiff < 4 * soft && rigid < 2 * soft,
            "{soft} {stiff} {rigid}"
        );
        // With one Newton iteration, so stiff a bone rotates along chords, which slows it down.
        assert!(off < 5e-3 || newton == NewtonSettings::default(), "{off}");
    }
}

#[test]
fn rigid_region_rests_on_floor() {
    use crate::physics::cpu::node_terms::NodeTerms;
    use crate::physics::{Floor, NodeTerm};
    let network = bar([4, 3, 3], |_| true, None, 0.0);
    let rigid = &network.rigid_bodies()[0];
    assert!(rigid.surface.len() < rigid.nodes.len());
    let floor = Floor::new(DVec3::new(0.0, 0.0, -0.13), DVec3::Z, 200.0).unwrap();
    let floor = std::sync::Arc::new(floor);
    let mut body = body::<f32>(&network, SolverKind::Implicit, NewtonSettings::default());
    let term = NodeTerms::new(floor.clone(), &network, body.layout());
    body.add_term(Box::new(term));
    body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
    body.run(300, 0.01).unwrap();
    let x = body.positions();
    let held: f64 = rigid
        .surface
        .iter()
        .map(|v| floor.force(network.masses[*v as usize], x[*v as usize]).z)
        .sum();
    let weight: f64 = network.masses.iter().map(|m| m * 9.81).sum();
    println!("the floor supports {held} N of {weight} N");
    assert!((held / weight - 1.0).abs() < 1e-3);
}

#[test]
fn rejects_explicit_schemes_and_overlapping_rigid_bodies() {
    let network = bar([4, 2, 2], |p| p.x > 0.5, None, 0.0);
    for kind in [SolverKind::Verlet, SolverKind::Symplectic] {
        let made = CpuBody::<f32>::new(&network, kind, CgSettings::default(), None);
        let message = made.err().unwrap().to_string();
        assert!(
            message.contains("use implicit, bdf2 or midpoint"),
            "{message}"
        );
    }
    let mut strange = network.clone();
    let rigid = &mut strange.elements_mut().unwrap().rigid;
    rigid.push(rigid[0].clone());
    let made = CpuBody::<f32>::new(&strange, SolverKind::Implicit, CgSettings::default(), None);
    assert!(made.err().unwrap().to_string().contains("two rigid bodies"));
}
