//! Tests of cases that are hard for continuous collision detection: bodies that move together and
//! are stopped separately, and prescribed nodes.
#![allow(clippy::unwrap_used)]

use super::self_contact_tests::{Meeting, joined, plane, soft};
use crate::generate::{Split, ball, box_mesh};
use crate::mesh::TetMesh;
use crate::physics::SolverKind;
use crate::physics::cpu::node_constraints::NodeConstraint;
use glam::{DQuat, DVec3};

#[test]
fn block_following_another_into_wall_has_no_tunnelling() {
    let block = box_mesh([2, 2, 2], DVec3::new(0.05, 0.05, 0.03), Split::Five).unwrap();
    let mesh = joined(&[
        (&block, DQuat::IDENTITY, DVec3::new(0.0, 0.0, 0.005)),
        (
            &block,
            DQuat::from_rotation_z(0.3),
            DVec3::new(0.005, 0.0, 0.065),
        ),
    ]);
    for friction in [Some(0.3), None] {
        let mut meeting = Meeting::<f32>::new(&mesh, &soft(5e4), friction);
        let wall = plane(DVec3::ZERO, DVec3::Z, 0.0);
        meeting
            .body
            .add_tool(&wall, &meeting.faces, &meeting.network);
        let x = meeting.body.positions();
        let v = vec![DVec3::new(0.0, 0.0, -5.0); x.len()];
        meeting.body.set_state(&x, &v).unwrap();
        let mut most = 0;
        for _ in 0..10 {
            meeting.body.run(1, 0.02).unwrap();
            most = most.max(meeting.pierced());
        }
        match friction {
            Some(_) => assert_eq!(most, 0),
            None => assert!(most > 0),
        }
    }
}

/// A block of 10 × 10 × 6 cm.
fn block() -> TetMesh {
    box_mesh([3, 3, 2], DVec3::new(0.1, 0.1, 0.06), Split::Five).unwrap()
}

/// Returns two blocks, one above the other, with this clearance.
fn pair(apart: f64) -> TetMesh {
    joined(&[
        (&block(), DQuat::IDENTITY, DVec3::ZERO),
        (
            &block(),
            DQuat::from_rotation_z(0.3),
            DVec3::new(0.01, 0.0, 0.06 + apart),
        ),
    ])
}

#[test]
fn block_behind_stopped_block_has_no_tunnelling() {
    // Both fall onto a plane, by half a block's height or more per step.
    for (kind, speed, young) in [
        (SolverKind::Implicit, 3.0, 1e6),
        (SolverKind::Implicit, 8.0, 1e5),
        (SolverKind::Bdf2, 3.0, 1e6),
    ] {
        let mesh = pair(0.012);
        let mut meeting = Meeting::<f32>::of(&mesh, &soft(young), Some(0.2), kind);
        let floor = plane(DVec3::new(0.0, 0.0, -0.01), DVec3::Z, 0.2);
        meeting
            .body
            .add_tool(&floor, &meeting.faces, &meeting.network);
        let x = meeting.body.positions();
        let v = vec![DVec3::new(0.0, 0.0, -speed); x.len()];
        meeting.body.set_state(&x, &v).unwrap();
        for step in 0..10 {
            meeting.body.run(1, 0.01).unwrap();
            assert_eq!(meeting.pierced(), 0, "{kind} {speed} {young} {step}");
        }
    }
}

#[test]
fn prescribed_motion_pushes_obstacle() {
    // Prescribed motion moves the top of the upper block into the lower one, by more than half a
    // gap per step.
    let block = box_mesh([2, 2, 2], DVec3::new(0.05, 0.05, 0.03), Split::Five).unwrap();
    let turn = DQuat::from_rotation_z(0.3);
    let mesh = joined(&[
        (&block, DQuat::IDENTITY, DVec3::ZERO),
        (&block, turn, DVec3::new(0.01, 0.0, 0.05)),
    ]);
    let (count, h) = (block.nodes.len(), 0.02);
    // Also with the whole block prescribed, and with fixed nodes that are moved before each step.
    for (friction, above, held) in [
        (Some(0.2), 0.0799, false),
        (Some(0.2), 0.0, false),
        (Some(0.2), 0.0799, true),
        (None, 0.0799, false),
    ] {
        let top: Vec<u32> = (count as u32..mesh.nodes.len() as u32)
            .filter(|v| mesh.nodes[*v as usize].z > above)
            .collect();
        let mut meeting = Meeting::<f64>::new(&mesh, &soft(2e4), friction);
        let start = meeting.body.positions();
        let velocity = DVec3::new(0.0, 0.0, -0.6);
        let mut most = 0;
        for step in 0..10 {
            let prescribed: Vec<NodeConstraint> = top
                .iter()
                .map(|v| {
                    let at = |step| start[*v as usize] + f64::from(step) * h * velocity;
                    match held {
                        true => NodeConstraint::Fixed {
                            node: *v,
                            place: at(step + 1),
                        },
                        false => NodeConstraint::Prescribed {
                            node: *v,
                            place: at(step),
                            velocity,
                        },
                    }
                })
                .collect();
            meeting.body.set_node_constraints(&prescribed).unwrap();
            meeting.body.run(1, h).unwrap();
            most = most.max(meeting.pierced());
        }
        let x = meeting.body.positions();
        let end = start[top[0] as usize] + 10.0 * h * velocity;
        assert!(x[top[0] as usize].distance(end) < 1e-9);
        match friction {
            Some(_) => assert_eq!(most, 0),
            None => assert!(most > 0),
        }
    }
}

#[test]
fn prescribed_motion_against_fixed_block_reports_blocked_contact() {
    let block = box_mesh([2, 2, 1], DVec3::new(0.05, 0.05, 0.02), Split::Five).unwrap();
    let turn = DQuat::from_rotation_z(0.3);
    let mesh = joined(&[
        (&block, DQuat::IDENTITY, DVec3::ZERO),
        (&block, turn, DVec3::new(0.01, 0.0, 0.03)),
    ]);
    let mut meeting = Meeting::<f64>::new(&mesh, &soft(2e4), Some(0.0));
    let all = 0..mesh.nodes.len() as u32;
    let start = meeting.body.positions();
    let down = DVec3::new(0.0, 0.0, -2.0);
    let prescribed: Vec<NodeConstraint> = all
        .map(|node| NodeConstraint::Prescribed {
            node,
            place: start[node as usize],
            velocity: match mesh.nodes[node as usize].z {
                z if z > 0.0499 => down,
                _ => DVec3::ZERO,
            },
        })
        .filter(|a| matches!(a, NodeConstraint::Prescribed { node, velocity, .. } if *velocity != DVec3::ZERO || mesh.nodes[*node as usize].z < 0.021))
        .collect();
    meeting.body.set_node_constraints(&prescribed).unwrap();
    let refused = meeting.body.run(1, 0.02).unwrap_err();
    assert!(refused.to_string().contains("pressed so hard"), "{refused}");
    assert_eq!(meeting.pierced(), 0);
}

#[test]
fn bodies_accelerated_from_rest_have_no_tunnelling() {
    // At rest and far apart, pulled together far enough to pass through within one step; the plate
    // is too wide to pass around.
    let plate = box_mesh([6, 6, 1], DVec3::new(0.3, 0.3, 0.03), Split::Five).unwrap();
    let block = box_mesh([2, 2, 2], DVec3::new(0.05, 0.05, 0.03), Split::Five).unwrap();
    let turn = DQuat::from_rotation_z(0.3);
    let mesh = joined(&[
        (&plate, DQuat::IDENTITY, DVec3::ZERO),
        (&block, turn, DVec3::new(0.11, 0.1, 0.05)),
    ]);
    let count = plate.nodes.len();
    for friction in [Some(0.2), None] {
        let mut meeting = Meeting::<f32>::new(&mesh, &soft(2e4), friction);
        let masses = meeting.network.masses.iter().enumerate();
        let forces: Vec<DVec3> = masses
            .map(|(v, m)| m * if v < count { 100.0 } else { -100.0 } * DVec3::Z)
            .collect();
        meeting.body.set_forces(&forces).unwrap();
        meeting.body.run(1, 0.02).unwrap();
        assert!(friction.is_none() || meeting.pierced() == 0);
        let x = meeting.body.positions();
        let height = |x: &[DVec3]| x.iter().map(|x| x.z).sum::<f64>() / x.len() as f64;
        let above = height(&x[count..]) > height(&x[..count]);
        assert_eq!(above, friction.is_some());
    }
}

#[test]
fn separated_cut_faces_do_not_interpenetrate() {
    // Two blocks that coincide on a face at rest, pulled apart, and thrown back obliquely.
    let block = box_mesh([3, 3, 2], DVec3::new(0.06, 0.06, 0.03), Split::Five).unwrap();
    let mesh = joined(&[
        (&block, DQuat::IDENTITY, DVec3::ZERO),
        (&block, DQuat::IDENTITY, DVec3::new(0.0, 0.0, 0.03)),
    ]);
    let count = block.nodes.len();
    for friction in [Some(0.2), None] {
        let mut meeting = Meeting::<f32>::new(&mesh, &soft(2e4), friction);
        assert_eq!(meeting.through, 0);
        let mut x = meeting.body.positions();
        let mut v = vec![DVec3::ZERO; x.len()];
        for k in count..x.len() {
            x[k] += DVec3::new(0.003, 0.002, 0.004);
            v[k] = DVec3::new(0.0, 0.1, -1.0);
        }
        meeting.body.set_state(&x, &v).unwrap();
        let mut most = 0;
        for _ in 0..20 {
            meeting.body.run(1, 0.01).unwrap();
            most = most.max(meeting.pierced());
        }
        match friction {
            Some(_) => assert_eq!(most, 0),
            None => assert!(most > 0),
        }
    }
}

#[test]
fn initially_intersecting_parts_are_separated() {
    let one = ball(0.05, 5).unwrap();
    let at = DVec3::new(0.09, 0.003, 0.002);
    let mesh = joined(&[
        (&one, DQuat::IDENTITY, DVec3::ZERO),
        (&one, DQuat::from_rotation_z(0.5), at),
    ]);
    let mut meeting = Meeting::<f64>::new(&mesh, &soft(1e4), Some(0.0));
    assert!(meeting.through > 0 && meeting.pierced() > 0);
    let mut free = None;
    for step in 0..40 {
        meeting.body.run(1, 0.01).unwrap();
        let through = meeting.pierced();
        match free {
            Some(_) => assert_eq!(through, 0),
            None if through == 0 => free = Some(step),
            None => {}
        }
    }
    assert!(free.is_some());
    // The separation is gentle.
    let v = meeting.body.velocities();
    let fastest = v.iter().map(|v| v.length()).fold(0.0, f64::max);
    assert!(fastest < 1.0, "{fastest}");
}
