//! Complete pictures against the exact ray integral.

use crate::render::common::*;
use glam::DVec3;
use palpate::generate;
use palpate::mesh::{Location, TetMesh};
use palpate::render::*;

#[test]
fn cube_matches_reference_for_traversals_and_tables() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(12, false).unwrap();
    let scalars = node_scalars(&mesh, "scalar");
    for (walk, table, reads) in [
        (
            Traversal::Vertices,
            TableKind::Integrals,
            MeshAccess::Stored,
        ),
        (
            Traversal::Vertices,
            TableKind::Integrals,
            MeshAccess::Sampled,
        ),
        (Traversal::Planes, TableKind::Integrals, MeshAccess::Stored),
        (Traversal::Planes, TableKind::Integrals, MeshAccess::Sampled),
        (Traversal::Vertices, TableKind::Sliced, MeshAccess::Stored),
        (Traversal::Planes, TableKind::Sliced, MeshAccess::Sampled),
        (Traversal::Vertices, TableKind::Volume, MeshAccess::Sampled),
    ] {
        let options = RaycastOptions {
            walk,
            table,
            reads,
            ..Default::default()
        };
        let mut scene = Scene::new(
            &gpu,
            &mesh,
            &mesh.nodes,
            &scalars,
            &peers_transfer(),
            options,
        );
        let (image, rms, worst) = scene.compare(&peers_camera(), [160, 120]);
        println!("{walk:?} {table:?} {reads:?}: rms {rms:.3} worst {worst:.3}");
        keep(&image, &format!("cube-{walk:?}-{table:?}-{reads:?}.png"));
        assert!(
            rms < 0.5 && worst < 2.0,
            "{walk:?} {table:?} {reads:?}: {rms} {worst}"
        );
    }
}

/// One of the five scenes: both traversals within half a level of the reference.
fn scene<'a>(
    name: &str,
    mesh: &TetMesh,
    positions: &[DVec3],
    scalars: impl Into<Scalars<'a>>,
    preset: &str,
) {
    let scalars = scalars.into();
    let gpu = gpu();
    let transfer = TransferFunction::preset(preset).unwrap();
    let mut camera = Camera::fit_mesh(mesh);
    let (low, high) = palpate::mesh::bounds(positions);
    let shift = 0.5 * (low + high) - camera.look_at;
    camera.eye += 1.2 * shift;
    camera.look_at += shift;
    for walk in [Traversal::Vertices, Traversal::Planes] {
        let options = RaycastOptions {
            walk,
            ..Default::default()
        };
        let mut scene = Scene::new(&gpu, mesh, positions, scalars, &transfer, options);
        let (image, rms, worst) = scene.compare(&camera, [128, 128]);
        println!("{name} {walk:?}: rms {rms:.3} worst {worst:.3}");
        keep(&image, &format!("{name}-{walk:?}.png"));
        assert!(rms < 0.5 && worst < 2.0, "{name} {walk:?}: {rms} {worst}");
        let shown = image.values.chunks(4).filter(|p| p[3] > 0.1).count();
        assert!(shown > 500, "{name}: only {shown} pixels show anything");
    }
}

#[test]
fn bar_matches_reference() {
    let mesh = generate::paper_bar().unwrap();
    scene("bar", &mesh, &mesh.nodes, &waves(&mesh), "viridis");
}

#[test]
fn duct_matches_reference() {
    let mesh = generate::duct([9, 9, 9], DVec3::new(1.0, 1.0, 1.5), generate::Bore::Round).unwrap();
    scene("duct", &mesh, &bent(&mesh), &waves(&mesh), "inferno");
}

#[test]
fn sliver_mesh_matches_reference() {
    let mesh = slivers();
    scene("slivers", &mesh, &mesh.nodes, &waves(&mesh), "muscle");
}

#[test]
fn heart_matches_reference() {
    let Some(mesh) = real_mesh("scalar/chaste_heart_decimation.vtu") else {
        return;
    };
    let scalars = node_scalars(&mesh, "Distance from origin");
    scene("heart", &mesh, &mesh.nodes, &scalars, "muscle");
}

#[test]
#[ignore = "long: scripts/test --full"]
fn cell_labels_match_reference() {
    let mesh = generate::by_name("limb", Some(12_000)).unwrap();
    let labels = mesh.field("label", Location::Cell).unwrap();
    let labels = Scalars::Cells(&labels.values);
    scene("labels", &mesh, &bent(&mesh), labels, "coolwarm");
}

#[test]
fn disk_matches_reference() {
    let Some(mesh) = real_mesh("scalar/disk_out_ref_tets.vtu") else {
        return;
    };
    scene(
        "disk",
        &mesh,
        &mesh.nodes,
        &node_scalars(&mesh, "Temp"),
        "magma",
    );
}

#[test]
fn deformed_limb_matches_reference() {
    let mesh = generate::by_name("limb", Some(12_000)).unwrap();
    let scalars = limb_scalars(&mesh);
    scene("limb", &mesh, &bent(&mesh), &scalars, "bone");
}

#[test]
fn image_is_invariant_to_translation_and_scale() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(5, true).unwrap();
    let scalars = node_scalars(&mesh, "scalar");
    let camera = peers_camera();
    let transfer = TransferFunction::preset("coolwarm").unwrap();
    let mut caster = Raycaster::new(
        &gpu,
        Geometry::at_rest(&gpu, &mesh, &scalars).unwrap(),
        &transfer,
    )
    .unwrap();
    let plain = caster.image(&camera, [64, 64], Mode::Composite).unwrap();
    let (shift, scale) = (DVec3::new(3e6, -2e5, 1e6), 1e3);
    let mut far = mesh.clone();
    far.nodes.iter_mut().for_each(|p| *p = *p * scale + shift);
    let far_camera = Camera {
        eye: camera.eye * scale + shift,
        look_at: camera.look_at * scale + shift,
        ..camera
    };
    let mut caster = Raycaster::new(
        &gpu,
        Geometry::at_rest(&gpu, &far, &scalars).unwrap(),
        &transfer,
    )
    .unwrap();
    let moved = caster
        .image(&far_camera, [64, 64], Mode::Composite)
        .unwrap();
    let most = plain
        .values
        .iter()
        .zip(&moved.values)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max);
    assert!(most < 1e-3, "{most}");
}

#[test]
fn large_images_tile_without_seams() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(3, false).unwrap();
    let scalars = node_scalars(&mesh, "scalar");
    let geometry = Geometry::at_rest(&gpu, &mesh, &scalars).unwrap();
    let mut caster = Raycaster::new(&gpu, geometry, &peers_transfer()).unwrap();
    let image = caster
        .image(&peers_camera(), [1400, 1100], Mode::Thickness)
        .unwrap();
    let truth = palpate::render::ReferenceRaycaster::new(&mesh, &mesh.nodes, &scalars);
    let camera = peers_camera();
    let mut wrong = 0;
    for y in (7..1100).step_by(13) {
        for x in (1020..1030).chain((3..1400).step_by(61)) {
            let at = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let exact = truth.thickness(camera.ray(at, [1400, 1100]));
            wrong += usize::from((f64::from(image.pixel(x, y)[0]) - exact).abs() > 1e-3);
        }
    }
    assert!(wrong < 4, "{wrong}");
}

#[test]
fn comparison_detects_wrong_field() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(5, false).unwrap();
    let scalars = node_scalars(&mesh, "scalar");
    let mut scene = Scene::new(
        &gpu,
        &mesh,
        &mesh.nodes,
        &scalars,
        &peers_transfer(),
        RaycastOptions::default(),
    );
    let nudged: Vec<f64> = scalars.iter().map(|s| s + 0.01).collect();
    scene.truth = palpate::render::ReferenceRaycaster::new(&mesh, &mesh.nodes, &nudged);
    let (_, rms, _) = scene.compare(&peers_camera(), [64, 64]);
    assert!(rms > 0.5, "{rms}");
}
