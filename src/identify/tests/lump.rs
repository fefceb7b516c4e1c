//! A lump: its derivatives, where its search starts, and a twin.

use super::*;

/// Derivatives by the place, the size and the contrast of a lump.
#[test]
fn derivatives_by_lump_match_differences() {
    let values = [2e4, 0.052, 0.047, 0.071, 0.03, 4.0];
    // Longer steps pass kinks, where the lump begins to reach an element; shorter ones magnify the error of the
    // solver.
    let [error, wrong] = derivative_errors(&["material.young", "lump"], &values, 4e-4);
    println!("lump: {error:.1e}, {wrong:.1e}");
    assert!(error < 1e-6 && wrong > 5e-5, "{error} {wrong}");
}

/// Modulus, middle, diameter and contrast of the twin.
const TRUTH: [f64; 6] = [2e4, 0.058, 0.045, 0.075, 0.04, 4.0];

/// A map and a curve of the layers with a stiff ball.
fn twin(gpu: &Gpu, scene: &Scene, wanted: &IdentifyOptions) -> Vec<Experiment> {
    let down = DVec3::NEG_Z;
    let place = (DVec3::new(0.05, 0.05, 0.1), down, 0.02);
    let samples = [0.004, 0.006, 0.008, 0.01].map(|depth| [depth, 1.0]);
    let grid = (0..9).map(|k| 0.02 + 0.03 * DVec3::new(f64::from(k % 3), f64::from(k / 3), 0.0));
    let points: Vec<_> = grid.map(|at| (at + 0.08 * DVec3::Z, 1.0)).collect();
    let mut twin = vec![
        Experiment::curve("curve", place, &samples).unwrap(),
        Experiment::map("map", (down, 0.02, 0.008), &points).unwrap(),
    ];
    let body = MeasuredBody::new(gpu, scene, &twin, wanted).unwrap();
    let measured = body.predict(&TRUTH, &no_progress).unwrap().numbers;
    set_measured(&mut twin, &measured);
    twin
}

/// Each diameter gives a start, near the lump and with smaller residuals than a body without one.
#[test]
fn search_starts_at_best_balls() {
    let gpu = gpu();
    let scene = Scene::parse(LAYERS).unwrap();
    let wanted = options(&["material.young", "lump"]);
    let data = twin(&gpu, &scene, &wanted);
    let body = MeasuredBody::new(&gpu, &scene, &data, &wanted).unwrap();
    let without = lump_start::values_without_lump(body.unknowns()).unwrap();
    assert_eq!(without[5], 1.0);
    let model = Model::new(&body, &no_progress);
    let misfit = |start: &Start| model.at(&start.theta).unwrap().misfit();
    let plain = misfit(&Start::at(&without, body.unknowns()));
    let starts = lump_start::starts_at_best_balls(&model, without).unwrap();
    let mut diameters = Vec::new();
    for start in &starts {
        let values = start.values(body.unknowns());
        println!("{values:?}: {:.2}, {plain:.2} without", misfit(start));
        assert!(values[5] > 1.2 && misfit(start) < plain, "{values:?}");
        let aside = (values[1] - TRUTH[1]).hypot(values[2] - TRUTH[2]);
        assert!(aside < 0.015, "{values:?}");
        diameters.push(1e3 * values[4]);
    }
    diameters.sort_by(f64::total_cmp);
    for (found, wanted) in diameters.iter().zip([5.0, 8.0, 13.0, 20.0]) {
        assert!((found - wanted).abs() < 1e-6, "{diameters:?}");
    }
    assert_eq!(diameters.len(), 4);
    // A ball that is given is where the search starts.
    let mut given = wanted;
    for unknown in &mut given.unknowns[1..5] {
        unknown.first = Some(0.05);
    }
    let body = MeasuredBody::new(&gpu, &scene, &data, &given).unwrap();
    assert_eq!(lump_start::values_without_lump(body.unknowns()), None);
}

/// A step leaves a lump stiffer or softer than its surroundings, because a contrast of 1 has no place.
#[test]
fn step_keeps_side_of_contrast() {
    let gpu = gpu();
    let scene = Scene::parse(LAYERS).unwrap();
    let wanted = options(&["material.young", "lump"]);
    let data = twin(&gpu, &scene, &wanted);
    let body = MeasuredBody::new(&gpu, &scene, &data, &wanted).unwrap();
    let model = Model::new(&body, &no_progress);
    for (contrast, change, expected) in [
        (4.0, -3.0, 1.75),
        (0.2, 3.0, 0.8),
        (4.0, 1e-4, 4.0 + 3.02e-4),
    ] {
        let mut values = TRUTH;
        values[5] = contrast;
        let now = model
            .at(&Start::at(&values, body.unknowns()).theta)
            .unwrap();
        let mut changes = nalgebra::DVector::zeros(values.len());
        changes[5] = change;
        let next = Start {
            theta: model.moved(&now, &changes),
        };
        let next = next.values(body.unknowns());
        assert!((next[5] / expected - 1.0).abs() < 1e-7, "{next:?}");
        assert!((next[4] / TRUTH[4] - 1.0).abs() < 1e-9, "{next:?}");
    }
}

/// A stiff ball is found from a map and a curve of a body with one.
#[test]
fn lump_of_twin_is_found() {
    let gpu = gpu();
    let scene = Scene::parse(LAYERS).unwrap();
    let wanted = IdentifyOptions {
        noise: Some(0.005),
        // The best ball of the third diameter.
        first_start: 2,
        ..options(&["material.young", "lump"])
    };
    let twin = twin(&gpu, &scene, &wanted);
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
    for (value, truth) in found.unknowns.iter().zip(TRUTH) {
        assert!(
            (value.low..=value.high).contains(&truth),
            "{value:?} {truth}"
        );
    }
    let depth = &found.unknowns[3];
    assert!((depth.value - 0.075).abs() < 0.002, "{depth:?}");
}
