//! One skin on a coarse and on a fine body.

use crate::common::*;
use glam::DVec3;
use palpate::mesh::{LocalFrame, TetMesh, Transfer, generate};
use palpate::render::local_positions;
use palpate::skin::{Carrier, Mapping, Skin};

/// A smooth bend of everything.
fn bent(p: &DVec3) -> DVec3 {
    *p + DVec3::new(0.15 * p.z * p.z, 0.1 * (2.0 * p.x).sin(), 0.1 * p.x * p.y)
}

#[test]
fn a_skin_goes_over_to_a_finer_body_and_back_without_a_jump() {
    let gpu = gpu();
    let surface = bumpy(30);
    let meshes = [6, 12].map(|cells| generate::ball(1.0, cells).unwrap());
    let bodies = meshes.each_ref().map(|mesh| {
        let frame = LocalFrame::of_mesh(mesh);
        let positions = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
        (
            Carrier::of_mesh(&gpu, mesh, &positions, frame).unwrap(),
            positions,
        )
    });
    let mut skin = Skin::new(&gpu, &surface, &bodies[0].0, Mapping::Interpolated).unwrap();
    assert_eq!(skin.add_level(&bodies[1].0).unwrap(), 1);
    let stand = |level: usize, nodes: &[DVec3]| {
        let frame = bodies[level].0.frame();
        let local: Vec<[f32; 4]> = nodes
            .iter()
            .map(|p| frame.to_local(*p).extend(1.0).to_array())
            .collect();
        gpu.write_array(&bodies[level].1, &local).unwrap();
    };
    // At rest nothing moves at all.
    let whole = size(&surface.vertices);
    for level in [1, 0, 1, 0] {
        skin.use_level(level).unwrap();
        assert_eq!(skin.level(), level);
        let error = apart(&skin.vertices().unwrap(), &surface.vertices);
        assert!(error < 1e-6 * whole, "{error:e}");
    }
    // Bent, the coarse body hands its positions to the fine one.
    let coarse: Vec<DVec3> = meshes[0].nodes.iter().map(bent).collect();
    stand(0, &coarse);
    let over = Transfer::new(&meshes[0], &meshes[1].nodes).unwrap();
    stand(1, &over.apply(&coarse).unwrap());
    let before = skin.vertices().unwrap();
    skin.use_level(1).unwrap();
    let jump = apart(&before, &skin.vertices().unwrap());
    // How far the coarse mapping is from where the bend would have the skin.
    let truth: Vec<DVec3> = surface.vertices.iter().map(bent).collect();
    let error = apart(&before, &truth);
    let moved = apart(&before, &surface.vertices);
    println!("jump {jump:.4}, mapping error {error:.4}, moved {moved:.4}");
    assert!(jump <= error && error < 0.5 * moved);
    assert!(skin.use_level(2).is_err());
    let mut bare = Skin::bare(&gpu, &bodies[0].0, None).unwrap();
    assert!(bare.add_level(&bodies[1].0).is_err());
}

#[test]
fn what_is_linear_is_carried_over_exactly() {
    let (from, to) = (
        generate::ball(1.0, 6).unwrap(),
        generate::ball(1.1, 9).unwrap(),
    );
    let linear = |p: &DVec3| DVec3::new(2.0 * p.x - p.y, 0.5 * p.z + 3.0, p.x + p.y - p.z);
    let transfer = Transfer::new(&from, &to.nodes).unwrap();
    let values: Vec<DVec3> = from.nodes.iter().map(linear).collect();
    let found = transfer.apply(&values).unwrap();
    let truth: Vec<DVec3> = to.nodes.iter().map(linear).collect();
    assert!(apart(&found, &truth) < 1e-9);
    // What is not linear is not.
    let bends: Vec<DVec3> = from.nodes.iter().map(|p| *p * p.x).collect();
    let truth: Vec<DVec3> = to.nodes.iter().map(|p| *p * p.x).collect();
    assert!(apart(&transfer.apply(&bends).unwrap(), &truth) > 1e-3);
    assert!(transfer.apply(&values[1..]).is_err());
    assert!(Transfer::new(&from, &[DVec3::NAN]).is_err());
    assert!(Transfer::new(&TetMesh::default(), &to.nodes).is_err());
}
