//! Tests of self-contact by finite differences, conservation of momentum and an exhaustive search
//! for intersections.
#![allow(clippy::unwrap_used)]

use crate::generate::{Split, ball, box_mesh};
use crate::mesh::intersect_edge_face;
use crate::mesh::{TetMesh, Topology};
use crate::physics::cpu::body::CpuBody;
use crate::physics::cpu::body::tests::some;
use crate::physics::cpu::implicit::contact_terms::{self_contact, self_contact_mut};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::{V4, from_metres, to_metres};
use crate::physics::{
    CgSettings, DiscreteModel, Material, MaterialModel, SelfContactSettings, Shape, SolverKind,
    Tool, ToolPose,
};
use glam::{DQuat, DVec3};

/// Bodies in one mesh, with or without self-contact.
pub(in crate::physics::cpu) struct Meeting<T: Real> {
    pub body: CpuBody<T>,
    pub network: DiscreteModel,
    pub faces: Vec<[u32; 3]>,
    pub through: usize,
}

pub(in crate::physics::cpu) fn soft(young: f64) -> Material {
    Material {
        model: MaterialModel::NeoHookean,
        poisson: 0.3,
        damping_time: 0.0,
        density: 1000.0,
        ..Material::from_young(young)
    }
}

/// Joins meshes into one, each rotated and translated.
pub(in crate::physics::cpu) fn joined(parts: &[(&TetMesh, DQuat, DVec3)]) -> TetMesh {
    let (mut nodes, mut tets) = (Vec::new(), Vec::new());
    for (mesh, turn, by) in parts {
        let first = nodes.len() as u32;
        nodes.extend(mesh.nodes.iter().map(|p| *turn * *p + *by));
        tets.extend(mesh.tets.iter().map(|tet| tet.map(|v| v + first)));
    }
    TetMesh::new(nodes, tets, Vec::new(), Vec::new()).unwrap()
}

fn boundary(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let topology = Topology::new(mesh);
    let faces = topology.boundary.iter();
    faces.map(|b| topology.boundary_nodes(mesh, *b)).collect()
}

impl<T: Real> Meeting<T> {
    pub fn new(mesh: &TetMesh, material: &Material, friction: Option<f64>) -> Meeting<T> {
        Meeting::of(mesh, material, friction, SolverKind::Implicit)
    }

    pub fn of(
        mesh: &TetMesh,
        material: &Material,
        friction: Option<f64>,
        kind: SolverKind,
    ) -> Meeting<T> {
        let network = DiscreteModel::new(mesh, material).unwrap();
        let settings = CgSettings::default();
        let mut body = CpuBody::new(&network, kind, settings, Some(2)).unwrap();
        let faces = boundary(mesh);
        let wanted = |friction| SelfContactSettings {
            friction,
            gap: None,
        };
        let through = friction.map_or(0, |friction| {
            body.set_self_contact(&wanted(friction), &faces, &network)
        });
        Meeting {
            body,
            network,
            faces,
            through,
        }
    }

    /// Returns the number of boundary edges that intersect boundary faces, by an exhaustive search.
    pub fn pierced(&self) -> usize {
        let x = self.body.positions();
        let mut edges: Vec<[u32; 2]> = self
            .faces
            .iter()
            .flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]])
            .map(|[i, j]| [*i.min(j), *i.max(j)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let boxed = |nodes: &[u32]| {
            let at = nodes.iter().map(|v| x[*v as usize]);
            let low = at.clone().fold(DVec3::INFINITY, DVec3::min);
            (low, at.fold(DVec3::NEG_INFINITY, DVec3::max))
        };
        let faces: Vec<_> = self.faces.iter().map(|f| (f, boxed(f))).collect();
        let through = |edge: &&[u32; 2]| {
            let (low, high) = boxed(*edge);
            faces.iter().any(|(face, (from, to))| {
                low.cmple(*to).all()
                    && from.cmple(high).all()
                    && edge.iter().all(|v| !face.contains(v))
                    && intersect_edge_face(edge.map(|v| x[v as usize]), face.map(|v| x[v as usize]))
                        .is_some()
            })
        };
        edges.iter().filter(through).count()
    }

    pub fn momentum(&self) -> DVec3 {
        let v = self.body.velocities();
        let masses = self.network.masses.iter();
        masses.zip(v).map(|(m, v)| *m * v).sum()
    }
}

/// Long because every function of the term is compared on one state.
#[test]
fn self_contact_forces_equal_negative_energy_gradient() {
    // Two slightly tilted blocks, so close that primitives of all kinds are in contact.
    let block = box_mesh([2, 2, 1], DVec3::new(0.1, 0.1, 0.04), Split::Five).unwrap();
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.02, 0.01, 0.4);
    let mesh = joined(&[
        (&block, DQuat::IDENTITY, DVec3::ZERO),
        (&block, turn, DVec3::new(0.02, 0.01, 0.0425)),
    ]);
    let network = DiscreteModel::new(&mesh, &soft(1e4)).unwrap();
    let settings = CgSettings::default();
    let mut body = CpuBody::<f64>::new(&network, SolverKind::Implicit, settings, Some(2)).unwrap();
    let wanted = SelfContactSettings {
        friction: 0.0,
        gap: Some(0.02),
    };
    assert_eq!(
        body.set_self_contact(&wanted, &boundary(&mesh), &network),
        0
    );
    body.run(1, 1e-9).unwrap();
    let plan = body.plan.clone();
    let nodes = body.state.u.len();
    // Displaced from rest, because pairs that are close at rest have a reduced gap.
    let mut u: Vec<V4<f64>> = body.state.u.clone();
    let noise = some(nodes, 7, 2e-3);
    u.iter_mut().zip(&noise).for_each(|(u, by)| {
        *u = from_metres(to_metres(*u, 1.0) + *by, 1.0);
    });
    for v in block.nodes.len()..mesh.nodes.len() {
        u[body.engine_index[v] as usize][2] -= 1.6e-3 / body.units.length;
    }
    let term = self_contact_mut(&mut body.terms).unwrap();
    let free = vec![1.0; nodes];
    let rigid = Default::default();
    assert!(term.begin((&u, &free, &plan), &rigid, &|_| DVec3::ZERO));
    assert!(term.min_gap_ratio(&u) < 0.8, "{}", term.min_gap_ratio(&u));
    let energy = |u: &[V4<f64>]| -> f64 { (0..plan.chunks()).map(|c| term.energy(c, u)).sum() };
    let mut forces = vec![[0.0; 4]; nodes];
    let mut shares = 0.0;
    for chunk in 0..plan.chunks() {
        let range = plan.range(chunk);
        shares += term.elastic_forces(chunk, &u, &mut forces[range]);
    }
    assert!((shares / energy(&u) - 1.0).abs() < 1e-12 && shares > 0.0);
    let sum: DVec3 = forces.iter().map(|f| to_metres(*f, 1.0)).sum();
    let largest = forces.iter().map(|f| to_metres(*f, 1.0).length());
    let largest = largest.fold(0.0, f64::max);
    assert!(sum.length() < 1e-9 * largest);
    let (mut off, mut wrong) = (0.0f64, 0.0f64);
    for i in 0..nodes {
        for k in 0..3 {
            let e = 1e-7;
            let mut moved = u.clone();
            moved[i][k] += e;
            let high = energy(&moved);
            moved[i][k] -= 2.0 * e;
            let slope = (high - energy(&moved)) / (2.0 * e);
            off = off.max((slope + forces[i][k]).abs());
            // Sensitivity check: a force without the mollifier or with other weights is detected.
            wrong = wrong.max((slope + 0.9 * forces[i][k]).abs());
        }
    }
    assert!(off < 2e-4 * largest, "{off} of {largest}");
    assert!(wrong > 0.05 * largest);
    // The matrix product equals the product of the visited blocks and the diagonal.
    let at = StateRef {
        u: &u,
        v: &vec![[0.0; 4]; nodes],
    };
    let mut diagonal = vec![[0.0; 8]; nodes];
    let mut change = vec![[0.0; 4]; nodes];
    let share = SystemContribution {
        diagonal: &mut diagonal,
        stiffness_velocity: &mut change,
    };
    let term = self_contact_mut(&mut body.terms).unwrap();
    term.linearise(&plan, at, 1.0, share);
    let p: Vec<V4<f64>> = some(nodes, 9, 1.0)
        .iter()
        .map(|p| from_metres(*p, 1.0))
        .collect();
    let mut product = vec![[0.0; 4]; nodes];
    for chunk in 0..plan.chunks() {
        term.multiply(chunk, &p, &mut product[plan.range(chunk)]);
    }
    let mut assembled: Vec<DVec3> = diagonal
        .iter()
        .zip(&p)
        .map(|(d, p)| to_metres(crate::physics::cpu::vectors::apply_symmetric(d, *p), 1.0))
        .collect();
    term.visit_off_diagonal(&mut |[i, j], m| {
        let (i, j) = (i as usize, j as usize);
        assembled[i] += *m * to_metres(p[j], 1.0);
        assembled[j] += m.transpose() * to_metres(p[i], 1.0);
    });
    let largest = assembled.iter().map(|f| f.length()).fold(0.0, f64::max);
    for (a, b) in assembled.iter().zip(&product) {
        assert!(a.distance(to_metres(*b, 1.0)) < 1e-9 * largest);
    }
}

#[test]
fn colliding_elastic_balls_bounce_and_conserve_momentum() {
    let one = ball(0.05, 6).unwrap();
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 0.7, 0.2);
    let at = DVec3::new(0.104, 0.01, 0.0);
    let mesh = joined(&[(&one, DQuat::IDENTITY, DVec3::ZERO), (&one, turn, at)]);
    let mut meeting = Meeting::<f64>::new(&mesh, &soft(5e4), Some(0.0));
    let count = one.nodes.len();
    let speeds = [DVec3::X, DVec3::new(-0.5, 0.0, 0.0)];
    let v: Vec<DVec3> = (0..mesh.nodes.len()).map(|i| speeds[i / count]).collect();
    let x = meeting.body.positions();
    meeting.body.set_state(&x, &v).unwrap();
    let before = meeting.momentum();
    let mass: f64 = meeting.network.masses.iter().sum();
    let mut touched = false;
    for _ in 0..60 {
        meeting.body.run(1, 1e-3).unwrap();
        assert_eq!(meeting.pierced(), 0);
        let own = self_contact(&meeting.body.terms).unwrap();
        touched |= own.min_gap_ratio(&meeting.body.state.u) < 1.0;
        let off = meeting.momentum().distance(before);
        assert!(off < 1e-4 * mass, "{}", off / mass);
    }
    assert!(touched);
    // They separate: the first is now slower than the second.
    let v = meeting.body.velocities();
    let mean = |k: usize| {
        let own = v[k * count..(k + 1) * count]
            .iter()
            .zip(&meeting.network.masses);
        let sum: DVec3 = own.map(|(v, m)| *m * *v).sum();
        sum.x / (0.5 * mass)
    };
    assert!(mean(1) > mean(0) + 0.3, "{} {}", mean(0), mean(1));
}

/// Throws two small bodies at each other, by number. Returns the maximum number of intersecting
/// edges after a step.
fn dropped(number: u64, friction: Option<f64>) -> usize {
    let numbers = some(12, 100 + number, 1.0);
    let turned = |k: usize| DQuat::from_scaled_axis(3.0 * numbers[k]);
    let shape = |k: usize| match numbers[k].x > 0.0 {
        true => box_mesh([2, 1, 1], DVec3::new(0.06, 0.03, 0.02), Split::Five).unwrap(),
        false => box_mesh([1, 1, 1], DVec3::new(0.03, 0.05, 0.04), Split::Six).unwrap(),
    };
    let (a, b) = (shape(0), shape(1));
    let apart = 0.15 * numbers[2].normalize_or(DVec3::X) + 0.01 * numbers[3];
    let mesh = joined(&[(&a, turned(4), DVec3::ZERO), (&b, turned(5), apart)]);
    let mut meeting = Meeting::<f32>::new(&mesh, &soft(2e4), friction);
    assert_eq!(meeting.through, 0);
    let meet = -3.0 * apart.normalize() + numbers[6];
    let (spin, other) = (20.0 * numbers[7], 20.0 * numbers[8]);
    let x = &mesh.nodes;
    let v: Vec<DVec3> = (0..x.len())
        .map(|i| match i < a.nodes.len() {
            true => spin.cross(x[i]),
            false => meet + other.cross(x[i] - apart),
        })
        .collect();
    let x = meeting.body.positions();
    meeting.body.set_state(&x, &v).unwrap();
    let mut most = 0;
    for _ in 0..10 {
        meeting.body.run(1, 0.01).unwrap();
        most = most.max(meeting.pierced());
    }
    most
}

#[test]
fn dropped_blocks_never_interpenetrate() {
    for number in 0..30 {
        assert_eq!(dropped(number, Some(0.3)), 0, "drop {number}");
    }
    // Without contact they interpenetrate.
    assert!((0..30).any(|number| dropped(number, None) > 0));
}

#[test]
#[ignore = "long: a thousand drops"]
fn thousand_dropped_blocks_never_interpenetrate() {
    let wrong: Vec<u64> = (0..1000).filter(|n| dropped(*n, Some(0.3)) > 0).collect();
    assert!(wrong.is_empty(), "{wrong:?}");
}

/// Returns a plane tool at `at` with the normal `along`.
pub(in crate::physics::cpu) fn plane(at: DVec3, along: DVec3, friction: f64) -> Tool {
    Tool {
        shape: Shape::Plane,
        pose: ToolPose::new(at, DQuat::from_rotation_arc(DVec3::Z, along)),
        friction,
        gap: None,
    }
}

#[test]
fn stacked_blocks_come_to_rest() {
    let block = box_mesh([3, 3, 2], DVec3::new(0.1, 0.1, 0.06), Split::Five).unwrap();
    let turned = |angle: f64| DQuat::from_rotation_z(angle);
    let mesh = joined(&[
        (&block, turned(0.0), DVec3::new(0.0, 0.0, 0.0005)),
        (&block, turned(0.2), DVec3::new(0.01, 0.0, 0.0625)),
        (&block, turned(-0.1), DVec3::new(0.0, 0.01, 0.1245)),
    ]);
    let mut meeting = Meeting::<f32>::new(&mesh, &soft(1e5), Some(0.5));
    let floor = plane(DVec3::ZERO, DVec3::Z, 0.5);
    meeting
        .body
        .add_tool(&floor, &meeting.faces, &meeting.network);
    meeting.body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
    meeting.body.run(40, 0.02).unwrap();
    let settled = meeting.body.positions();
    meeting.body.run(60, 0.02).unwrap();
    assert_eq!(meeting.pierced(), 0);
    let moved = settled.iter().zip(meeting.body.positions());
    let most = moved.map(|(a, b)| a.distance(b)).fold(0.0, f64::max);
    assert!(most < 1e-3, "{most}");
    // The top block stays on two blocks.
    let count = block.nodes.len();
    let low = settled[2 * count..]
        .iter()
        .map(|p| p.z)
        .fold(f64::INFINITY, f64::min);
    let floor = settled[..count]
        .iter()
        .map(|p| p.z)
        .fold(f64::INFINITY, f64::min);
    assert!((0.115..0.126).contains(&(low - floor)), "{}", low - floor);
}

#[test]
fn closed_fold_has_no_self_intersection() {
    // An arch of half a turn, with its legs pressed together by two plates.
    let mut mesh = box_mesh([16, 3, 2], DVec3::new(1.0, 0.04, 0.02), Split::Five).unwrap();
    for p in &mut mesh.nodes {
        let (around, out) = (std::f64::consts::PI * (p.x - 0.5), 0.03 + p.z);
        // Two straight legs at the ends.
        let (angle, leg) = (around.clamp(-1.6, 1.6), (around.abs() - 1.6).max(0.0));
        let side = DVec3::new(angle.sin(), 0.0, angle.cos());
        let along = DVec3::new(angle.cos(), 0.0, -angle.sin()) * angle.signum();
        *p = out * side + 0.03 * leg * along + DVec3::Y * p.y;
    }
    let mut meeting = Meeting::<f32>::new(&mesh, &soft(2e4), Some(0.2));
    for side in [-1.0, 1.0] {
        let tool = plane(DVec3::new(0.052 * side, 0.0, 0.0), -side * DVec3::X, 0.0);
        meeting
            .body
            .add_tool(&tool, &meeting.faces, &meeting.network);
    }
    let metres = meeting.network.to_metres(DVec3::ZERO);
    let mut nearest = f64::INFINITY;
    for step in 1..=12 {
        let away = 0.052 - 0.0025 * f64::from(step);
        let guided: Vec<_> = [-1.0, 1.0]
            .iter()
            .map(|side| {
                let turn = DQuat::from_rotation_arc(DVec3::Z, -*side * DVec3::X);
                (ToolPose::new(metres + DVec3::X * away * *side, turn), 0)
            })
            .collect();
        meeting.body.set_tool_targets(&guided).unwrap();
        meeting.body.run(1, 0.05).unwrap();
        assert_eq!(meeting.pierced(), 0, "step {step}");
        let own = self_contact(&meeting.body.terms).unwrap();
        nearest = nearest.min(own.min_gap_ratio(&meeting.body.state.u));
    }
    assert!(nearest < 1.0, "{nearest}");
}

#[test]
fn initially_intersecting_parts_are_reported() {
    let one = ball(0.05, 5).unwrap();
    let at = |x: f64| DVec3::new(x, 0.003, 0.002);
    let mesh = |x: f64| {
        joined(&[
            (&one, DQuat::IDENTITY, DVec3::ZERO),
            (&one, DQuat::from_rotation_z(0.5), at(x)),
        ])
    };
    let apart = Meeting::<f64>::new(&mesh(0.11), &soft(1e4), Some(0.0));
    assert_eq!(apart.through, 0);
    let within = Meeting::<f64>::new(&mesh(0.09), &soft(1e4), Some(0.0));
    assert!(within.through > 0 && within.pierced() > 0);
}

#[test]
fn enclosed_part_is_reported_and_extracted() {
    let (large, small) = (ball(0.05, 5).unwrap(), ball(0.012, 3).unwrap());
    let at = DVec3::new(0.021, 0.004, -0.003);
    let mesh = joined(&[
        (&large, DQuat::IDENTITY, DVec3::ZERO),
        (&small, DQuat::from_rotation_z(0.5), at),
    ]);
    let mut meeting = Meeting::<f64>::new(&mesh, &soft(1e4), Some(0.0));
    // The small block stays inside at first, where it is crushed.
    meeting.body.set_inversion_allowed(true);
    assert_eq!(meeting.pierced(), 0);
    let own = large.nodes.len();
    let of_small = meeting
        .faces
        .iter()
        .filter(|face| face[0] as usize >= own)
        .count();
    assert_eq!(meeting.through, of_small);
    let mean = |x: &[DVec3]| x.iter().sum::<DVec3>() / x.len() as f64;
    let mut through = 0;
    for _ in 0..400 {
        meeting.body.run(1, 5e-3).unwrap();
        through += usize::from(meeting.pierced() > 0);
    }
    // It passed through the boundary and left.
    assert!(through > 0);
    assert_eq!(meeting.pierced(), 0);
    let x = meeting.body.positions();
    let apart = mean(&x[..own]).distance(mean(&x[own..]));
    assert!(apart > 0.055, "{apart}");
    // The cavity of a shell is not part of its interior: nothing is enclosed there.
    let shell = TetMesh::new(
        large.nodes.clone(),
        large
            .tets
            .iter()
            .filter(|tet| {
                let corners = tet.iter().map(|v| large.nodes[*v as usize]);
                corners.sum::<DVec3>().length() / 4.0 > 0.03
            })
            .copied()
            .collect(),
        Vec::new(),
        Vec::new(),
    )
    .unwrap();
    let tiny = ball(0.006, 2).unwrap();
    let mesh = joined(&[
        (&shell, DQuat::IDENTITY, DVec3::ZERO),
        (&tiny, DQuat::IDENTITY, DVec3::ZERO),
    ]);
    let hollow = Meeting::<f64>::new(&mesh, &soft(1e4), Some(0.0));
    assert_eq!(hollow.through, 0);
}
