//! The pre-integrated table against the exact integral, over random transfer functions.

use crate::render::common::*;
use palpate::generate;
use palpate::render::AbsoluteTransferFunction;
use palpate::render::*;

fn random_transfer(random: &mut Random, density: f64) -> TransferFunction {
    let nodes = |random: &mut Random, n: usize| {
        let mut s: Vec<f64> = (0..n).map(|_| random.unit()).collect();
        s.sort_by(f64::total_cmp);
        s
    };
    let colour = nodes(random, 4)
        .into_iter()
        .map(|s| [s, random.unit(), random.unit(), random.unit()])
        .collect();
    let extinction = nodes(random, 5)
        .into_iter()
        .map(|s| [s, density * random.unit()])
        .collect();
    TransferFunction::new(colour, extinction).unwrap()
}

/// Returns the root mean square and maximum error of look-ups, in 1/255.
fn errors(
    caster: &mut Raycaster,
    truth: &AbsoluteTransferFunction,
    random: &mut Random,
    longest: f64,
) -> (f64, f64) {
    // Realistic segments: the change of the scalar is proportional to the length.
    let segments: Vec<[f64; 3]> = (0..3000)
        .map(|_| {
            let d = longest * random.unit();
            let s = random.unit();
            [s, (s + random.between(-3.0, 3.0) * d).clamp(0.0, 1.0), d]
        })
        .collect();
    let found = caster.sample_table(&segments).unwrap();
    let (mut sum, mut most) = (0.0f64, 0.0f64);
    for (segment, found) in segments.iter().zip(&found) {
        let exact = truth.segment_integral(segment[0], segment[1], segment[2]);
        for k in 0..4 {
            let error = 255.0 * (f64::from(found[k]) - exact[k]).abs();
            sum += error * error;
            most = most.max(error);
        }
    }
    ((sum / (4.0 * segments.len() as f64)).sqrt(), most)
}

#[test]
#[ignore = "long: scripts/test --full"]
fn random_dense_transfer_functions_match_reference() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(5, false).unwrap();
    let scalars: Vec<f64> = mesh.nodes.iter().map(|p| p.x).collect();
    for table in [TableKind::Integrals, TableKind::Sliced, TableKind::Volume] {
        // The same functions for each.
        let mut random = Random::new(11);
        let geometry = Geometry::at_rest(&gpu, &mesh, &scalars).unwrap();
        let options = RaycastOptions {
            table,
            ..Default::default()
        };
        let mut caster =
            Raycaster::with_options(&gpu, geometry, &peers_transfer(), options).unwrap();
        for density in [8.0, 80.0, 800.0] {
            let (mut rms, mut most) = (0.0f64, 0.0f64);
            for _ in 0..4 {
                let transfer = random_transfer(&mut random, density);
                caster.set_transfer(&transfer).unwrap();
                // The diagonal of the cell is the longest edge.
                let (r, m) = errors(
                    &mut caster,
                    &transfer.to_absolute((0.0, 1.0), 1.0),
                    &mut random,
                    0.34,
                );
                (rms, most) = (rms.max(r), most.max(m));
            }
            println!("{table:?} x{density}: rms {rms:.3} most {most:.2}");
            let bound = if table != TableKind::Volume { 0.5 } else { 1.0 };
            assert!(rms < bound, "{table:?}, density {density}: {rms}");
        }
    }
}

#[test]
fn long_segments_match_reference() {
    let gpu = gpu();
    // Segments up to the maximum length of tets.
    let mesh = generate::benchmark_cube(2, false).unwrap();
    let scalars: Vec<f64> = mesh.nodes.iter().map(|p| p.x).collect();
    for table in [TableKind::Integrals, TableKind::Sliced, TableKind::Volume] {
        let geometry = Geometry::at_rest(&gpu, &mesh, &scalars).unwrap();
        let options = RaycastOptions {
            table,
            ..Default::default()
        };
        let mut caster =
            Raycaster::with_options(&gpu, geometry, &peers_transfer(), options).unwrap();
        let truth = peers_transfer().to_absolute((0.0, 1.0), 1.0);
        for d in [0.1, 1.0, 5.0] {
            let found = caster
                .sample_table(&[[0.2, 0.9, d], [0.6, 0.6, d]])
                .unwrap();
            for (found, s) in found.iter().zip([[0.2, 0.9], [0.6, 0.6]]) {
                let exact = truth.segment_integral(s[0], s[1], d);
                let error = (0..4)
                    .map(|k| (f64::from(found[k]) - exact[k]).abs())
                    .fold(0.0, f64::max);
                let bound = 3.0;
                assert!(error < bound / 255.0, "{table:?} {d}: {found:?} {exact:?}");
                assert!((f64::from(found[3]) - exact[3]).abs() < 1.0 / 255.0);
            }
        }
    }
}

#[test]
fn transparent_function_is_invisible_and_wrong_one_detected() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(4, false).unwrap();
    let scalars: Vec<f64> = mesh.nodes.iter().map(|p| p.x).collect();
    let clear = TransferFunction::new(vec![[0.0, 1.0, 1.0, 1.0]], vec![[0.0, 0.0]]).unwrap();
    let geometry = Geometry::at_rest(&gpu, &mesh, &scalars).unwrap();
    let mut caster = Raycaster::new(&gpu, geometry, &clear).unwrap();
    let image = caster
        .image(&peers_camera(), [32, 32], Mode::Composite)
        .unwrap();
    assert!(image.values.iter().all(|v| *v == 0.0));
    caster.set_transfer(&peers_transfer()).unwrap();
    let other = peers_transfer()
        .scale_extinction(1.1)
        .to_absolute((0.0, 1.0), 1.0);
    let (rms, _) = errors(&mut caster, &other, &mut Random::new(3), 0.3);
    assert!(rms > 0.5, "{rms}");
}
