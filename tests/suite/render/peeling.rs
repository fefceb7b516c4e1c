//! Depth peeling: no layer is lost or duplicated.

use crate::render::common::*;
use glam::DVec3;
use palpate::generate::{self, Split};
use palpate::mesh::TetMesh;
use palpate::render::*;

/// Returns a mesh of boxes, given by corner, size and cells, without common nodes.
fn boxes(list: &[([f64; 3], [f64; 3], usize)]) -> TetMesh {
    let (mut nodes, mut tets) = (Vec::new(), Vec::new());
    for (corner, size, cells) in list {
        let part = generate::box_mesh([*cells; 3], DVec3::from(*size), Split::Six).unwrap();
        let first = nodes.len() as u32;
        nodes.extend(part.nodes.iter().map(|p| *p + DVec3::from(*corner)));
        tets.extend(part.tets.iter().map(|t| t.map(|v| v + first)));
    }
    TetMesh::new(nodes, tets, Vec::new(), Vec::new()).unwrap()
}

fn check(mesh: &TetMesh, layers: u32, size: [u32; 2]) {
    let gpu = gpu();
    let options = RaycastOptions {
        layers,
        ..Default::default()
    };
    let mut scene = Scene::new(
        &gpu,
        mesh,
        &mesh.nodes,
        &waves(mesh),
        &peers_transfer(),
        options,
    );
    let eye = DVec3::new(2.6, 1.6, 4.0);
    for camera in [
        Camera::perspective(eye, DVec3::ZERO, DVec3::Y, 32.0),
        Camera::orthographic(eye, DVec3::ZERO, DVec3::Y, 3.2),
        Camera::orthographic(DVec3::X * 4.0, DVec3::ZERO, DVec3::Y, 2.71),
    ] {
        let image = scene.caster.image(&camera, size, Mode::Thickness).unwrap();
        let truth = scene
            .truth
            .render(&camera, size, |reference, ray| reference.thickness(ray));
        let wrong = image
            .values
            .iter()
            .zip(&truth)
            .filter(|(a, b)| (f64::from(**a) - **b).abs() > 2e-2)
            .count();
        // At most a few pixels lie within a 256th of a silhouette.
        assert!(wrong < 8, "{wrong} wrong pixels, {camera:?}");
    }
}

#[test]
fn touching_and_duplicated_boxes_match_reference() {
    check(
        &boxes(&[
            ([-1.0, -1.0, -1.0], [1.0, 2.0, 2.0], 5),
            ([0.0, -1.0, -1.0], [1.0, 2.0, 2.0], 3),
            ([-1.0, -1.0, -1.0], [1.0, 2.0, 2.0], 5),
            ([-0.5, -0.5, -1.0], [1.2, 1.0, 2.0], 2),
        ]),
        8,
        [128, 128],
    );
}

#[test]
fn tiles_with_different_layer_counts_match_reference() {
    // Boxes of decreasing size, next to each other with gaps.
    let plates: Vec<_> = (0..7)
        .flat_map(|i| {
            let (z, side) = (-1.0 + 0.3 * f64::from(i), 0.9 / f64::from(i + 1));
            [-1.0, 0.1].map(|x| ([x, -x * 0.5 - 0.4, z], [side, 1.3 * side, 0.12], 1))
        })
        .collect();
    check(&boxes(&plates), 14, [131, 97]);
}

#[test]
fn layer_limit_is_enforced() {
    let plates: Vec<_> = (0..9)
        .map(|i| ([-1.0, -1.0, -1.0 + 0.22 * f64::from(i)], [2.0, 2.0, 0.1], 1))
        .collect();
    let mesh = boxes(&plates);
    check(&mesh, 9, [128, 128]);
    let gpu = gpu();
    let options = RaycastOptions {
        layers: 8,
        ..Default::default()
    };
    let mut scene = Scene::new(
        &gpu,
        &mesh,
        &mesh.nodes,
        &waves(&mesh),
        &peers_transfer(),
        options,
    );
    let camera = Camera::orthographic(DVec3::Z * 4.0, DVec3::ZERO, DVec3::Y, 3.0);
    let error = scene
        .caster
        .image(&camera, [64, 64], Mode::Thickness)
        .unwrap_err();
    assert!(error.to_string().contains("--layers"), "{error}");
}

#[test]
fn opaque_rays_need_no_further_layers() {
    let plates: Vec<_> = (0..6)
        .map(|i| ([-1.0, -1.0, -1.0 + 0.3 * f64::from(i)], [2.0, 2.0, 0.2], 1))
        .collect();
    let mesh = boxes(&plates);
    let gpu = gpu();
    let solid = TransferFunction::new(vec![[0.0, 1.0, 0.5, 0.25]], vec![[0.0, 1e4]]).unwrap();
    // One layer suffices if the first plate is opaque.
    let options = RaycastOptions {
        layers: 1,
        ..Default::default()
    };
    let mut scene = Scene::new(&gpu, &mesh, &mesh.nodes, &waves(&mesh), &solid, options);
    let camera = Camera::orthographic(DVec3::Z * 4.0, DVec3::ZERO, DVec3::Y, 3.0);
    let image = scene
        .caster
        .image(&camera, [64, 64], Mode::Composite)
        .unwrap();
    assert!((image.pixel(32, 32)[0] - 1.0).abs() < 2e-3);
}
