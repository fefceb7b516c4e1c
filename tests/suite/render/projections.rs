//! The largest, least and mean scalar on each ray, against float64.

use crate::render::common::*;
use palpate::gpu::Gpu;
use palpate::mesh::{TetMesh, generate};
use palpate::render::*;

const MODES: [Mode; 3] = [Mode::Maximum, Mode::Minimum, Mode::Mean];

/// What a ray's stretches project to, and over which length.
fn projected(mode: Mode, segments: &[Segment]) -> Option<f64> {
    let ends = segments.iter().flat_map(|s| s.s);
    let length: f64 = segments.iter().map(|s| s.t[1] - s.t[0]).sum();
    let mean = segments
        .iter()
        .map(|s| 0.5 * (s.s[0] + s.s[1]) * (s.t[1] - s.t[0]) / length);
    (length > 0.0).then(|| match mode {
        Mode::Maximum => ends.fold(f64::NEG_INFINITY, f64::max),
        Mode::Minimum => ends.fold(f64::INFINITY, f64::min),
        _ => mean.sum(),
    })
}

/// Root mean square of the differences, of 1, where both the picture and the truth are of a ray
/// well inside; and the share of these pixels.
fn apart(mesh: &TetMesh, mode: Mode, options: RaycastOptions, against: Mode) -> (f64, f64) {
    let gpu = Gpu::new().unwrap();
    let (size, scalars) = ([64, 64], waves(mesh));
    let mut scene = Scene::new(
        &gpu,
        mesh,
        &mesh.nodes,
        &scalars,
        &peers_transfer(),
        options,
    );
    let camera = Camera::framing_for(mesh, size);
    let image = scene.caster.image(&camera, size, mode).unwrap();
    assert_eq!(image.channels, 4);
    let (low, high) = scene.caster.geometry().scalar_range();
    let truth = scene.truth.picture(&camera, size, |reference, ray| {
        projected(against, &reference.segments(ray))
    });
    let (mut sum, mut count, mut met) = (0.0, 0, 0);
    for (pixel, truth) in image.values.chunks_exact(4).zip(truth) {
        let Some(truth) = truth else {
            continue;
        };
        met += 1;
        // A ray along the rim may miss for one of them.
        if pixel[3] == 0.0 {
            continue;
        }
        assert_eq!(pixel[3], 1.0);
        assert!(pixel[0] == pixel[1] && pixel[1] == pixel[2]);
        let grey = (truth - low) / (high - low);
        sum += (f64::from(pixel[0]) - grey).powi(2);
        count += 1;
    }
    assert!(met > 300);
    (
        (sum / f64::from(count)).sqrt(),
        f64::from(count) / f64::from(met),
    )
}

#[test]
fn projections_match_float64() {
    // A duct is left and entered again: projections go on over layers.
    for mesh in [
        generate::by_name("duct", Some(4000)).unwrap(),
        generate::ball(1.0, 5).unwrap(),
    ] {
        for mode in MODES {
            for walk in [Walk::Vertices, Walk::Planes] {
                let options = RaycastOptions {
                    walk,
                    ..Default::default()
                };
                let (rms, seen) = apart(&mesh, mode, options, mode);
                println!("{mode:?} {walk:?}: {rms:.1e} of {seen:.3}");
                assert!(
                    rms < 1e-3 && seen > 0.98,
                    "{mode:?} {walk:?}: {rms}, {seen}"
                );
            }
        }
    }
}

#[test]
fn one_mode_is_none_of_the_others() {
    let mesh = generate::ball(1.0, 5).unwrap();
    for mode in MODES {
        for other in MODES.into_iter().filter(|m| *m != mode) {
            let (rms, _) = apart(&mesh, mode, RaycastOptions::default(), other);
            assert!(rms > 0.02, "{mode:?} is {other:?}: {rms}");
        }
    }
}
