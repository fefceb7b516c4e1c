//! Derivatives of predicted numbers against central differences, and twins.
#![allow(clippy::unwrap_used)]

use super::forward::PressedBody;
use super::*;
use crate::no_progress;
use glam::DVec3;

/// Two tissues, one above the other, solved to the last digits.
const LAYERS: &str = "[mesh]\ngenerate = \"box\"\ntets = 600\n[material]\nyoung = 2e4\npoisson = 0.4\n\
    [solver]\nname = \"implicit\"\nengine = \"cpu\"\ntolerance = 1e-10\n";

fn unknowns(names: &[&str]) -> Vec<Unknown> {
    let all = names.iter().map(|name| Unknown::parse(name).unwrap());
    all.collect::<Vec<_>>().concat()
}

fn options(names: &[&str]) -> IdentifyOptions {
    IdentifyOptions {
        unknowns: unknowns(names),
        noise: Some(0.01),
        starts: 1,
        advise: false,
    }
}

fn gpu() -> Gpu {
    Gpu::new().unwrap()
}

/// A curve with forces that are not compared, and a map of two points.
fn data() -> Vec<Experiment> {
    let down = DVec3::NEG_Z;
    let place = (DVec3::new(0.05, 0.05, 0.1), down, 0.03);
    let curve = Experiment::curve("curve", place, &[[0.004, 0.2], [0.008, 0.5]]).unwrap();
    let points = [
        (DVec3::new(0.04, 0.05, 0.1), 90.0),
        (DVec3::new(0.06, 0.06, 0.1), 80.0),
    ];
    let map = Experiment::map("map", (down, 0.03, 0.008), &points).unwrap();
    vec![curve, map]
}

/// The largest difference of derivatives from central differences of fourth order, over the largest
/// derivative of each unknown.
fn derivative_error(names: &[&str], values: &[f64], step: f64) -> f64 {
    let gpu = gpu();
    let scene = Scene::parse(LAYERS).unwrap();
    let body = PressedBody::new(&gpu, &scene, &data(), &options(names)).unwrap();
    let found = body.predict(values, &no_progress).unwrap();
    let mut worst = 0.0f64;
    for k in 0..values.len() {
        let h = step * values[k];
        let at = |by: f64| {
            let mut other = values.to_vec();
            other[k] += by * h;
            body.predict(&other, &no_progress).unwrap().numbers
        };
        let [a, b, c, d] = [at(-2.0), at(-1.0), at(1.0), at(2.0)];
        let largest = found
            .slopes
            .iter()
            .map(|row| row[k].abs())
            .fold(0.0, f64::max);
        assert!(largest > 0.0, "{}", body.unknowns()[k].name);
        for (i, row) in found.slopes.iter().enumerate() {
            let difference = (8.0 * (c[i] - b[i]) - (d[i] - a[i])) / (12.0 * h);
            worst = worst.max((row[k] - difference).abs() / largest);
        }
    }
    worst
}

/// The stiffness of the contact barrier follows the moduli, which the adjoint method leaves out; at a fixed
/// barrier both agree to 1e-6 (`gradients_under_tools_match_differences`).
#[test]
fn derivatives_match_differences() {
    let names = ["material.young", "material.poisson"];
    let error = derivative_error(&names, &[2e4, 0.4], 1e-3);
    println!("material: {error:.1e}");
    assert!(error < 1e-5, "{error}");
}

/// A lump changes the stiffness of elements smoothly but for kinks.
#[test]
fn derivatives_by_lump_match_differences() {
    let values = [2e4, 0.052, 0.047, 0.071, 0.03, 4.0];
    let error = derivative_error(&["material.young", "lump"], &values, 1e-4);
    println!("lump: {error:.1e}");
    assert!(error < 1e-4, "{error}");
}

/// A stiff ball is found from a map and a curve of a body with one.
#[test]
fn lump_of_twin_is_found() {
    let gpu = gpu();
    let scene = Scene::parse(LAYERS).unwrap();
    let down = DVec3::NEG_Z;
    let place = (DVec3::new(0.05, 0.05, 0.1), down, 0.02);
    let samples = [0.004, 0.006, 0.008, 0.01].map(|depth| [depth, 1.0]);
    let grid = (0..9).map(|k| 0.02 + 0.03 * DVec3::new(f64::from(k % 3), f64::from(k / 3), 0.0));
    let points: Vec<_> = grid.map(|at| (at + 0.08 * DVec3::Z, 1.0)).collect();
    let mut twin = vec![
        Experiment::curve("curve", place, &samples).unwrap(),
        Experiment::map("map", (down, 0.02, 0.008), &points).unwrap(),
    ];
    let wanted = IdentifyOptions {
        noise: Some(0.005),
        ..options(&["material.young", "lump"])
    };
    let truth = [2e4, 0.058, 0.045, 0.075, 0.04, 4.0];
    let body = PressedBody::new(&gpu, &scene, &twin, &wanted).unwrap();
    let measured = body.predict(&truth, &no_progress).unwrap().numbers;
    let mut numbers = measured.iter();
    for place in twin
        .iter_mut()
        .flat_map(|experiment| &mut experiment.places)
    {
        for observed in &mut place.observed {
            observed.value = *numbers.next().unwrap();
            observed.scale = observed.value;
        }
    }
    let mut misfits = Vec::new();
    let mut on_step = |step: &IdentifyStep| {
        println!("{step:?}");
        misfits.push(step.misfit);
        Ok(())
    };
    let found = identify(&gpu, &scene, &twin, &wanted, &mut on_step, &no_progress).unwrap();
    println!("{}", found.sentences.join("\n"));
    assert!(
        found.misfit < 0.1 && found.misfit < 0.01 * misfits[0],
        "{misfits:?}"
    );
    assert!(!found.is_misfit);
    for (value, truth) in found.unknowns.iter().zip(truth) {
        assert!(
            (value.low..=value.high).contains(&truth),
            "{value:?} {truth}"
        );
    }
    let depth = &found.unknowns[3];
    assert!((depth.value - 0.075).abs() < 0.002, "{depth:?}");
}

/// Fewer numbers than unknowns, data of another body, and depths in millimetres.
#[test]
fn unsuited_data_are_rejected() {
    let gpu = gpu();
    let scene = Scene::parse(LAYERS).unwrap();
    let refused = |data: &[Experiment], names: &[&str]| {
        let found = identify(
            &gpu,
            &scene,
            data,
            &options(names),
            &mut |_| Ok(()),
            &no_progress,
        );
        found.unwrap_err().to_string()
    };
    let why = refused(&data(), &["material.young", "lump"]);
    assert!(
        why.contains("4 measured numbers do not determine 6"),
        "{why}"
    );
    let down = DVec3::NEG_Z;
    let far = (DVec3::new(0.5, 0.05, 0.1), down, 0.02);
    let far = Experiment::curve("far", far, &[[0.001, 0.1], [0.002, 0.3]]).unwrap();
    let why = refused(&[far], &["material.young"]);
    assert!(why.contains("another body"), "{why}");
    let deep = (DVec3::new(0.05, 0.05, 0.1), down, 0.02);
    let deep = Experiment::curve("deep", deep, &[[1.0, 0.1], [2.0, 0.3]]).unwrap();
    let why = refused(&[deep], &["material.young"]);
    assert!(why.contains("in metres"), "{why}");
    let why = refused(&[], &["material.young"]);
    assert!(why.contains("no data"), "{why}");
    let why = refused(&data(), &["material.bone.young"]);
    assert!(why.contains("has no tissue \"bone\""), "{why}");
    let place = (DVec3::new(0.05, 0.05, 0.1), down, 0.02);
    for samples in [
        &[][..],
        &[[0.001, 0.0]],
        &[[0.001, f64::NAN]],
        &[[-1.0, 2.0]],
    ] {
        assert!(Experiment::curve("wrong", place, samples).is_err());
    }
}
