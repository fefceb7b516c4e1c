//! Derivatives of predicted numbers against central differences, and twins.
#![allow(clippy::unwrap_used)]

mod at_rest;
mod correction;
mod friction;
mod lump;
mod swings;

use super::forward::MeasuredBody;
use super::unknown::Kind;
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
        ..IdentifyOptions::default()
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

/// The largest difference of derivatives from central differences of fourth order, over the largest derivative
/// of each unknown; and that of derivatives that are too large by a ten-thousandth.
fn derivative_errors(names: &[&str], values: &[f64], step: f64) -> [f64; 2] {
    let gpu = gpu();
    let scene = Scene::parse(LAYERS).unwrap();
    let body = MeasuredBody::new(&gpu, &scene, &data(), &options(names)).unwrap();
    let found = body.predict(values, &no_progress).unwrap();
    let mut worst = [0.0f64; 2];
    for k in 0..values.len() {
        let h = step * values[k];
        let at = |by: f64| {
            let mut other = values.to_vec();
            other[k] += by * h;
            body.predict(&other, &no_progress).unwrap().numbers
        };
        let [a, b, c, d] = [at(-2.0), at(-1.0), at(1.0), at(2.0)];
        // The components of a place are of one kind.
        let is_place = |k: usize| matches!(body.unknowns()[k].kind, Kind::LumpPosition(_));
        let alike = (0..values.len()).filter(|n| *n == k || (is_place(k) && is_place(*n)));
        let rows = alike.flat_map(|n| found.slopes.iter().map(move |row| row[n].abs()));
        let largest = rows.fold(0.0, f64::max);
        assert!(largest > 0.0, "{}", body.unknowns()[k].name);
        for (i, row) in found.slopes.iter().enumerate() {
            let difference = (8.0 * (c[i] - b[i]) - (d[i] - a[i])) / (12.0 * h);
            for (worst, factor) in worst.iter_mut().zip([1.0, 1.0001]) {
                *worst = worst.max((factor * row[k] - difference).abs() / largest);
            }
        }
    }
    worst
}

/// Derivatives under contact, by all that changes with the moduli: the stiffness of the contact barrier too.
#[test]
fn derivatives_match_differences() {
    let names = ["material.young", "material.poisson"];
    let [error, wrong] = derivative_errors(&names, &[2e4, 0.4], 1e-3);
    println!("material: {error:.1e}, {wrong:.1e}");
    assert!(error < 1e-6 && wrong > 5e-5, "{error} {wrong}");
}

/// Sets the measured numbers of presses, each its own scale of noise.
fn set_measured(presses: &mut [Experiment], measured: &[f64]) {
    let mut numbers = measured.iter();
    let presses = presses
        .iter_mut()
        .map(|experiment| match &mut experiment.kind {
            data::ExperimentKind::Presses(presses) => presses,
            data::ExperimentKind::Recording(_) => unreachable!(),
        });
    for place in presses.flat_map(|presses| &mut presses.places) {
        for observed in &mut place.observed {
            observed.value = *numbers.next().unwrap();
            observed.scale = observed.value;
        }
    }
}

/// Forces are proportional to the modulus, so that the sum of squares is a parabola of it: the ends of its
/// interval by profile likelihood are as far below as above.
#[test]
fn profile_of_modulus_is_its_own() {
    let gpu = gpu();
    let scene = Scene::parse(LAYERS).unwrap();
    let wanted = IdentifyOptions {
        noise: Some(0.5),
        ..options(&["material.young"])
    };
    let body = MeasuredBody::new(&gpu, &scene, &data(), &wanted).unwrap();
    let model = Model::new(&body, &no_progress);
    let from = Start::number(0, body.unknowns());
    let best = least_squares::minimise(&model, &from, &mut |_, _, _| Ok(())).unwrap();
    let uncertainty = uncertainty::Uncertainty::new(&body, &best, wanted.noise, &[0.0; 2]);
    let laplace = uncertainty.reach[0][0];
    assert!((0.3..0.9).contains(&laplace), "{laplace}");
    let found = profile::reach(&model, (&best, 0), &uncertainty).unwrap();
    for (found, sign) in found.into_iter().zip([-1.0, 1.0]) {
        let wanted = (1.0 + sign * laplace).ln().abs();
        println!("{found:.4} {wanted:.4}, {laplace:.4} by Laplace's approximation");
        assert!((found / wanted - 1.0).abs() < 0.04, "{found} {wanted}");
        assert!((laplace / wanted - 1.0).abs() > 0.1, "{laplace} {wanted}");
    }
    // An unknown that is held keeps its value while the other one is adjusted.
    let both = options(&["material.young", "material.poisson"]);
    let body = MeasuredBody::new(&gpu, &scene, &data(), &both).unwrap();
    let model = Model {
        held: Some(1),
        ..Model::new(&body, &no_progress)
    };
    let from = Start::at(&[1e4, 0.3], body.unknowns());
    let held = least_squares::minimise(&model, &from, &mut |_, _, _| Ok(())).unwrap();
    assert!((held.values[1] - 0.3).abs() < 1e-12 && (held.values[0] / 1e4 - 1.0).abs() > 0.01);
}

/// A search that goes on from its last step ends at the same values, without the steps before.
#[test]
fn search_goes_on_from_its_steps() {
    let gpu = gpu();
    let scene = Scene::parse(LAYERS).unwrap();
    let run = |earlier: Vec<IdentifyStep>| {
        let wanted = IdentifyOptions {
            earlier,
            ..options(&["material.young"])
        };
        let mut steps = Vec::new();
        let mut on_step = |step: &IdentifyStep| {
            steps.push(step.clone());
            Ok(())
        };
        let found = identify(&gpu, &scene, &data(), &wanted, &mut on_step, &no_progress);
        (found.unwrap().unknowns[0].value, steps)
    };
    let (value, steps) = run(Vec::new());
    let last = steps.last().unwrap().clone();
    assert!(last.step >= 1);
    let (again, more) = run(vec![last.clone()]);
    assert!((again / value - 1.0).abs() < 1e-4, "{again} {value}");
    assert_eq!((more[0].step, more[0].start), (last.step, 1));
    assert!((more[0].misfit / last.misfit - 1.0).abs() < 1e-9);
    assert!(more.len() <= steps.len());
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
    let profiled = IdentifyOptions {
        profiled: vec!["material.poisson".into()],
        ..options(&["material.young"])
    };
    let why = identify(
        &gpu,
        &scene,
        &data(),
        &profiled,
        &mut |_| Ok(()),
        &no_progress,
    );
    assert!(why.unwrap_err().to_string().contains("(--profile)"));
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

/// A clamped beam with a weight at its tip, coarse enough to swing for seconds in a test.
const BEAM: &str = "[mesh]\ngenerate = \"bar\"\ntets = 80\n[material]\nmodel = \"neo-hookean\"\n\
    young = 1e5\npoisson = 0.4\ndensity = 1000\norder = 1\ndamping_ratio = 0.08\ndamping_hz = 4\n\
    [solver]\nname = \"bdf2\"\nengine = \"cpu\"\ndt = 0.0025\ngravity = [0.0, 0.0, -9.81]\n\
    [[pin]]\naxis = \"x\"\nbelow = 0.001\n";
const WEIGHT: &str = "[[mass]]\non = { x_above = 0.1199, z_above = 0.0599 }\nkg = 0.1\n";

/// Runs the beam from its straight shape until it hangs still, and writes the positions of two markers in
/// millimetres, in a frame whose axes are z, −y and x of the body, and the file that describes them.
fn record(folder: &std::path::Path) -> [std::path::PathBuf; 2] {
    let markers = [DVec3::new(0.12, 0.03, 0.065), DVec3::new(0.12, 0.0, 0.0)];
    let scene = Scene::parse(&format!("{BEAM}{WEIGHT}")).unwrap();
    let mut stage = crate::scene::Stage::new(&gpu(), &scene).unwrap();
    let shares = crate::mesh::BarycentricMap::new(stage.mesh(), &markers).unwrap();
    let mut text = String::from("time_s,a_x_mm,a_y_mm,a_z_mm,b_x_mm,b_y_mm,b_z_mm\n");
    let motion = stage.motion_mut().unwrap();
    motion.set_sleep_allowed(false);
    for row in 0..320 {
        if row > 10 {
            motion.run(4, &mut |_| {}).unwrap();
        }
        let moved = shares.apply(&motion.positions().unwrap()).unwrap();
        text += &format!("{}", 0.01 * f64::from(row));
        for p in moved {
            // The beam's x, y and z are along z, −y and x of the file.
            text += &format!(",{},{},{}", 1e3 * p.z, -1e3 * p.y + 7.0, 1e3 * p.x);
        }
        text += "\n";
    }
    std::fs::write(folder.join("take.csv"), text).unwrap();
    let about = "takes = [\"take.csv\"]\nstraight = [0.0, 0.1]\nat_rest = [3.0, 3.2]\naxes = [\"z\", \"-y\", \"x\"]\n";
    let marked = |name: &str, at: DVec3| {
        format!(
            "[[marker]]\nname = \"{name}\"\nat = [{}, {}, {}]\n",
            at.x, at.y, at.z
        )
    };
    let all = marked("a", markers[0]) + &marked("b", markers[1]) + WEIGHT;
    let files = ["rest.toml", "swing.toml"].map(|name| folder.join(name));
    std::fs::write(&files[0], format!("{about}{all}")).unwrap();
    std::fs::write(&files[1], format!("{about}swing = \"a\"\n{all}")).unwrap();
    files
}

/// Modulus from markers at rest, and modulus and damping from their swing, by files of a recording that
/// another run has written; derivatives against differences.
#[test]
fn recording_of_twin_is_explained() {
    let folder = tempfile::tempdir().unwrap();
    let [rest, swing] = record(folder.path());
    let gpu = gpu();
    let scene = Scene::parse(&BEAM.replace("young = 1e5", "young = 5e4")).unwrap();
    let mut on_step = |step: &IdentifyStep| {
        println!("{step:?}");
        Ok(())
    };
    let at_rest = Experiment::read(&rest).unwrap();
    let wanted = options(&["material.young"]);
    let found = identify(&gpu, &scene, &at_rest, &wanted, &mut on_step, &no_progress).unwrap();
    println!("{}", found.sentences.join("\n"));
    let young = &found.unknowns[0];
    assert!((young.value / 1e5 - 1.0).abs() < 2e-3, "{young:?}");
    assert_eq!(found.residuals.len(), 6);
    // Linear tets in bending are far off, which the interval says.
    assert!(found.discretisation_errors[0].is_some_and(|error| error > 0.3));
    assert!(young.low < 0.7e5 && young.high > 1.3e5, "{young:?}");

    // Density and modulus at rest: only their ratio, but the derivative of each.
    let names = ["material.young", "material.density", "material.poisson"];
    let exact = BEAM.replace("dt = 0.0025", "dt = 0.0025\ntolerance = 1e-10");
    let body = MeasuredBody::new(
        &gpu,
        &Scene::parse(&exact).unwrap(),
        &at_rest,
        &options(&names),
    )
    .unwrap();
    let values = [1e5, 1000.0, 0.4];
    let own = body.predict(&values, &no_progress).unwrap();
    for (k, value) in values.into_iter().enumerate() {
        let at = |by: f64| {
            let mut other = values;
            other[k] += by * value;
            body.predict(&other, &no_progress).unwrap().numbers
        };
        let (low, high) = (at(-1e-4), at(1e-4));
        let largest = own
            .slopes
            .iter()
            .map(|row| row[k].abs())
            .fold(0.0, f64::max);
        let pairs = own.slopes.iter().zip(low.iter().zip(&high));
        let off = pairs.map(|(row, (low, high))| (row[k] - (high - low) / (2e-4 * value)).abs());
        let worst = off.fold(0.0, f64::max) / largest;
        println!("{}: {worst:.1e}", names[k]);
        assert!(worst < 2e-6, "{}: {worst}", names[k]);
    }

    let mut scene = scene;
    scene.material.damping_ratio = Some(0.03);
    let swings = Experiment::read(&swing).unwrap();
    let wanted = IdentifyOptions {
        noise: Some(0.02),
        ..options(&["material.young", "material.damping_ratio"])
    };
    let truth = Scene::parse(BEAM).unwrap();
    let compared = identify(
        &gpu,
        &truth,
        &swings,
        &options(&[]),
        &mut on_step,
        &no_progress,
    );
    let compared = compared.unwrap();
    assert!(compared.unknowns.is_empty() && compared.residuals.len() == 2);
    assert!(
        compared.sentences[0].contains("differ by 0."),
        "{:?}",
        compared.sentences
    );
    // Two numbers of one take determine two unknowns.
    let found = identify(&gpu, &scene, &swings, &wanted, &mut on_step, &no_progress).unwrap();
    println!("{}", found.sentences.join("\n"));
    let [young, damping] = &found.unknowns[..] else {
        panic!("{:?}", found.unknowns);
    };
    assert!((young.value / 1e5 - 1.0).abs() < 0.005, "{young:?}");
    assert!((damping.value / 0.08 - 1.0).abs() < 0.03, "{damping:?}");
    assert!((damping.low..=damping.high).contains(&0.08), "{damping:?}");

    let refused = |what: &str, with: &str, why: &str| {
        let text = std::fs::read_to_string(&rest).unwrap();
        assert!(text.contains(what));
        let file = folder.path().join("wrong.toml");
        std::fs::write(&file, text.replace(what, with)).unwrap();
        let all = Experiment::read(&file).and_then(|data| {
            identify(
                &gpu,
                &scene,
                &data,
                &options(&["material.young"]),
                &mut |_| Ok(()),
                &no_progress,
            )
        });
        let said = all.unwrap_err().to_string();
        assert!(said.contains(why), "{said}");
    };
    refused(
        "at_rest = [3.0, 3.2]",
        "at_rest = [8.0, 9.0]",
        "no row with all markers is between 8 and 9 s",
    );
    refused(
        "at_rest = [3.0, 3.2]",
        "at_rest = [0.0, 0.1]",
        "the markers do not move",
    );
    refused("\"-y\"", "\"y\"", "right-handed");
    refused(
        "name = \"b\"",
        "name = \"c\"",
        "the marker c has no columns",
    );
    refused(
        "straight = [0.0, 0.1]",
        "straight = [0.0, 0.1]\nswing = \"z\"",
        "is no [[marker]]",
    );
    refused("takes = [\"take.csv\"]", "takes = []", "needs `takes`");
}

/// Derivatives by the factors at nodes, and by the place of the fingertip, of presses.
#[test]
fn derivatives_by_factors_and_offsets_match_differences() {
    let gpu = gpu();
    let scene = Scene::parse(LAYERS).unwrap();
    let wanted = options(&["stiffness:cage:60mm", "finger.x"]);
    let body = MeasuredBody::new(&gpu, &scene, &data(), &wanted).unwrap();
    let count = body.unknowns().len();
    assert_eq!(count, 27 + 1);
    let mut values: Vec<f64> = (0..count).map(|k| 1.0 + 0.5 * (k as f64).sin()).collect();
    values[count - 1] = 0.003;
    let own = body.predict(&values, &no_progress).unwrap();
    for k in [13, 27] {
        let h = 1e-3 * values[k];
        let at = |by: f64| {
            let mut other = values.clone();
            other[k] += by * h;
            body.predict(&other, &no_progress).unwrap().numbers
        };
        let (low, high) = (at(-1.0), at(1.0));
        let largest = own
            .slopes
            .iter()
            .map(|row| row[k].abs())
            .fold(0.0, f64::max);
        assert!(largest > 0.0, "{}", body.unknowns()[k].name);
        for (i, row) in own.slopes.iter().enumerate() {
            let difference = (high[i] - low[i]) / (2.0 * h);
            let off = (row[k] - difference).abs() / largest;
            println!("{} {i}: {off:.1e}", body.unknowns()[k].name);
            // Offsets of 2 % of the body and of a thousandth of it: the force is nearly linear.
            let most = if k == count - 1 { 0.2 } else { 2e-5 };
            assert!(off < most, "{} {i}: {off}", body.unknowns()[k].name);
        }
    }
}
