//! Derivatives of swings against central differences.

use super::super::forward::{BodyExperimentKind, Prediction};
use super::super::recorded_body::RecordedBody;
use super::*;
use web_time::Instant;

/// Period and amplitude ratio of a swing, by all on which they depend: through the motion, its start and the
/// rest position.
#[test]
fn derivatives_of_swing_match_differences() {
    let folder = tempfile::tempdir().unwrap();
    let [_, swing] = record(folder.path());
    let gpu = gpu();
    let exact = BEAM.replace("dt = 0.0025", "dt = 0.0025\ntolerance = 1e-12");
    let scene = Scene::parse(&exact).unwrap();
    let data = Experiment::read(&swing).unwrap();
    let names = [
        "material.young",
        "material.damping_ratio",
        "material.density",
        "material.poisson",
        "gravity.z",
    ];
    let values = [1.02e5, 0.08, 980.0, 0.41, -9.7];
    let body = MeasuredBody::new(&gpu, &scene, &data, &options(&names)).unwrap();
    let (found, alone) = timed(&body, &values);
    assert_eq!((found.numbers.len(), found.slopes[0].len()), (2, 5));
    // Steps of gradients are solved to more digits, and in double precision.
    for (found, alone) in found.numbers.iter().zip(alone) {
        assert!((found / alone - 1.0).abs() < 1e-3, "{found} {alone}");
    }
    let mut worst = [0.0f64; 2];
    for k in 0..values.len() {
        // Longer ones move a lowest point to another row.
        let h = 1e-3 * values[k];
        let at = |by: f64| {
            let mut other = values;
            other[k] += by * h;
            by_adjoint(&body, &other).numbers
        };
        let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(at);
        for (i, row) in found.slopes.iter().enumerate() {
            let difference = (8.0 * (c[i] - b[i]) - (d[i] - a[i])) / (12.0 * h);
            let scale = difference
                .abs()
                .max(0.3 * found.numbers[i] / values[k].abs());
            let [off, wrong] = [1.0, 1.0001].map(|f| (f * row[k] - difference).abs() / scale);
            println!("{} {}: {} {difference} {off:.1e}", names[k], i, row[k]);
            worst = [worst[0].max(off), worst[1].max(wrong)];
        }
    }
    // Damping has kinks, where an eigenvalue of an element changes its sign.
    assert!(worst[0] < 4e-6 && worst[1] > 5e-5, "{worst:?}");
}

/// As above, of quadratic tets and by the modulus only.
#[test]
fn derivative_of_swing_of_quadratic_tets_matches_difference() {
    let folder = tempfile::tempdir().unwrap();
    let [_, swing] = record(folder.path());
    let gpu = gpu();
    let exact = BEAM
        .replace("dt = 0.0025", "dt = 0.0025\ntolerance = 1e-12")
        .replace("order = 1", "order = 2")
        .replace("tets = 80", "tets = 20");
    let scene = Scene::parse(&exact).unwrap();
    let data = Experiment::read(&swing).unwrap();
    let body = MeasuredBody::new(&gpu, &scene, &data, &options(&["material.young"])).unwrap();
    let (young, h) = (6e4, 30.0);
    let (found, _) = timed(&body, &[young]);
    let [down, up] = [-h, h].map(|h| by_adjoint(&body, &[young + h]).numbers);
    for (i, row) in found.slopes.iter().enumerate() {
        let difference = (up[i] - down[i]) / (2.0 * h);
        let scale = difference.abs().max(0.3 * found.numbers[i] / young);
        let [off, wrong] = [1.0, 1.01].map(|f| (f * row[0] - difference).abs() / scale);
        println!("{i}: {} {difference} {off:.1e}", row[0]);
        assert!(off < 2e-4 && wrong > 5e-4, "{off} {wrong}");
    }
}

/// Returns a swing with its derivatives, and its numbers alone; prints how long each takes.
fn timed(body: &MeasuredBody, values: &[f64]) -> (Prediction, Vec<f64>) {
    let clock = Instant::now();
    let found = by_adjoint(body, values);
    let with_slopes = clock.elapsed();
    let clock = Instant::now();
    let alone = predicted_swing(body, values);
    let forward = clock.elapsed();
    println!("forward {forward:?}, with derivatives {with_slopes:?}");
    (found, alone)
}

/// The only experiment, a swing.
fn swing_of<'a>(body: &'a MeasuredBody) -> &'a RecordedBody {
    match &body.experiments[0].kind {
        BodyExperimentKind::Recorded(recorded) => recorded,
        BodyExperimentKind::Presses(_) => panic!("no recording"),
    }
}

fn by_adjoint(body: &MeasuredBody, values: &[f64]) -> Prediction {
    body.predict_swing_by_adjoint(swing_of(body), values, &no_progress)
        .unwrap()
}

/// The numbers of the swing, without derivatives.
fn predicted_swing(body: &MeasuredBody, values: &[f64]) -> Vec<f64> {
    let (scene, mesh) = body.with_values(values);
    swing_of(body)
        .swing((body.gpu, &scene, &mesh), 1, &no_progress)
        .unwrap()
}
