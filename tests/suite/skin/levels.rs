//! One skin on a coarse and on a fine body.

use crate::skin::common::*;
use glam::DVec3;
use palpate::generate;
use palpate::mesh::{BarycentricMap, LocalFrame, TetMesh};
use palpate::physics::{GpuBody, ImplicitEuler, Material, Solver};
use palpate::render::local_positions;
use palpate::skin::{Mapping, Skin, SkinBase};

/// A smooth bend of all points.
fn bent(p: &DVec3) -> DVec3 {
    *p + DVec3::new(0.15 * p.z * p.z, 0.1 * (2.0 * p.x).sin(), 0.1 * p.x * p.y)
}

#[test]
fn level_switch_is_continuous() {
    let gpu = gpu();
    let surface = bumpy(30);
    let meshes = [6, 12].map(|cells| generate::ball(1.0, cells).unwrap());
    let bodies = meshes.each_ref().map(|mesh| {
        let frame = LocalFrame::from_mesh(mesh);
        let positions = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
        (
            SkinBase::from_mesh(&gpu, mesh, &positions, frame).unwrap(),
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
    // At rest nothing moves.
    let whole = size(&surface.vertices);
    for level in [1, 0, 1, 0] {
        skin.set_level(level).unwrap();
        assert_eq!(skin.level(), level);
        let error = apart(&skin.vertices().unwrap(), &surface.vertices);
        assert!(error < 1e-6 * whole, "{error:e}");
    }
    // Bent, the coarse body transfers its positions to the fine one.
    let coarse: Vec<DVec3> = meshes[0].nodes.iter().map(bent).collect();
    stand(0, &coarse);
    let over = BarycentricMap::new(&meshes[0], &meshes[1].nodes).unwrap();
    stand(1, &over.apply(&coarse).unwrap());
    let before = skin.vertices().unwrap();
    skin.set_level(1).unwrap();
    let jump = apart(&before, &skin.vertices().unwrap());
    // Distance of the coarse mapping from the exact bend of the skin.
    let truth: Vec<DVec3> = surface.vertices.iter().map(bent).collect();
    let error = apart(&before, &truth);
    let moved = apart(&before, &surface.vertices);
    println!("jump {jump:.4}, mapping error {error:.4}, moved {moved:.4}");
    assert!(jump <= error && error < 0.5 * moved);
    assert!(skin.set_level(2).is_err());
    let mut bare = Skin::body_surface(&gpu, &bodies[0].0, None).unwrap();
    assert!(bare.add_level(&bodies[1].0).is_err());
}

/// Returns the velocities of the vertices of `skin` for the velocities of `body`.
fn pace(skin: &Skin, body: &mut GpuBody) -> Vec<DVec3> {
    let (places, velocities) = (body.positions().unwrap(), body.velocities().unwrap());
    let dt = 1e-3;
    let before = skin.vertices().unwrap();
    let later = places.iter().zip(&velocities).map(|(p, v)| *p + dt * *v);
    body.set_positions(&later.collect::<Vec<_>>()).unwrap();
    let after = skin.vertices().unwrap();
    body.set_positions(&places).unwrap();
    let paces = before.iter().zip(&after).map(|(a, b)| (b - a) / dt);
    paces.collect()
}

#[test]
fn level_switch_transfers_position_and_velocity() {
    let gpu = gpu();
    let surface = bumpy(30);
    let meshes = [6, 12].map(|cells| generate::ball(1.0, cells).unwrap());
    let mut bodies = meshes.each_ref().map(|mesh| {
        let mut body = GpuBody::new(&gpu, mesh, &Material::from_young(6e3)).unwrap();
        body.pin(|p| p.z < -0.7);
        body.set_gravity(DVec3::new(9.81, 0.0, 0.0));
        body
    });
    let carriers = [0, 1].map(|k| {
        let nodes = bodies[k].nodes();
        SkinBase::from_mesh(&gpu, &meshes[k], nodes.array(), nodes.frame()).unwrap()
    });
    let mut skin = Skin::new(&gpu, &surface, &carriers[0], Mapping::Interpolated).unwrap();
    skin.add_level(&carriers[1]).unwrap();
    let mut solver = ImplicitEuler::new(&gpu, &bodies[0]).unwrap();
    solver.run(&mut bodies[0], 15, 0.01).unwrap();

    let (places, velocities) = (
        bodies[0].positions().unwrap(),
        bodies[0].velocities().unwrap(),
    );
    let before = skin.vertices().unwrap();
    // Positions of the skin by the tets of the coarse body, not by its base triangles.
    let along = BarycentricMap::new(&meshes[0], &surface.vertices).unwrap();
    let truth = along.apply(&places).unwrap();
    let speeds = along.apply(&velocities).unwrap();
    let over = BarycentricMap::new(&meshes[0], &meshes[1].nodes).unwrap();
    let without_transfer = {
        skin.set_level(1).unwrap();
        apart(&before, &skin.vertices().unwrap())
    };
    bodies[1]
        .set_positions(&over.apply(&places).unwrap())
        .unwrap();
    let after = skin.vertices().unwrap();
    let jump = apart(&before, &after);
    let error = apart(&before, &truth);
    println!(
        "jump {jump:.4}, mapping error {error:.4}, without state transfer {without_transfer:.4}"
    );
    assert!(
        jump <= error && jump < 0.5 * without_transfer,
        "{jump} {error} {without_transfer}"
    );

    // Without velocities the fine body starts at rest.
    let at_rest = pace(&skin, &mut bodies[1]);
    bodies[1]
        .set_velocities(&over.apply(&velocities).unwrap())
        .unwrap();
    let fine = pace(&skin, &mut bodies[1]);
    skin.set_level(0).unwrap();
    let coarse = pace(&skin, &mut bodies[0]);
    let jump = apart(&coarse, &fine);
    let error = apart(&coarse, &speeds);
    let without_transfer = apart(&coarse, &at_rest);
    println!(
        "jump {jump:.4}, mapping error {error:.4}, without state transfer {without_transfer:.4} a second"
    );
    assert!(
        jump <= error && jump < 0.5 * without_transfer,
        "{jump} {error} {without_transfer}"
    );
}

#[test]
fn level_transfer_is_exact_for_linear_fields() {
    let (from, to) = (
        generate::ball(1.0, 6).unwrap(),
        generate::ball(1.1, 9).unwrap(),
    );
    let linear = |p: &DVec3| DVec3::new(2.0 * p.x - p.y, 0.5 * p.z + 3.0, p.x + p.y - p.z);
    let transfer = BarycentricMap::new(&from, &to.nodes).unwrap();
    let values: Vec<DVec3> = from.nodes.iter().map(linear).collect();
    let found = transfer.apply(&values).unwrap();
    let truth: Vec<DVec3> = to.nodes.iter().map(linear).collect();
    assert!(apart(&found, &truth) < 1e-9);
    // Nonlinear fields are not reproduced.
    let bends: Vec<DVec3> = from.nodes.iter().map(|p| *p * p.x).collect();
    let truth: Vec<DVec3> = to.nodes.iter().map(|p| *p * p.x).collect();
    assert!(apart(&transfer.apply(&bends).unwrap(), &truth) > 1e-3);
    assert!(transfer.apply(&values[1..]).is_err());
    assert!(BarycentricMap::new(&from, &[DVec3::NAN]).is_err());
    assert!(BarycentricMap::new(&TetMesh::default(), &to.nodes).is_err());
}
