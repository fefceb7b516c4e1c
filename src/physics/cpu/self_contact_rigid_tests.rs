//! Contact of rigid regions with each other.
#![allow(clippy::unwrap_used)]

use super::self_contact_tests::{Meeting, joined, soft};
use crate::mesh::generate::{Split, box_mesh};
use crate::mesh::{Field, Location, TetMesh};
use crate::physics::{Material, RegionMaterial};
use glam::{DQuat, DVec3};

/// The material of a mesh in which tets whose middles are so are rigid.
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
fn bones_that_spin_into_each_other_do_not_pass() {
    // Bars whose ends are bones, which meet.
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
        assert_eq!(meeting.network.elements.rigid.len(), 2);
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
            // By as much as steps are converged.
            Some(_) => assert!(most == 0 && off < 5e-3, "{most} {off}"),
            None => assert!(most > 0),
        }
    }
}
