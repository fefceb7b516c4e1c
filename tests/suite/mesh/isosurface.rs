//! Isosurfaces of volumes of bodies with known measures, and of random ones.

use glam::{DAffine3, DMat3, DVec3};
use palpate::mesh::{SurfaceDescription, TriMesh};
use palpate::volume::{Raw, Volume};
use proptest::prelude::*;
use std::f64::consts::PI;

fn volume(size: [usize; 3], to_world: DAffine3, raw: Raw) -> Volume {
    Volume {
        size,
        raw,
        to_world,
        ..Volume::default()
    }
}

/// Returns a cube of side 8 around the origin, `n` voxels per side, with the values of `f`.
fn cube(n: usize, f: impl Fn(DVec3) -> f64) -> Volume {
    let step = 8.0 / n as f64;
    let to_world = DAffine3::from_scale_rotation_translation(
        DVec3::splat(step),
        glam::DQuat::IDENTITY,
        DVec3::splat(0.5 * step - 4.0),
    );
    let at = |i: usize| {
        to_world.transform_point3(DVec3::from([i % n, i / n % n, i / n / n].map(|i| i as f64)))
    };
    let values = (0..n * n * n).map(|i| f(at(i))).collect();
    volume([n; 3], to_world, Raw::F64(values))
}

/// Describes `surface`, which must be closed, edge-manifold and oriented outward.
fn sound(surface: &TriMesh) -> SurfaceDescription {
    let description = SurfaceDescription::new(surface);
    assert!(
        description.closed && description.consistently_oriented,
        "{description}"
    );
    assert!((0..surface.triangles.len()).all(|t| surface.area_vector(t).length() > 0.0));
    description
}

fn sphere(p: DVec3) -> f64 {
    3.0 - p.length()
}

fn torus(p: DVec3) -> f64 {
    0.9 - (p.truncate().length() - 2.5).hypot(p.z)
}

#[test]
fn isosurfaces_of_spheres_and_tori_converge() {
    type Body = (fn(DVec3) -> f64, f64, f64, i64);
    let bodies: [Body; 2] = [
        (sphere, 4.0 * PI * 9.0, 36.0 * PI, 2),
        (
            torus,
            4.0 * PI * PI * 2.5 * 0.9,
            2.0 * PI * PI * 2.5 * 0.81,
            0,
        ),
    ];
    for (f, area, enclosed, euler) in bodies {
        let errors = [16, 32, 64].map(|n| {
            let surface = cube(n, f).isosurface(0.0, f64::INFINITY).unwrap();
            let found = sound(&surface);
            assert_eq!((found.components, found.euler_number), (1, euler));
            let farthest = surface.vertices.iter().map(|p| f(*p).abs());
            [
                (found.volume / enclosed - 1.0).abs(),
                (found.area / area - 1.0).abs(),
                farthest.fold(0.0, f64::max),
            ]
        });
        for (coarse, fine) in errors.iter().zip(&errors[1..]) {
            for (a, b) in coarse.iter().zip(fine) {
                // Second order would give 4.
                assert!(a / b > 2.8, "{errors:?}");
            }
        }
        assert!(errors[2][0] < 5e-3 && errors[2][1] < 2e-3, "{errors:?}");
    }
}

#[test]
fn isosurface_of_range_includes_inner_boundary() {
    let shell = cube(40, |p| p.length());
    let surface = shell.isosurface(1.5, 3.0).unwrap();
    let found = sound(&surface);
    assert_eq!((found.components, found.euler_number), (2, 4));
    let enclosed = 4.0 / 3.0 * PI * (27.0 - 1.5f64.powi(3));
    assert!((found.volume / enclosed - 1.0).abs() < 0.01);
    // Clipped by the border of the image, the body still has a closed surface there.
    let whole = shell.isosurface(f64::NEG_INFINITY, 100.0).unwrap();
    let found = sound(&whole);
    assert!((found.volume / 512.0 - 1.0).abs() < 1e-3, "{found}");
    assert_eq!(found.bounds, [[-4.0; 3], [4.0; 3]]);
}

#[test]
fn isosurface_supports_mirrored_and_oblique_frames() {
    let axes = DMat3::from_cols(
        DVec3::new(-0.5, 0.1, 0.0),
        DVec3::new(0.2, 0.6, 0.1),
        DVec3::new(0.0, 0.1, 0.7),
    );
    let to_world = DAffine3::from_mat3_translation(axes, DVec3::new(100.0, -20.0, 7.0));
    assert!(axes.determinant() < 0.0);
    let labels = [0, 0, 0, 0, 0, 7, 7, 0, 0, 3, 7, 0, 0, 0, 0, 0].repeat(2);
    let mut labels = volume([4, 4, 2], to_world, Raw::U8(labels));
    let surface = labels.label_surface(&[7, 3]).unwrap();
    let mirrored = sound(&surface);
    assert!(mirrored.volume > 0.0);
    labels.to_world = DAffine3::IDENTITY;
    let straight = sound(&labels.label_surface(&[7, 3]).unwrap());
    let factor = axes.determinant().abs();
    assert!((mirrored.volume / (factor * straight.volume) - 1.0).abs() < 1e-9);
    // Flipped, it would not face outward: the check is effective.
    let mut inward = surface.clone();
    inward.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    assert!(inward.volume() < 0.0);
    let one = sound(&labels.label_surface(&[3]).unwrap());
    // A prism of length 1 on a square of diagonal 1, and half an octahedron on either end.
    assert!((one.volume - (0.5 + 1.0 / 6.0)).abs() < 1e-9, "{one}");
}

#[test]
fn surface_with_missing_triangle_is_open() {
    let mut surface = cube(16, torus).isosurface(0.0, 9.0).unwrap();
    surface.triangles.pop();
    assert!(!SurfaceDescription::new(&surface).closed);
}

#[test]
fn isosurface_rejects_empty_range_and_reports_values() {
    let ball = cube(8, sphere);
    let said = |result: palpate::Result<TriMesh>| result.unwrap_err().to_string();
    assert!(said(ball.isosurface(50.0, 60.0)).contains("values range from"));
    assert!(said(ball.isosurface(2.0, 1.0)).contains("value range 2 to 1"));
    assert!(said(ball.isosurface(f64::NAN, 1.0)).contains("value range NaN to 1"));
    let labels = volume([1, 1, 2], DAffine3::IDENTITY, Raw::U8(vec![4, 6]));
    let message = said(labels.label_surface(&[5]));
    assert!(message.contains("available labels: 4, 6"), "{message}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_field_isosurfaces_are_closed_manifolds(
        size in prop::array::uniform3(1usize..7),
        checkers in 0..3,
        low in 0..4i32,
        values in prop::collection::vec(0..6i32, 216),
    ) {
        let count = size.iter().product();
        let value = |n: usize| {
            let at = [n % size[0], n / size[0] % size[1], n / size[0] / size[1]];
            match checkers {
                // Checkerboards, some of them perturbed: all ambiguous faces and cubes.
                0 => f64::from((at.iter().sum::<usize>() % 2) as i32 * 5),
                1 if values[n] > 0 => f64::from((at.iter().sum::<usize>() % 2) as i32 * 5),
                _ if values[n] == 5 && values[0] == 5 => f64::NAN,
                _ if values[n] == 4 && values[0] == 4 => f64::INFINITY,
                _ => f64::from(values[n]),
            }
        };
        let raw = (0..count).map(value).collect::<Vec<_>>();
        let (low, high) = (f64::from(low), f64::from(low) + 2.0);
        let inside = raw.iter().filter(|v| low <= **v && **v <= high).count();
        let volume = volume(size, DAffine3::IDENTITY, Raw::F64(raw));
        match volume.isosurface(low, high) {
            Err(_) => prop_assert_eq!(inside, 0),
            Ok(surface) => {
                let found = sound(&surface);
                prop_assert!(found.volume > 0.0 && found.volume < 8.0 * inside as f64);
                // The winding number at the centre of every inside voxel is 1.
                let winding = |p: DVec3| -> f64 {
                    let angle = |t: usize| {
                        let [a, b, c] = surface.corners(t).map(|v| (v - p).normalize());
                        let below = 1.0 + a.dot(b) + b.dot(c) + c.dot(a);
                        2.0 * a.dot(b.cross(c)).atan2(below)
                    };
                    (0..surface.triangles.len()).map(angle).sum::<f64>() / (4.0 * PI)
                };
                for n in 0..count {
                    let p = DVec3::from([n % size[0], n / size[0] % size[1], n / size[0] / size[1]].map(|i| i as f64));
                    let is_inside = low <= volume.value(n) && volume.value(n) <= high;
                    prop_assert!((winding(p) - f64::from(u8::from(is_inside))).abs() < 1e-6);
                }
            }
        }
    }
}

#[test]
fn knee_bone_surfaces_match_voxel_volumes() {
    let Some(path) = crate::support::real_data("volumes/knee_labels_dess_384x384x160.nrrd") else {
        return;
    };
    let knee = palpate::io::read_volume(path).unwrap();
    let mut counts: Vec<_> = knee
        .labels()
        .unwrap()
        .into_iter()
        .filter(|l| l.0 != 0)
        .collect();
    counts.sort_by_key(|(_, voxels)| std::cmp::Reverse(*voxels));
    for (label, voxels) in &counts[..2] {
        let surface = knee.label_surface(&[*label]).unwrap();
        let found = sound(&surface);
        let off = found.volume / (*voxels as f64 * knee.voxel_volume()) - 1.0;
        assert!(off.abs() < 0.01, "label {label}: {off}");
        let smooth = surface.smoothed(10);
        assert!((smooth.volume() / found.volume - 1.0).abs() < 0.01);
    }
}
