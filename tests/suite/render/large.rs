//! Meshes of many millions of tets, and beyond the limits.

use crate::render::common::*;
use palpate::generate;
use palpate::mesh::{LocalFrame, TetMesh, Topology};
use palpate::render::*;

#[test]
fn geometry_rejects_too_many_tets_early() {
    let gpu = gpu();
    let most = gpu.max_items() / 4;
    let mesh = TetMesh {
        nodes: vec![glam::DVec3::ZERO; 4],
        tets: vec![[0, 1, 2, 3]; most + 1],
        ..TetMesh::default()
    };
    // No tet is read.
    let topology = Topology {
        neighbours: Vec::new(),
        boundary: Vec::new(),
    };
    let frame = LocalFrame::default();
    let positions = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
    let made = Geometry::new(&gpu, &mesh, &topology, frame, &positions, &vec![0.0; 4]);
    let message = made.map(|_| ()).unwrap_err().to_string();
    assert!(
        message.contains(&most.to_string()) && message.contains(&(most + 1).to_string()),
        "{message}"
    );
}

#[test]
#[ignore = "long: ten million tets"]
fn ten_million_tets_render() {
    let gpu = gpu();
    let camera = peers_camera();
    let transfer = peers_transfer();
    let picture = |tets: usize| {
        let mesh = generate::by_name("cube", Some(tets)).unwrap();
        let topology = Topology::new(&mesh);
        let scalars = node_scalars(&mesh, "scalar");
        let frame = LocalFrame::from_mesh(&mesh);
        let positions = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
        let geometry = Geometry::new(&gpu, &mesh, &topology, frame, &positions, &scalars).unwrap();
        let mut caster = Raycaster::new(&gpu, geometry, &transfer).unwrap();
        let image = caster.picture(&camera, [256; 2]).unwrap();
        assert_eq!(caster.report(&camera, [256; 2]).unwrap().lost_rays, 0);
        (mesh, topology, scalars, caster, image)
    };
    let (few, .., coarse) = picture(1_000_000);
    let (many, topology, scalars, mut caster, fine) = picture(10_000_000);
    let counts = [few.tets.len(), many.tets.len()];
    assert!(
        counts[0] < 1_100_000 && counts[1] > 10_000_000,
        "{counts:?}"
    );
    // The same smooth field, sampled twice as finely along each axis.
    let apart = ImageDifference::between(&coarse, &fine).unwrap();
    println!("{apart}");
    assert!(apart.within(0.5 / 255.0, 2.0 / 255.0), "{apart}");
    caster
        .geometry_mut()
        .enable_lighting(&many, &topology, &scalars)
        .unwrap();
    let lit = RaycastOptions {
        light: Light::Head,
        ..Default::default()
    };
    caster.set_options(lit).unwrap();
    let lit = caster.picture(&camera, [256; 2]).unwrap();
    keep(&lit, "ten_million.png");
    let apart = ImageDifference::between(&lit, &fine).unwrap();
    assert!(lit.values.iter().all(|v| v.is_finite()));
    assert!(!apart.within(4.0 / 255.0, 20.0 / 255.0), "{apart}");
    // The data of the plane traversal would not fit.
    let planes = RaycastOptions {
        walk: Traversal::Planes,
        ..Default::default()
    };
    caster.set_options(planes).unwrap();
    let message = caster.picture(&camera, [16; 2]).unwrap_err().to_string();
    assert!(message.contains("--walk vertices"), "{message}");
}
