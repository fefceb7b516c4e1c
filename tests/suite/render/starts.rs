//! Rays start wherever they enter, despite the coarse grid to which the rasteriser snaps corners;
//! missing starts are counted.

use crate::render::common::*;
use glam::DVec3;
use palpate::generate;
use palpate::mesh::{FACES, LocalFrame, TetMesh, Topology};
use palpate::render::*;

fn caster(mesh: &TetMesh, topology: &Topology, walk: Traversal) -> Raycaster {
    let gpu = gpu();
    let frame = LocalFrame::from_mesh(mesh);
    let array = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
    let scalars = vec![0.0; mesh.nodes.len()];
    let geometry = Geometry::new(&gpu, mesh, topology, frame, &array, &scalars).unwrap();
    let options = RaycastOptions {
        walk,
        ..Default::default()
    };
    Raycaster::with_options(&gpu, geometry, &peers_transfer(), options).unwrap()
}

#[test]
#[ignore = "long: scripts/test --full"]
fn limb_rays_all_start() {
    let mesh = generate::by_name("limb", Some(9_000)).unwrap();
    let mut caster = caster(&mesh, &Topology::new(&mesh), Traversal::Vertices);
    let far = Camera::fit_mesh(&mesh);
    // Faces of several pixels, of subpixel size, and some far beyond the picture.
    let mut close = far;
    close.eye = close.look_at + 0.25 * (close.eye - close.look_at);
    for (camera, size) in [
        (&far, [640, 480]),
        (&far, [61, 47]),
        (&far, [1_100, 300]),
        (&close, [320, 240]),
    ] {
        let report = caster.report(camera, size).unwrap();
        assert!(report.rays > 200, "{report:?}");
        assert_eq!(report.lost_rays, 0, "{size:?} {camera:?}");
    }
}

#[test]
fn rays_start_at_edge_on_slivers() {
    // A plate of thickness 1e-6, and needles: all faces are slivers, or appear as such.
    for scale in [
        DVec3::new(1.0, 1.0, 1e-6),
        DVec3::new(1.0, 1e-3, 1e-3),
        DVec3::new(1.0, 0.5, 0.002),
    ] {
        let mut mesh = generate::benchmark_cube(6, false).unwrap();
        mesh.nodes.iter_mut().for_each(|p| *p = (*p - 0.5) * scale);
        let mut caster = caster(&mesh, &Topology::new(&mesh), Traversal::Vertices);
        for (eye, up) in [
            (DVec3::new(0.2, 1.9, 0.003), DVec3::Z),
            (DVec3::new(1.7, 0.4, 0.01), DVec3::Z),
            (DVec3::new(0.3, 0.2, 1.5), DVec3::Y),
        ] {
            for camera in [
                Camera::perspective(eye, DVec3::ZERO, up, 35.0),
                Camera::orthographic(eye, DVec3::ZERO, up, 1.0),
            ] {
                let report = caster.report(&camera, [200, 150]).unwrap();
                assert_eq!(report.lost_rays, 0, "{scale} {camera:?}");
            }
        }
    }
}

#[test]
fn rays_start_for_eye_inside_or_near_boundary() {
    let mesh = generate::benchmark_cube(6, true).unwrap();
    let mut caster = caster(&mesh, &Topology::new(&mesh), Traversal::Vertices);
    let look_at = DVec3::new(0.48, 0.53, 0.51);
    for eye in [
        DVec3::new(0.11, 0.17, 0.52),
        DVec3::new(0.5, 0.5, 0.06),
        // Slightly outside of a side, and slightly inside.
        DVec3::new(-0.001, 0.4, 0.45),
        DVec3::new(0.001, 0.4, 0.45),
        // Along a side, with faces on both sides of the plane of the eye.
        DVec3::new(1.0 + 1e-4, 0.3, 0.9),
    ] {
        for camera in [
            Camera::perspective(eye, look_at, DVec3::Y, 75.0),
            Camera::orthographic(eye, look_at, DVec3::Y, 0.7),
        ] {
            let report = caster.report(&camera, [160, 120]).unwrap();
            assert!(report.rays > 1_000, "{report:?}");
            assert_eq!(report.lost_rays, 0, "{camera:?}");
        }
    }
}

/// Returns the topology of `mesh` without the boundary face selected by `is`: no ray starts there.
fn without(mesh: &TetMesh, is: impl Fn([DVec3; 3]) -> bool) -> Topology {
    let mut topology = Topology::new(mesh);
    let bare = |t: usize, f: usize| topology.neighbours[t][f] == u32::MAX;
    let corners = |t: usize, f: usize| FACES[f].map(|v| mesh.nodes[mesh.tets[t][v] as usize]);
    let (t, f) = (0..mesh.tets.len())
        .flat_map(|t| (0..4).map(move |f| (t, f)))
        .find(|(t, f)| bare(*t, *f) && is(corners(*t, *f)))
        .unwrap();
    // Another tet behind it, which no ray reaches through that face.
    topology.neighbours[t][f] = 4 * ((t as u32 + 7) % mesh.tets.len() as u32);
    topology
}

#[test]
fn missing_ray_starts_are_counted() {
    let mesh = generate::benchmark_cube(6, false).unwrap();
    let front = |c: [DVec3; 3]| c.iter().all(|p| p.z > 1.0 - 1e-9);
    let topology = without(&mesh, front);
    let camera = Camera::orthographic(
        DVec3::new(0.5, 0.5, 3.0),
        DVec3::splat(0.5),
        DVec3::Y,
        0.999,
    );
    for walk in [Traversal::Vertices, Traversal::Planes] {
        let mut whole = caster(&mesh, &Topology::new(&mesh), walk);
        let size = [150, 150];
        assert_eq!(whole.report(&camera, size).unwrap().lost_rays, 0);
        let mut holed = caster(&mesh, &topology, walk);
        let image = holed.image(&camera, size, Mode::Thickness).unwrap();
        let holes = image.values.iter().filter(|t| **t == 0.0).count() as u64;
        let report = holed.report(&camera, size).unwrap();
        assert!(holes > 100, "{holes}");
        // Once or twice each: the report also traverses from behind, into the wrong tet.
        let lost = report.lost_rays;
        assert!((holes..=2 * holes).contains(&lost), "{walk:?}: {lost}");
        assert_eq!(report.rays, 150 * 150);
    }
}

#[test]
fn missing_reentries_are_counted() {
    let mesh = generate::benchmark_cube(6, true).unwrap();
    let camera = peers_camera();
    // A wall of the duct that faces the eye: rays through the duct enter again there.
    let towards = (camera.eye - camera.look_at).normalize();
    let inner = |c: [DVec3; 3]| {
        let normal = (c[1] - c[0]).cross(c[2] - c[0]).normalize();
        let middle = (c[0] + c[1] + c[2]) / 3.0;
        let within = |x: f64| x > 0.01 && x < 0.99;
        normal.dot(towards) > 0.3 && middle.to_array().into_iter().all(within)
    };
    let topology = without(&mesh, inner);
    for walk in [Traversal::Vertices, Traversal::Planes] {
        let lost = |topology: &Topology| {
            let mut caster = caster(&mesh, topology, walk);
            let report = caster.report(&camera, [150, 150]).unwrap();
            (report.peel_layers, report.lost_rays)
        };
        assert_eq!(lost(&Topology::new(&mesh)), (2, 0));
        assert!(lost(&topology).1 > 10, "{walk:?}");
    }
}
