//! Light paths with slices and isosurfaces: against float64, and where the light is known.

#![allow(clippy::unwrap_used)]

use super::environment::Environment;
use super::tests::{Body, SIZE, compare, mean, picture, soft, square, white};
use super::*;
use crate::render::scan::{Scan, ScanAppearance};
use crate::render::{Isosurface, Plane, PlaneKind, Sections, TransferFunction};
use crate::volume::{Raw, Volume};
use glam::{DAffine3, DVec3};
use std::sync::Arc;

fn isosurface(value: f64, colour: Option<[f64; 3]>, opacity: f64) -> Isosurface {
    Isosurface {
        value,
        colour,
        opacity,
    }
}

/// A plane through the share `at` of a body's extent.
fn plane(body: &Body, at: f64, normal: DVec3, kind: PlaneKind) -> Plane {
    let (low, high) = body.mesh.bounds();
    Plane {
        point: low + at * (high - low),
        normal,
        kind,
        at_rest: false,
    }
}

fn even(samples: u32) -> PathOptions {
    PathOptions {
        samples,
        environment: Environment::White,
        ..PathOptions::default()
    }
}

/// A camera that sees the middle of a body along z.
fn along_z(body: &Body, share: f64) -> Camera {
    let (low, high) = body.mesh.bounds();
    let middle = 0.5 * (low + high);
    let eye = middle + DVec3::Z * 5.0 * (high.z - low.z);
    Camera::orthographic(eye, middle, DVec3::Y, share * (high.y - low.y))
}

/// A ball with two isosurfaces and two slices, one of them behind a clip plane.
fn sectioned() -> Body {
    let mut body = Body::new("ball", 200, |s| (s - 0.5).length(), soft());
    body.inside = Sections {
        planes: vec![
            plane(&body, 0.55, DVec3::new(0.2, 0.1, 1.0), PlaneKind::Clip),
            plane(&body, 0.5, DVec3::new(0.3, 1.0, 0.4), PlaneKind::Slice(0.7)),
            plane(&body, 0.7, DVec3::new(1.0, 0.1, 0.3), PlaneKind::Slice(1.0)),
        ],
        isosurfaces: vec![
            isosurface(0.4, Some([0.9, 0.5, 0.1]), 0.5),
            isosurface(0.2, None, 1.0),
        ],
        draw_volume: true,
    };
    body
}

#[test]
fn paths_with_slices_and_isosurfaces_match_float64_paths() {
    let body = sectioned();
    let camera = Camera::fit_mesh_in(&body.mesh, SIZE);
    compare(&body, &camera, &even(1), [64]);
    // Lit by skies that are not even, and from inside.
    let studio = PathOptions {
        environment: Environment::Studio,
        ..even(1)
    };
    let (low, high) = body.mesh.bounds();
    let eye = 0.5 * (low + high) + 0.1 * (high - low);
    let inside = Camera::perspective(eye, low, DVec3::Y, 60.0);
    compare(&body, &inside, &studio, [64]);
    // With skins and tools, and flat normals.
    let mut walled = sectioned();
    walled.lit = false;
    let sides = [DVec3::new(0.7, 0.1, 0.5), DVec3::new(0.0, 0.8, 0.1)];
    let walls = square(&walled, DVec3::new(0.2, 0.5, 0.6), sides, 0.6);
    walled.walls.extend(walls);
    compare(&walled, &camera, &even(1), [64]);
}

#[test]
fn paths_in_a_bent_body_without_its_volume_match_float64_paths() {
    let mut body = Body::new("bar", 300, |s| 0.5 * (s.y + s.z), soft()).bent();
    body.inside = Sections {
        planes: vec![
            plane(&body, 0.5, DVec3::new(0.1, 1.0, 0.2), PlaneKind::Slice(0.8)).at_rest(),
            plane(&body, 0.3, DVec3::X, PlaneKind::Slice(1.0)).at_rest(),
            plane(&body, 0.6, DVec3::new(1.0, 0.5, 0.0), PlaneKind::Slice(0.6)),
        ],
        isosurfaces: vec![isosurface(0.6, None, 0.7)],
        draw_volume: false,
    };
    let camera = Camera::fit_mesh_in(&body.mesh, SIZE);
    compare(&body, &camera, &even(1), [64]);
    // Without its isosurface, or with the planes in space, the picture differs.
    let gpu = Gpu::new().unwrap();
    let (truth, errors) = body.reference(&camera, SIZE, &even(64), 64);
    let mut without = body.inside.clone();
    without.isosurfaces.clear();
    let mut in_space = body.inside.clone();
    in_space.planes.iter_mut().for_each(|p| p.at_rest = false);
    let mut caster = body.caster(&gpu);
    for wrong in [without, in_space] {
        caster.set_sections(&wrong).unwrap();
        let found = picture(&mut caster, &camera, SIZE, &even(64));
        let (a, b) = (mean(found.linear()), mean(&truth));
        let differs = (0..4).any(|k| (a[k] - b[k]).abs() > 8.0 * errors[k]);
        assert!(differs, "{a:?} for {b:?} ± {errors:?}");
    }
}

#[test]
fn white_isosurfaces_and_slices_vanish_in_white_surroundings() {
    let gpu = Gpu::new().unwrap();
    let white_one = Some([1.0; 3]);
    for (lit, opacity) in [(true, 1.0), (false, 1.0), (true, 0.5)] {
        let mut body = Body::new("ball", 300, |s| (s - 0.5).length(), white(1.0));
        body.lit = lit;
        let slice = plane(
            &body,
            0.5,
            DVec3::new(1.0, 0.3, 0.4),
            PlaneKind::Slice(opacity),
        );
        body.inside = Sections {
            planes: vec![slice],
            isosurfaces: [0.4, 0.3, 0.2]
                .map(|value| isosurface(value, white_one, opacity))
                .to_vec(),
            draw_volume: false,
        };
        let camera = Camera::fit_mesh_in(&body.mesh, [32, 32]);
        let found = picture(&mut body.caster(&gpu), &camera, [32, 32], &even(512));
        assert_eq!(found.lost(), 0);
        let [light, _, _, seen] = mean(found.linear());
        assert!(seen > 0.3, "{seen}");
        let error = found.noise() / (32.0 * 32.0 * seen).sqrt();
        let ratio = light / seen;
        assert!(error < 0.002, "{error}");
        assert!((ratio - 1.0).abs() < 0.005, "{ratio} ± {error}");
    }
}

#[test]
fn surfaces_let_paths_through_by_their_opacity_and_never_by_rounding() {
    let gpu = Gpu::new().unwrap();
    let size = [96, 96];
    // Many tets, whose faces the rays cross at the surface.
    let mut body = Body::new("box", 20_000, |s| s.z, white(1.0)).bent();
    let camera = along_z(&body, 0.3);
    let mut seen = |values: &[f64], opacity: f64| {
        body.inside.draw_volume = false;
        body.inside.isosurfaces = values
            .iter()
            .map(|value| isosurface(*value, None, opacity))
            .collect();
        let found = picture(&mut body.caster(&gpu), &camera, size, &even(64));
        mean(found.linear())[3]
    };
    assert!((seen(&[0.37], 1.0) - 1.0).abs() < 1e-9);
    let opacity = seen(&[0.37, 0.52, 0.8], 0.3);
    let expected = 1.0 - 0.7f64.powi(3);
    let sigma = (expected * (1.0 - expected) / (64.0 * 96.0 * 96.0)).sqrt();
    assert!(
        (opacity - expected).abs() < 5.0 * sigma,
        "{opacity} for {expected}"
    );
}

/// A body with a scan of one value, which fills it from its lower end to the share `depth` along y.
fn scanned(body: &Body, gpu: &Gpu, depth: f64) -> Raycaster {
    let (low, high) = body.mesh.bounds();
    let extent = (high - low) * DVec3::new(1.0, depth, 1.0);
    let voxel = extent / 8.0;
    let volume = Volume {
        size: [8; 3],
        raw: Raw::I16(vec![100; 512]),
        to_world: DAffine3::from_translation(low + 0.5 * voxel) * DAffine3::from_scale(voxel),
        ..Volume::default()
    };
    let transfer = TransferFunction::new(vec![[100.0, 1.0, 1.0, 1.0]], vec![[100.0, 1.0]]);
    let scan = Scan {
        volume: Arc::new(volume),
        units_per_mm: 1.0,
        appearance: ScanAppearance::Values {
            transfer: transfer.unwrap(),
            range: Some((0.0, 200.0)),
        },
    };
    let mut caster = body.caster(gpu);
    caster.set_scans(&body.mesh, &[scan]).unwrap();
    caster
}

#[test]
fn slices_show_scans() {
    let gpu = Gpu::new().unwrap();
    let mut body = Body::new("box", 300, |s| s.x, soft());
    let slice = plane(&body, 0.5, DVec3::Z, PlaneKind::Slice(1.0));
    body.inside = Sections {
        planes: vec![slice.at_rest()],
        isosurfaces: Vec::new(),
        draw_volume: false,
    };
    let camera = along_z(&body, 0.8);
    // The scan ends in the middle of the picture, and so does the slice.
    let mut caster = scanned(&body, &gpu, 0.5);
    let found = picture(&mut caster, &camera, [64, 64], &even(64));
    let [light, _, _, opacity] = mean(found.linear());
    assert!((opacity - 0.5).abs() < 0.02, "{opacity}");
    assert!(
        (light / opacity - 1.0).abs() < 0.005,
        "{light} of {opacity}"
    );
}

/// Gives a body a scan of two balls that overlap, with 1 in their middles; it ends before the body's
/// upper side along y, and within the second ball.
fn with_balls(mut body: Body) -> Body {
    let (low, high) = body.mesh.bounds();
    let size = [20, 16, 18];
    let extent = (high - low) * DVec3::new(1.0, 0.8, 1.0);
    let voxel = extent / DVec3::from(size.map(|n| n as f64));
    let middles = [DVec3::new(0.35, 0.4, 0.5), DVec3::new(0.65, 0.7, 0.4)];
    let values = (0..size.iter().product()).map(|n| {
        let index = [n % size[0], n / size[0] % size[1], n / size[0] / size[1]];
        let share = DVec3::from(index.map(|i| i as f64 + 0.5)) * voxel / (high - low);
        let near = |middle: DVec3| (1.0 - 2.0 * share.distance(middle)).max(0.0) as f32;
        near(middles[0]).max(near(middles[1]))
    });
    body.scan = Some(Arc::new(Volume {
        size,
        raw: Raw::F32(values.collect()),
        to_world: DAffine3::from_translation(low + 0.5 * voxel) * DAffine3::from_scale(voxel),
        ..Volume::default()
    }));
    body
}

/// Pixels of pictures of which only the mean is compared.
const FINE: [u32; 2] = [48, 48];

/// The standard error of the difference of two means of an opacity, in pictures of this size.
fn error_of_difference(opacity: f64, samples: u32) -> f64 {
    let paths = f64::from(samples * FINE[0] * FINE[1]);
    (2.0 * opacity * (1.0 - opacity) / paths).sqrt()
}

#[test]
fn paths_with_isosurfaces_of_scans_match_float64_paths() {
    let gpu = Gpu::new().unwrap();
    let mut body = with_balls(Body::new("bar", 100, |_| 0.5, soft()).bent());
    body.inside.isosurfaces = vec![
        isosurface(0.45, Some([0.9, 0.5, 0.1]), 0.5),
        isosurface(0.75, None, 1.0),
    ];
    let camera = Camera::fit_mesh_in(&body.mesh, SIZE);
    compare(&body, &camera, &even(1), [64]);
    // With another surface, the picture differs.
    body.inside.draw_volume = false;
    let right = picture(&mut body.caster(&gpu), &camera, FINE, &even(64));
    body.inside.isosurfaces[0].value = 0.6;
    let wrong = picture(&mut body.caster(&gpu), &camera, FINE, &even(64));
    let [.., right] = mean(right.linear());
    let [.., wrong] = mean(wrong.linear());
    let error = error_of_difference(right, 64);
    assert!(right - wrong > 8.0 * error, "{right}, {wrong} ± {error}");
}

#[test]
fn transparent_isosurfaces_of_scans_change_nothing() {
    let gpu = Gpu::new().unwrap();
    let mut body = with_balls(Body::new("bar", 100, |_| 0.5, soft()).bent());
    let camera = Camera::fit_mesh_in(&body.mesh, FINE);
    let without = picture(&mut body.caster(&gpu), &camera, FINE, &even(96));
    body.inside.isosurfaces = [0.2, 0.4, 0.6]
        .map(|value| isosurface(value, None, 0.0))
        .to_vec();
    let found = picture(&mut body.caster(&gpu), &camera, FINE, &even(96));
    assert_eq!(found.lost(), 0);
    let (a, b) = (mean(found.linear()), mean(without.linear()));
    assert!(b[3] > 0.1, "{b:?}");
    let error = error_of_difference(b[3], 96);
    for k in 0..4 {
        assert!(
            (a[k] - b[k]).abs() < 5.0 * error,
            "{a:?} for {b:?} ± {error}"
        );
    }
}
