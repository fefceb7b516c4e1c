//! Tests of contact between rigid regions.
#![allow(clippy::unwrap_used)]

use super::self_contact_tests::{Meeting, joined, soft};
use crate::generate::{Split, box_mesh};
use crate::mesh::{Field, Location, TetMesh};
use crate::physics::cpu::body::tests::some;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::{Material, RegionMaterial, SolverKind};
use glam::{DQuat, DVec3};

/// Returns a material in which the tets whose index and centroid `bone` accepts are rigid.
fn with_bones(mesh: &mut TetMesh, young: f64, bone: impl Fn(usize, DVec3) -> bool) -> Material {
    let labels = (0..mesh.tets.len()).map(|t| {
        let middle = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
        f64::from(u8::from(bone(t, middle)))
    });
    let labels = Field::scalar("label", Location::Cell, labels.collect());
    mesh.set_field(labels).unwrap();
    let mut material = Material {
        region_field: Some("label".into()),
        ..soft(young)
    };
    let made = RegionMaterial {
        stiffness: young,
        density: 1900.0,
        poisson: 0.3,
    };
    material.regions.insert(1, made);
    material.rigid.insert(1);
    material
}

#[test]
fn spinning_rigid_regions_have_no_tunnelling() {
    // Bars whose facing ends are rigid.
    let bar = box_mesh([6, 2, 2], DVec3::new(0.12, 0.03, 0.03), Split::Five).unwrap();
    let at = DVec3::new(0.07, 0.02, 0.04);
    let turn = DQuat::from_rotation_z(1.2);
    let mut mesh = joined(&[(&bar, DQuat::IDENTITY, DVec3::ZERO), (&bar, turn, at)]);
    let (tets, count) = (bar.tets.len(), bar.nodes.len());
    let material = with_bones(&mut mesh, 5e4, |t, x| match t < tets {
        true => x.x > 0.06,
        false => (turn.inverse() * (x - at)).x < 0.06,
    });
    for friction in [Some(0.3), None] {
        let mut meeting = Meeting::<f32>::new(&mesh, &material, friction);
        assert_eq!(meeting.through, 0);
        assert_eq!(meeting.network.rigid_bodies().len(), 2);
        let x = meeting.body.positions();
        let middle = |range: std::ops::Range<usize>| {
            let len = range.len() as f64;
            x[range].iter().sum::<DVec3>() / len
        };
        let middles = [middle(0..count), middle(count..x.len())];
        let spins = [DVec3::new(4.0, -20.0, 10.0), DVec3::new(-15.0, 5.0, 20.0)];
        let v: Vec<DVec3> = (0..x.len())
            .map(|i| {
                let k = usize::from(i >= count);
                let along = DVec3::Z * if k == 0 { 0.7 } else { -1.0 };
                along + spins[k].cross(x[i] - middles[k])
            })
            .collect();
        meeting.body.set_state(&x, &v).unwrap();
        let before = meeting.momentum();
        let mass: f64 = meeting.network.masses.iter().sum();
        let mut most = 0;
        for _ in 0..20 {
            meeting.body.run(1, 0.01).unwrap();
            most = most.max(meeting.pierced());
        }
        let off = meeting.momentum().distance(before) / mass;
        match friction {
            // Up to the convergence of the steps.
            Some(_) => assert!(most == 0 && off < 5e-3, "{most} {off}"),
            None => assert!(most > 0),
        }
    }
}

/// Throws two rapidly spinning rods at each other, by number, optionally with rigid regions.
/// Returns the maximum number of intersecting edges.
fn spun(number: u64, rigid: bool, kind: SolverKind) -> usize {
    let numbers = some(8, 900 + number, 1.0);
    let mut rod = box_mesh([8, 1, 1], DVec3::new(0.16, 0.02, 0.02), Split::Five).unwrap();
    for p in &mut rod.nodes {
        *p -= DVec3::new(0.08, 0.01, 0.01);
    }
    let turned = |k: usize| DQuat::from_scaled_axis(3.0 * numbers[k]);
    let apart = DVec3::new(0.0, 0.0, 0.19) + 0.02 * numbers[2];
    let (a, b) = (turned(0), turned(1));
    let mut mesh = joined(&[(&rod, a, DVec3::ZERO), (&rod, b, apart)]);
    let count = mesh.tets.len();
    let labels = (0..count).map(|t| if t < count / 2 { 1.0 } else { 2.0 });
    let labels = Field::scalar("label", Location::Cell, labels.collect());
    mesh.set_field(labels).unwrap();
    let mut material = Material {
        region_field: Some("label".into()),
        ..soft(5e4)
    };
    if rigid {
        // One of them, or both.
        material.rigid.extend(1..=1 + (number % 2) as i64);
    }
    let mut meeting = Meeting::<f32>::of(&mesh, &material, Some(0.2), kind);
    if meeting.through > 0 {
        return 0;
    }
    let spin = [60.0 * numbers[3].normalize(), 60.0 * numbers[4].normalize()];
    let x = meeting.body.positions();
    let half = x.len() / 2;
    let centre = |k: usize| x[k * half..(k + 1) * half].iter().sum::<DVec3>() / half as f64;
    let centres = [centre(0), centre(1)];
    let v: Vec<DVec3> = (0..x.len())
        .map(|i| {
            let k = i / half;
            let toward = [1.0, -1.0][k] * DVec3::Z * 3.0;
            toward + spin[k].cross(x[i] - centres[k])
        })
        .collect();
    meeting.body.set_state(&x, &v).unwrap();
    let mut most = 0;
    for _ in 0..10 {
        meeting.body.run(1, 0.01).unwrap();
        most = most.max(meeting.pierced());
    }
    most
}

#[test]
fn spinning_rods_have_no_tunnelling() {
    for (rigid, kind) in [
        (false, SolverKind::Implicit),
        (false, SolverKind::Bdf2),
        (true, SolverKind::Implicit),
    ] {
        let wrong: Vec<u64> = (0..12).filter(|n| spun(*n, rigid, kind) > 0).collect();
        assert!(wrong.is_empty(), "{rigid} {kind} {wrong:?}");
    }
}

#[test]
fn moved_rigid_region_indents_soft_block() {
    let block = box_mesh([4, 4, 3], DVec3::new(0.1, 0.1, 0.06), Split::Five).unwrap();
    let bone = box_mesh([2, 2, 1], DVec3::new(0.04, 0.04, 0.02), Split::Five).unwrap();
    let mut mesh = joined(&[
        (&block, DQuat::IDENTITY, DVec3::ZERO),
        (
            &bone,
            DQuat::from_rotation_z(0.3),
            DVec3::new(0.04, 0.03, 0.062),
        ),
    ]);
    let (tets, count) = (block.tets.len(), block.nodes.len() as u32);
    let material = with_bones(&mut mesh, 2e4, |t, _| t >= tets);
    let top: Vec<u32> = (count..mesh.nodes.len() as u32)
        .filter(|v| mesh.nodes[*v as usize].z > 0.081)
        .collect();
    let middle = mesh.nodes[count as usize..].iter().sum::<DVec3>() / bone.nodes.len() as f64;
    let far = |v: &u32| (mesh.nodes[*v as usize] - middle).truncate().length();
    let one = top.iter().copied().min_by(|a, b| far(a).total_cmp(&far(b)));
    let one = vec![one.unwrap()];
    // Two nodes on a line through the centre leave a rotation about it.
    let two = top.iter().copied().filter(|v| {
        let off = DQuat::from_rotation_z(-0.3) * (mesh.nodes[*v as usize] - middle);
        off.y.abs() < 1e-6 && off.x.abs() > 1e-3
    });
    let two: Vec<u32> = two.collect();
    assert_eq!(two.len(), 2);
    for held in [top.clone(), one, two] {
        let mut meeting = Meeting::<f32>::new(&mesh, &material, Some(0.2));
        let start = meeting.body.positions();
        let mut pinned: Vec<bool> = mesh.nodes.iter().map(|p| p.z < 1e-9).collect();
        pinned[count as usize..].fill(false);
        meeting.body.set_pinned(&pinned).unwrap();
        let (h, velocity) = (0.01, DVec3::new(0.0, 0.0, -0.1));
        let mut most = 0;
        let at = |node: u32, step: i32| start[node as usize] + f64::from(step) * h * velocity;
        for step in 0..16 {
            let prescribed: Vec<NodeConstraint> = held
                .iter()
                .map(|node| NodeConstraint::Fixed {
                    node: *node,
                    place: at(*node, step),
                })
                .collect();
            meeting.body.set_node_constraints(&prescribed).unwrap();
            meeting.body.run(1, h).unwrap();
            let through = meeting.pierced();
            most = most.max(through);
        }
        let x = meeting.body.positions();
        for node in &held {
            let off = x[*node as usize].distance(at(*node, 15));
            assert!(off < 1e-6, "{} nodes, {off}", held.len());
        }
        let deepest = x[..count as usize].iter().zip(&start);
        let dent = deepest.map(|(x, s)| s.z - x.z).fold(0.0, f64::max);
        assert!(dent > 0.009, "{} nodes: {dent}", held.len());
        assert_eq!(most, 0, "{} nodes", held.len());
    }
}
