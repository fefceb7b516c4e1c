//! Length of rays inside meshes, individually and summed; lost rays.

use crate::render::common::*;
use glam::{DVec2, DVec3};
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{TetMesh, Topology};
use palpate::render::ReferenceRaycaster;
use palpate::render::*;
use rayon::prelude::*;

fn caster(
    gpu: &Gpu,
    mesh: &TetMesh,
    positions: &[DVec3],
    walk: Traversal,
) -> (Raycaster, ReferenceRaycaster) {
    let options = RaycastOptions {
        walk,
        ..Default::default()
    };
    let scene = Scene::new(
        gpu,
        mesh,
        positions,
        &waves(mesh),
        &peers_transfer(),
        options,
    );
    (scene.caster, scene.truth)
}

/// Returns a random camera around the mesh that sees all of it.
fn random_camera(positions: &[DVec3], random: &mut Random) -> Camera {
    let (low, high) = palpate::mesh::bounds(positions);
    let (middle, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
    let away = random.direction();
    let up = random.direction();
    if random.unit() < 0.5 {
        Camera::orthographic(middle + 3.0 * radius * away, middle, up, 2.0 * radius)
    } else {
        let distance = random.between(1.6, 5.0) * radius;
        let fov = 2.0 * (radius / distance).asin().to_degrees();
        Camera::perspective(middle + distance * away, middle, up, fov)
    }
}

/// Returns the number of pixels whose thickness is outside the range of the exact rays within a
/// 100th of a pixel, and the largest difference at the pixel centre.
///
/// A rasteriser snaps vertices to a grid of 256ths of a pixel: at a silhouette, the nearest exact
/// rays determine whether a pixel is covered.
fn wrong_pixels(
    image: &Image,
    truth: &ReferenceRaycaster,
    camera: &Camera,
    unit: f64,
) -> (usize, f64) {
    let size = image.size;
    let results: Vec<(bool, f64)> = (0..image.values.len())
        .into_par_iter()
        .map(|i| {
            let at = DVec2::new(
                (i % size[0] as usize) as f64 + 0.5,
                (i / size[0] as usize) as f64 + 0.5,
            );
            let got = f64::from(image.values[i]);
            let exact = |d: DVec2| truth.thickness(camera.ray(at + d, size));
            let miss = (exact(DVec2::ZERO) - got).abs();
            let near = 3e-5 * unit;
            if miss < near {
                return (false, miss);
            }
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for step in 0..48 {
                let (angle, ring) = (f64::from(step) * std::f64::consts::TAU / 16.0, step / 16);
                let t = exact([0.001, 0.004, 0.01][ring as usize] * DVec2::from_angle(angle));
                (low, high) = (low.min(t), high.max(t));
            }
            let wrong = got < low - near || got > high + near;
            (wrong, miss)
        })
        .collect();
    let wrong = results.iter().filter(|r| r.0).count();
    (wrong, results.iter().map(|r| r.1).fold(0.0, f64::max))
}

#[test]
fn ray_thickness_matches_float64() {
    match_float64(made_meshes(), [48, 48]);
}

#[test]
#[ignore = "long: scripts/test --full"]
fn ray_thickness_of_real_meshes_matches_float64() {
    match_float64(real_meshes(), [130, 130]);
}

/// Three cameras at rest and bent.
fn match_float64(meshes: impl Iterator<Item = (&'static str, TetMesh)>, size: [u32; 2]) {
    let gpu = gpu();
    for (seed, (name, mesh)) in meshes.enumerate() {
        let mut random = Random::new(seed as u64 + 1);
        for positions in [mesh.nodes.clone(), bent(&mesh)] {
            let (low, high) = palpate::mesh::bounds(&positions);
            let unit = (high - low).max_element();
            let (mut vertices, truth) = caster(&gpu, &mesh, &positions, Traversal::Vertices);
            let (mut planes, _) = caster(&gpu, &mesh, &positions, Traversal::Planes);
            for _ in 0..3 {
                let camera = random_camera(&positions, &mut random);
                let image = vertices.image(&camera, size, Mode::Thickness).unwrap();
                let (wrong, worst) = wrong_pixels(&image, &truth, &camera, unit);
                println!("{name}: {wrong} wrong, worst {:.1e}", worst / unit);
                assert_eq!(wrong, 0, "{name} {camera:?}");
                for caster in [&mut vertices, &mut planes] {
                    let report = caster.report(&camera, size).unwrap();
                    assert_eq!(
                        (report.lost_rays, report.inverted),
                        (0, 0),
                        "{name} {camera:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn comparison_detects_wrong_shape() {
    let gpu = gpu();
    let mesh = slivers();
    let (mut caster, _) = caster(&gpu, &mesh, &mesh.nodes, Traversal::Vertices);
    let moved: Vec<DVec3> = mesh.nodes.iter().map(|p| *p * 1.002).collect();
    let truth = ReferenceRaycaster::new(&mesh, &moved, &waves(&mesh));
    let camera = Camera::fit_mesh(&mesh);
    let image = caster.image(&camera, [64, 64], Mode::Thickness).unwrap();
    let (low, high) = mesh.bounds();
    let (wrong, _) = wrong_pixels(&image, &truth, &camera, (high - low).max_element());
    assert!(wrong > 100);
}

#[test]
#[ignore = "long: scripts/test --full"]
fn thickness_integral_equals_volume() {
    fill_volume(made_meshes());
}

#[test]
#[ignore = "long: scripts/test --full"]
fn thickness_integral_equals_volume_of_real_meshes() {
    fill_volume(real_meshes());
}

fn fill_volume(meshes: impl Iterator<Item = (&'static str, TetMesh)>) {
    let gpu = gpu();
    for (seed, (name, mesh)) in meshes.enumerate() {
        let positions = mesh.nodes.clone();
        let (low, high) = mesh.bounds();
        let (middle, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
        let away = DVec3::new(0.48, 0.36, 0.8);
        let camera =
            Camera::orthographic(middle + 2.0 * radius * away, middle, DVec3::Y, 2.0 * radius);
        let walk = if seed == 1 {
            Traversal::Planes
        } else {
            Traversal::Vertices
        };
        let (mut caster, _) = caster(&gpu, &mesh, &positions, walk);
        let image = caster
            .image(&camera, [1024, 1024], Mode::Thickness)
            .unwrap();
        let pixel = 2.0 * radius / 1024.0;
        let sum: f64 = image.values.iter().map(|v| f64::from(*v)).sum();
        let ratio = sum * pixel * pixel / mesh.volume();
        println!("{name}: {ratio:.6}");
        assert!((ratio - 1.0).abs() < 1e-3, "{name}: {ratio}");
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn axis_aligned_rays_are_not_lost() {
    lose_none(made_meshes());
}

#[test]
#[ignore = "long: scripts/test --full"]
fn axis_aligned_rays_of_real_meshes_are_not_lost() {
    lose_none(real_meshes());
}

fn lose_none(meshes: impl Iterator<Item = (&'static str, TetMesh)>) {
    let gpu = gpu();
    let grids = [
        ("grid", generate::benchmark_cube(8, false).unwrap()),
        (
            "grid with a duct",
            generate::benchmark_cube(9, true).unwrap(),
        ),
    ];
    for (name, mesh) in meshes.chain(grids) {
        for walk in [Traversal::Vertices, Traversal::Planes] {
            let (mut caster, _) = caster(&gpu, &mesh, &mesh.nodes, walk);
            let (low, high) = mesh.bounds();
            let (middle, unit) = (0.5 * (low + high), (high - low).max_element());
            for (axis, up) in [
                (DVec3::X, DVec3::Y),
                (DVec3::Y, DVec3::Z),
                (DVec3::NEG_Z, DVec3::Y),
            ] {
                // Odd sizes put a ray exactly through the centre, and even ones along the grid.
                for camera in [
                    Camera::orthographic(middle + 2.0 * unit * axis, middle, up, unit),
                    Camera::perspective(middle + 2.0 * unit * axis, middle, up, 35.0),
                ] {
                    let report = caster.report(&camera, [129, 129]).unwrap();
                    assert!(report.rays > 100, "{name}: {report:?}");
                    assert_eq!(report.lost_rays, 0, "{name} {walk:?} {camera:?}");
                    assert_eq!(report.inverted, 0, "{name}");
                }
            }
        }
    }
}

#[test]
fn rays_along_grid_edges_have_grid_length() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(8, false).unwrap();
    for walk in [Traversal::Vertices, Traversal::Planes] {
        let (mut caster, _) = caster(&gpu, &mesh, &mesh.nodes, walk);
        let camera = Camera::orthographic(
            DVec3::new(0.5, 0.5, 3.0),
            DVec3::splat(0.5),
            DVec3::Y,
            0.9375,
        );
        // Alternate rows and columns of rays run exactly along the grid's edges and faces.
        let image = caster.image(&camera, [15, 15], Mode::Thickness).unwrap();
        for (i, t) in image.values.iter().enumerate() {
            assert!((t - 1.0).abs() < 1e-4, "{walk:?}: ray {i} is {t} long");
        }
    }
}

#[test]
fn corrupt_link_loses_rays_and_traversal_terminates() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(6, false).unwrap();
    let mut topology = Topology::new(&mesh);
    let middle = mesh.tets.len() / 2;
    let inner = (0..4)
        .find(|f| topology.neighbours[middle][*f] < u32::MAX)
        .unwrap();
    topology.neighbours[middle][inner] = 4 * 3 + 1;
    let frame = palpate::mesh::LocalFrame::from_mesh(&mesh);
    let array = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
    for walk in [Traversal::Vertices, Traversal::Planes] {
        let geometry = Geometry::new(&gpu, &mesh, &topology, frame, &array, &waves(&mesh)).unwrap();
        let options = RaycastOptions {
            walk,
            ..Default::default()
        };
        let mut caster =
            Raycaster::with_options(&gpu, geometry, &peers_transfer(), options).unwrap();
        let lost: u64 = [1.0, -1.0]
            .into_iter()
            .map(|side| {
                let eye = DVec3::splat(0.5) + side * DVec3::new(1.3, 0.8, 2.0);
                let camera = Camera::perspective(eye, DVec3::splat(0.5), DVec3::Y, 30.0);
                caster.report(&camera, [200, 200]).unwrap().lost_rays
            })
            .sum();
        println!("{walk:?}: {lost} lost");
        assert!(lost > 0, "{walk:?}");
    }
}

#[test]
fn inverted_tets_do_not_stop_traversal() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(8, false).unwrap();
    let mut random = Random::new(7);
    let torn: Vec<DVec3> = mesh
        .nodes
        .iter()
        .map(|p| *p + 0.12 * DVec3::new(random.unit(), random.unit(), random.unit()))
        .collect();
    for walk in [Traversal::Vertices, Traversal::Planes] {
        let (mut caster, _) = caster(&gpu, &mesh, &torn, walk);
        let report = caster.report(&peers_camera(), [100, 100]).unwrap();
        println!("{walk:?}: {report:?}");
        assert!(report.inverted > 100);
        let image = caster
            .image(&peers_camera(), [100, 100], Mode::Composite)
            .unwrap();
        assert!(image.values.iter().all(|v| v.is_finite()));
    }
}
