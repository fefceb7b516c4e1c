//! Smoothing, and boundaries of regions.

use glam::{DAffine3, DVec3};
use palpate::generate::bar;
use palpate::mesh::{Field, Location, SurfaceDescription, TetMesh, TriMesh};
use palpate::volume::{Raw, Volume};
use std::collections::BTreeMap;

/// Returns the staircase surface of a ball of radius 10 voxels.
fn staircase() -> TriMesh {
    let n = 26;
    let place = |i: usize| DVec3::from([i % n, i / n % n, i / n / n].map(|i| i as f64 - 12.5));
    let inside = |i: usize| u8::from(place(i).length() < 10.0);
    let volume = Volume {
        size: [n; 3],
        raw: Raw::U8((0..n * n * n).map(inside).collect()),
        to_world: DAffine3::from_translation(DVec3::splat(-12.5)),
        ..Volume::default()
    };
    volume.label_surface(&[1]).unwrap()
}

/// Returns the root mean square angle between triangles and the sphere, in degrees.
fn roughness(surface: &TriMesh) -> f64 {
    let angle = |t: usize| {
        let middle: DVec3 = surface.corners(t).iter().sum();
        surface.area_vector(t).angle_between(middle).to_degrees()
    };
    let count = surface.triangles.len();
    ((0..count).map(|t| angle(t).powi(2)).sum::<f64>() / count as f64).sqrt()
}

#[test]
fn smoothing_removes_voxel_steps_and_preserves_volume() {
    let steps = staircase();
    let smooth = steps.smoothed(10);
    assert_eq!(steps.triangles, smooth.triangles);
    let change = smooth.volume() / steps.volume() - 1.0;
    assert!(change.abs() < 0.01, "{change}");
    let (before, after) = (roughness(&steps), roughness(&smooth));
    assert!(
        before > 15.0 && after < 0.5 * before,
        "{before}° to {after}°"
    );
    let moved = steps.vertices.iter().zip(&smooth.vertices);
    let farthest = moved.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    assert!(farthest < 1.0, "{farthest}");
    assert_eq!(steps.smoothed(0).vertices, steps.vertices);
}

#[test]
fn smoothing_preserves_open_rims() {
    let mut bowl = staircase();
    let keep: Vec<bool> = (0..bowl.triangles.len())
        .map(|t| bowl.corners(t).iter().all(|p| p.z < 2.0))
        .collect();
    let mut kept = keep.iter();
    bowl.triangles.retain(|_| *kept.next().unwrap());
    assert!(SurfaceDescription::new(&bowl).open_edges > 20);
    let smooth = bowl.smoothed(10);
    let mut sides = BTreeMap::new();
    for t in &bowl.triangles {
        for i in 0..3 {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            *sides.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
        }
    }
    let rim = sides.iter().filter(|s| *s.1 == 1).flat_map(|s| *s.0);
    for v in rim {
        assert_eq!(bowl.vertices[v as usize], smooth.vertices[v as usize]);
    }
    assert_ne!(bowl.vertices, smooth.vertices);
}

/// Returns a bar 4 × 1 × 1 with labels 1 in its left quarter, 2 in the middle half and 5 on the
/// right.
fn labelled_bar() -> TetMesh {
    let mut mesh = bar([8, 2, 2], DVec3::new(4.0, 1.0, 1.0)).unwrap();
    let (low, _) = mesh.bounds();
    let label = |t: usize| {
        let x = mesh.tet_nodes(t).iter().sum::<DVec3>().x / 4.0 - low.x;
        [1.0, 2.0, 2.0, 5.0][x as usize]
    };
    let labels = (0..mesh.tets.len()).map(label).collect();
    mesh.set_field(Field::scalar("label", Location::Cell, labels))
        .unwrap();
    let heights = mesh.nodes.iter().map(|p| p.z).collect();
    mesh.set_field(Field::scalar("height", Location::Node, heights))
        .unwrap();
    mesh
}

#[test]
fn region_surfaces_enclose_their_regions() {
    let mesh = labelled_bar();
    let table: [(Option<&[i64]>, f64, usize); 5] = [
        (None, 4.0, 1),
        (Some(&[1]), 1.0, 1),
        (Some(&[2]), 2.0, 1),
        (Some(&[5, 1]), 2.0, 2),
        (Some(&[1, 2, 7]), 3.0, 1),
    ];
    for (labels, volume, pieces) in table {
        let surface = mesh.boundary_surface(labels).unwrap();
        let found = SurfaceDescription::new(&surface);
        assert!((found.volume - volume).abs() < 1e-12, "{labels:?}: {found}");
        assert!(found.closed && found.consistently_oriented);
        assert_eq!(
            (found.components, found.euler_number),
            (pieces, 2 * pieces as i64)
        );
        let field = |name: &str| {
            &surface
                .fields
                .iter()
                .find(|f| f.name == name)
                .unwrap()
                .values
        };
        for (v, place) in surface.vertices.iter().enumerate() {
            assert_eq!(*place, mesh.nodes[field("node")[v] as usize]);
            assert_eq!(place.z, field("height")[v]);
        }
    }
}

#[test]
fn region_surface_reports_missing_labels() {
    let mut mesh = labelled_bar();
    let error = mesh.boundary_surface(Some(&[9])).unwrap_err().to_string();
    assert!(error.contains("[9]; available labels: 1, 2, 5"), "{error}");
    mesh.fields.clear();
    let error = mesh.boundary_surface(Some(&[1])).unwrap_err().to_string();
    assert!(error.contains("no cell field \"label\""), "{error}");
    assert!(mesh.boundary_surface(None).is_ok());
}
