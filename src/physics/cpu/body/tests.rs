//! Tests of the engine against the float64 `reference`.
#![allow(clippy::unwrap_used)]

use super::CpuBody;
use crate::generate;
use crate::physics::Floor;
use crate::physics::LocalUnits;
use crate::physics::cpu::aggregation::Aggregates;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::node_terms::NodeTerms;
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::runtime::energy_guard::StepFailure;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::springs::term::Springs;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::{self, V4};
use crate::physics::reference::integrators::ReferenceIntegrator;
use crate::physics::reference::springs::ReferenceSprings;
use crate::physics::{
    CgSettings, Damping, DiscreteModel, Edge, Material, SolverKind, largest_stable_step,
};
use glam::DVec3;
use std::sync::Arc;

/// Deterministic pseudorandom numbers in −1..1.
pub fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    }
}

/// Random vectors with components of magnitude up to `size`.
pub fn some(count: usize, seed: u64, size: f64) -> Vec<DVec3> {
    let mut next = noise(seed);
    (0..count)
        .map(|_| size * DVec3::new(next(), next(), next()))
        .collect()
}

/// A bar of about `tets` tetrahedra, in file units of `unit` metres.
fn bar(tets: usize, unit: f64, time: f64, constant: f64, kind: Damping) -> DiscreteModel {
    let mesh = generate::bar_of_about(tets, DVec3::new(0.3, 0.1, 0.1)).unwrap();
    let mut material = Material::from_young(3e4);
    material.damping_time = time;
    material.damping = constant;
    material.damping_kind = kind;
    material.length_unit = unit;
    DiscreteModel::new(&mesh, &material).unwrap()
}

const EXACT: CgSettings = CgSettings {
    tolerance: 1e-12,
    acceptable: 1e-6,
    max_iterations: 5000,
};

/// A body and its reference, deformed and moving, pinned at one end, with loads and target springs.
struct Pair<T: Real> {
    body: CpuBody<T>,
    twin: ReferenceSprings,
    pulls: Vec<(usize, DVec3, f64, f64)>,
    external: Vec<DVec3>,
    /// Initial sum of the squared velocities.
    speed: f64,
    integrator: Option<ReferenceIntegrator>,
}

impl<T: Real> Pair<T> {
    fn new(
        network: &DiscreteModel,
        kind: SolverKind,
        settings: CgSettings,
        chunks: usize,
    ) -> Pair<T> {
        let mut body = CpuBody::<T>::new(network, kind, settings, Some(chunks)).unwrap();
        let mut twin = ReferenceSprings::new(network.clone());
        let count = network.rest_positions.len();
        let size = network.frame.scale * network.length_unit;
        let low = network
            .rest_positions
            .iter()
            .map(|p| p.x)
            .fold(f64::MAX, f64::min);
        let pinned: Vec<bool> = network
            .rest_positions
            .iter()
            .map(|p| p.x < low + 1e-6 * size)
            .collect();
        for (t, p) in twin.pinned.iter_mut().zip(&pinned) {
            *t |= p;
        }
        let time = body.units.time;
        twin.x = network
            .rest_positions
            .iter()
            .zip(some(count, 7, 0.003 * size))
            .map(|(x, d)| *x + d)
            .collect();
        twin.v = some(count, 8, 0.002 * size / time);
        for i in 0..count {
            if twin.pinned[i] {
                twin.v[i] = DVec3::ZERO;
            }
        }
        let force = body.units.force();
        twin.gravity = DVec3::new(0.1, -0.2, -0.3) * 1e-3 * size / time / time;
        let external = some(count, 9, 1e-4 * force);
        twin.external = external.clone();
        body.set_pinned(&pinned).unwrap();
        body.set_gravity(twin.gravity);
        body.set_forces(&external).unwrap();
        body.set_state(&twin.x, &twin.v).unwrap();
        Pair {
            speed: twin.v.iter().map(|v| v.length_squared()).sum(),
            body,
            twin,
            pulls: Vec::new(),
            external,
            integrator: None,
        }
    }

    /// Displaces one constrained node and attaches two target springs, one of them at its force
    /// limit.
    fn attach(&mut self) {
        let count = self.twin.x.len();
        let size = self.twin.model.frame.scale * self.twin.model.length_unit;
        let stiffness = self.body.units.stiffness();
        let off = DVec3::new(0.002, -0.001, 0.003) * size;
        let hold = count - 1;
        let place = self.twin.x[hold] + off;
        let [a, b] = [count - 3, count / 2];
        let pulls = [(a, 0.3, 1.0), (b, 1.0, 1e-4)].map(|(v, k, limit)| {
            let target = self.twin.x[v] + 5.0 * off;
            (v, target, k * stiffness, limit * stiffness * size)
        });
        let mut all = vec![NodeConstraint::Fixed {
            node: hold as u32,
            place,
        }];
        all.extend(pulls.iter().map(|p| NodeConstraint::Spring {
            node: p.0 as u32,
            target: p.1,
            stiffness: p.2,
            limit: p.3,
        }));
        self.body.set_node_constraints(&all).unwrap();
        self.pulls = pulls.to_vec();
        self.twin.pinned[hold] = true;
        self.twin.x[hold] = place;
        self.twin.v[hold] = DVec3::ZERO;
    }

    /// Updates the target spring forces of the reference.
    fn draw(&mut self) {
        self.twin.external.copy_from_slice(&self.external);
        for (v, target, k, limit) in &self.pulls {
            let pull = *k * (*target - self.twin.x[*v]);
            self.twin.external[*v] += pull * (limit / pull.length()).min(1.0);
        }
    }

    fn step(&mut self, h: f64, tolerance: f64) {
        self.draw();
        let kind = self.body.kind();
        assert!(
            kind != SolverKind::VelocityVerlet || self.pulls.is_empty(),
            "the reference applies the springs at the old positions"
        );
        let integrator = self
            .integrator
            .get_or_insert(ReferenceIntegrator::new(kind, tolerance));
        integrator.step(&mut self.twin, h).unwrap();
        self.body.run(1, h).unwrap();
    }

    /// Returns the position error relative to the motion, and the relative velocity error.
    fn error(&self) -> [f64; 2] {
        let (x, v) = (self.body.positions(), self.body.velocities());
        let square = |a: &[DVec3], b: &[DVec3]| -> f64 {
            a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum()
        };
        let motion = square(&self.twin.x, &self.twin.model.rest_positions);
        [
            (square(&x, &self.twin.x) / motion).sqrt(),
            (square(&v, &self.twin.v) / self.speed).sqrt(),
        ]
    }
}

/// Returns a step that is stable for the scheme with all loads of the test body.
fn step_of(network: &DiscreteModel, kind: SolverKind) -> f64 {
    let free = vec![false; network.rest_positions.len()];
    let verlet = largest_stable_step(network, &free, SolverKind::Verlet).unwrap();
    match kind {
        SolverKind::Implicit => 10.0 * verlet,
        // Explicit Euler is unstable, but grows little in a hundred steps this short.
        SolverKind::Explicit => 0.02 * verlet,
        _ => 0.3 * verlet,
    }
}

fn compare<T: Real>(network: &DiscreteModel, attach: bool, limit: [f64; 2], tolerance: f64) {
    for kind in SolverKind::ALL {
        if attach && kind == SolverKind::VelocityVerlet {
            continue;
        }
        let h = step_of(network, kind);
        for chunks in [1, 3] {
            let settings = CgSettings { tolerance, ..EXACT };
            let mut pair = Pair::<T>::new(network, kind, settings, chunks);
            if attach {
                pair.attach();
            }
            for _ in 0..100 {
                pair.step(h, 1e-13);
            }
            let error = pair.error();
            println!(
                "{kind} in {} chunks, {} nodes, damped {} {:?}: {error:?}",
                pair.body.chunk_count(),
                network.rest_positions.len(),
                network.damping_time,
                network.springs(),
            );
            assert!(
                error[0] < limit[0] && error[1] < limit[1],
                "{kind}: {error:?}"
            );
        }
    }
}

#[test]
fn f64_step_matches_reference() {
    for (time, constant, kind) in [
        (0.0, 0.0, Damping::Axial),
        (1e-4, 1e-3, Damping::Axial),
        (1e-4, 1e-3, Damping::Relative),
    ] {
        let network = bar(600, 1.0, time, constant, kind);
        compare::<f64>(&network, false, [1e-9, 1e-8], 1e-12);
        compare::<f64>(&network, true, [1e-9, 1e-8], 1e-12);
    }
}

#[test]
fn f32_step_matches_reference() {
    for unit in [1.0, 1e-9, 1e3] {
        for (time, kind) in [(0.0, Damping::Axial), (1e-4, Damping::Relative)] {
            let network = bar(400, unit, time * unit, 0.0, kind);
            compare::<f32>(&network, false, [1e-5, 1e-4], 1e-7);
            compare::<f32>(&network, true, [1e-5, 1e-4], 1e-7);
        }
    }
}

/// Springs between random nodes, some with zero length, and some massless nodes.
pub fn any_network(seed: u64) -> DiscreteModel {
    let mut next = noise(seed);
    let mut network = bar(200, 1.0, 1e-5, 1e-3, Damping::Axial);
    let count = network.rest_positions.len();
    for _ in 0..3 * count {
        let mut pick = || (((next() + 1.0) * 0.5 * count as f64) as usize).min(count - 1);
        let (a, b) = (pick(), pick());
        if a != b {
            let kind = pick() % 4;
            let rest = network.rest_positions[a].distance(network.rest_positions[b]);
            network.edges.push(Edge {
                nodes: [a.min(b) as u32, a.max(b) as u32],
                stiffness: 100.0 * (1.1 + next()),
                length: [0.0, rest, 0.7 * rest, 1.4 * rest][kind],
            });
        }
    }
    for i in (0..count).step_by(17) {
        network.masses[i] = 0.0;
    }
    // Two coincident nodes, on a spring of zero length.
    network.rest_positions[4] = network.rest_positions[5];
    for edge in &mut network.edges {
        if edge.nodes == [4, 5] {
            edge.length = 0.0;
        }
    }
    network
}

#[test]
fn random_network_step_matches_reference() {
    for seed in 1..6 {
        compare::<f64>(&any_network(seed), false, [1e-8, 1e-7], 1e-12);
    }
}

#[test]
fn comparison_detects_perturbed_reference() {
    let network = bar(600, 1.0, 1e-4, 1e-3, Damping::Axial);
    let spoil: [fn(&mut ReferenceSprings); 4] = [
        |p| p.model.edges[100].stiffness *= 1.001,
        |p| p.model.springs_mut().unwrap().damping_kind = Damping::Relative,
        |p| p.gravity *= 1.001,
        |p| p.pinned[60] = !p.pinned[60],
    ];
    for (n, spoil) in spoil.iter().enumerate() {
        for kind in [SolverKind::Verlet, SolverKind::Implicit] {
            let mut pair = Pair::<f64>::new(&network, kind, EXACT, 2);
            spoil(&mut pair.twin);
            for _ in 0..100 {
                pair.step(step_of(&network, kind), 1e-13);
            }
            assert!(pair.error()[0] > 1e-8, "{n} {kind}: {:?}", pair.error());
        }
    }
}

/// Returns the springs of a network as a term, with its partition, node order and units.
fn term_of(
    network: &DiscreteModel,
    chunks: usize,
) -> (Springs<f64>, Partition, Vec<u32>, LocalUnits) {
    let lumps = Aggregates::new(&network.rest_positions, 24);
    let plan = Partition::with_chunks(lumps.group_starts, chunks);
    let units = LocalUnits::from_model(network);
    let with = (&lumps.order[..], units, &plan);
    let springs = Springs::new(network, network.springs().unwrap(), with);
    (springs, plan, lumps.order, units)
}

fn local(v: &[DVec3], order: &[u32], unit: f64) -> Vec<V4<f64>> {
    let places = order.iter();
    places
        .map(|i| vectors::from_metres(v[*i as usize], unit))
        .collect()
}

#[test]
fn system_matrix_matches_reference() {
    for (seed, kind) in [
        (1, Damping::Axial),
        (2, Damping::Relative),
        (3, Damping::Axial),
    ] {
        let mut network = any_network(seed);
        network.springs_mut().unwrap().damping_kind = kind;
        let count = network.rest_positions.len();
        let mut twin = ReferenceSprings::new(network.clone());
        twin.x = (0..count)
            .zip(some(count, 11, 0.01))
            .map(|(i, d)| network.rest_positions[i] + d)
            .collect();
        twin.v = some(count, 12, 0.1);
        // The masses belong to no term.
        twin.model.masses.fill(0.0);
        twin.pinned.fill(false);
        let (h, p) = (3e-3, some(count, 13, 1.0));
        let product = twin.system_product(h, &p);
        let change = twin.stiffness_product(&twin.v, true);
        let blocks = twin.system_blocks(h);
        for chunks in [1, 2, 5] {
            let (mut springs, plan, order, units) = term_of(&network, chunks);
            let moved: Vec<DVec3> = twin
                .x
                .iter()
                .zip(&network.rest_positions)
                .map(|(x, r)| *x - *r)
                .collect();
            let (u, v) = (
                local(&moved, &order, units.length),
                local(&twin.v, &order, units.velocity()),
            );
            let p = local(&p, &order, 1.0);
            let mut diagonal = vec![[0.0; 8]; count];
            let mut kv = vec![[0.0; 4]; count];
            let share = SystemContribution {
                diagonal: &mut diagonal,
                stiffness_velocity: &mut kv,
            };
            springs.linearise(&plan, StateRef { u: &u, v: &v }, h / units.time, share);
            let mut y = vec![[0.0; 4]; count];
            for c in 0..plan.chunks() {
                springs.multiply(c, &p, &mut y[plan.range(c)]);
            }
            // The visited blocks and the diagonal ones give the same product.
            let mut z: Vec<V4<f64>> = (0..count)
                .map(|k| vectors::apply_symmetric(&diagonal[k], p[k]))
                .collect();
            let vector = |a: V4<f64>| DVec3::new(a[0], a[1], a[2]);
            springs.visit_off_diagonal(&mut |[i, j], m| {
                let (i, j) = (i as usize, j as usize);
                for (to, d) in [(i, *m * vector(p[j])), (j, m.transpose() * vector(p[i]))] {
                    for (z, d) in z[to].iter_mut().zip(d.to_array()) {
                        *z += d;
                    }
                }
            });
            for (k, i) in order.iter().enumerate() {
                let i = *i as usize;
                let scale = blocks[i].x_axis.length()
                    + blocks[i].y_axis.length()
                    + blocks[i].z_axis.length();
                let (a, b) = (vector(y[k]) * units.mass, vector(z[k]) * units.mass);
                assert!(a.distance(product[i]) < 1e-11 * scale, "{a} {}", product[i]);
                assert!(b.distance(product[i]) < 1e-11 * scale, "{b} {}", product[i]);
                let c = vector(kv[k]) * units.stiffness() * units.velocity();
                assert!(
                    c.distance(change[i]) < 1e-11 * scale / h / h,
                    "{c} {}",
                    change[i]
                );
            }
        }
    }
}

#[test]
fn forces_equal_negative_energy_gradient() {
    let network = any_network(4);
    let (springs, plan, order, units) = term_of(&network, 3);
    let count = order.len();
    let mut u = local(&some(count, 21, 0.01), &order, units.length);
    let v = vec![[0.0; 4]; count];
    let floor = Floor::new(DVec3::ZERO, DVec3::new(0.1, 0.2, 1.0), 300.0).unwrap();
    let floor = NodeTerms::new(Arc::new(floor), &network, (&order, units, &plan));
    let terms: [&dyn Term<f64>; 2] = [&springs, &floor];
    for term in terms {
        let sum = |u: &[V4<f64>], f: &mut [V4<f64>]| -> f64 {
            f.fill([0.0; 4]);
            (0..plan.chunks())
                .map(|c| term.forces(c, StateRef { u, v: &v }, &mut f[plan.range(c)]))
                .sum()
        };
        let (mut f, mut other) = (vec![[0.0; 4]; count], vec![[0.0; 4]; count]);
        sum(&u, &mut f);
        let largest = f.iter().flatten().fold(0.0f64, |a, b| a.max(b.abs()));
        assert!(largest > 0.0);
        for i in (0..count).step_by(7) {
            for axis in 0..3 {
                let (x, d) = (u[i][axis], 1e-6);
                u[i][axis] = x + d;
                let above = sum(&u, &mut other);
                u[i][axis] = x - d;
                let below = sum(&u, &mut other);
                u[i][axis] = x;
                let slope = -(above - below) / (2.0 * d);
                assert!(
                    (slope - f[i][axis]).abs() < 1e-5 * largest,
                    "{slope} {}",
                    f[i][axis]
                );
            }
        }
    }
}

#[test]
fn unstable_step_is_rejected_and_leaves_body_unchanged() {
    let network = bar(600, 1.0, 0.0, 0.0, Damping::Axial);
    for kind in [
        SolverKind::Symplectic,
        SolverKind::Verlet,
        SolverKind::VelocityVerlet,
    ] {
        let mut pair = Pair::<f32>::new(&network, kind, EXACT, 2);
        let h = 4.0 * step_of(&network, kind) / 0.3;
        let mut before = pair.body.positions();
        let failure = loop {
            match pair.body.run(1, h) {
                Ok(_) => before = pair.body.positions(),
                Err(failure) => break failure,
            }
            assert!(pair.body.steps() < 200, "{kind}");
        };
        assert!(
            matches!(failure, StepFailure::RunawayEnergy { .. }),
            "{failure}"
        );
        assert_eq!(before, pair.body.positions());
        // A second attempt gives the same result.
        assert!(pair.body.run(1, h).is_err());
        assert_eq!(before, pair.body.positions());
        // A shorter step succeeds.
        let rest = network.rest_positions.clone();
        pair.body
            .set_state(&rest, &vec![DVec3::ZERO; rest.len()])
            .unwrap();
        pair.body.run(20, 0.02 * h).unwrap();
    }
}

#[test]
fn step_failure_reports_cause() {
    let network = bar(600, 1.0, 0.0, 0.0, Damping::Axial);
    let few = CgSettings {
        tolerance: 1e-6,
        acceptable: 1e-5,
        max_iterations: 2,
    };
    let mut pair = Pair::<f32>::new(&network, SolverKind::Implicit, few, 1);
    let before = pair.body.positions();
    let failure = pair.body.run(1, 0.01).unwrap_err();
    assert!(
        matches!(failure, StepFailure::NotConverged { iterations: 2, .. }),
        "{failure}"
    );
    assert_eq!(before, pair.body.positions());
    for h in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-80] {
        assert!(
            matches!(pair.body.run(1, h), Err(StepFailure::BadStep { .. })),
            "{h}"
        );
    }
    for kind in SolverKind::ALL {
        let mut pair = Pair::<f32>::new(&network, kind, EXACT, 1);
        let count = network.rest_positions.len();
        pair.body.run(1, 1e-6).unwrap();
        let before = pair.body.positions();
        let mut forces = vec![DVec3::ZERO; count];
        forces[count - 1].x = 1e200;
        pair.body.set_forces(&forces).unwrap();
        let failure = pair.body.run(1, 1e-6).unwrap_err();
        assert_eq!(failure, StepFailure::NonFinite, "{kind}");
        assert_eq!(before, pair.body.positions());
        pair.body.set_forces(&vec![DVec3::ZERO; count]).unwrap();
        pair.body.run(1, 1e-6).unwrap();
        assert!(pair.body.set_forces(&[DVec3::ZERO]).is_err());
        assert!(
            pair.body
                .set_state(&before, &vec![DVec3::NAN; count])
                .is_err()
        );
        let far = NodeConstraint::Fixed {
            node: count as u32,
            place: DVec3::ZERO,
        };
        assert!(pair.body.set_node_constraints(&[far]).is_err());
    }
    let none = CgSettings {
        tolerance: 0.0,
        ..EXACT
    };
    assert!(CpuBody::<f32>::new(&network, SolverKind::Implicit, none, None).is_err());
}

#[test]
fn resumed_run_is_bitwise_identical() {
    let network = bar(1500, 1.0, 1e-4, 0.0, Damping::Axial);
    for kind in SolverKind::ALL {
        for (first, chunks) in [(7, 1), (45, 3)] {
            let settings = CgSettings::default();
            let mut pair = Pair::<f32>::new(&network, kind, settings, chunks);
            let h = step_of(&network, kind);
            pair.attach();
            pair.body.run(first, h).unwrap();
            let state = pair.body.state();
            pair.body.run(40, h).unwrap();
            let mut other = Pair::<f32>::new(&network, kind, settings, chunks);
            other.attach();
            other.body.resume(&state).unwrap();
            other.body.run(40, h).unwrap();
            assert_eq!(pair.body.state(), other.body.state(), "{kind}");
            // An independent third run gives the same states.
            let mut third = Pair::<f32>::new(&network, kind, settings, chunks);
            third.attach();
            for _ in 0..first + 40 {
                third.body.run(1, h).unwrap();
            }
            assert_eq!(pair.body.state(), third.body.state(), "{kind}");
            let small = bar(600, 1.0, 0.0, 0.0, Damping::Axial);
            let mut small = CpuBody::<f32>::new(&small, kind, settings, None).unwrap();
            assert!(small.resume(&state).is_err());
        }
    }
}
