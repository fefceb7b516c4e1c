//! Forces of linear tets that are corrected by those of quadratic ones.

use super::*;
use crate::accuracy::of_order;
use crate::mesh::ElementOrder;

const BOTH: [&str; 2] = ["material.young", "material.poisson"];

fn linear() -> Scene {
    Scene::parse(&LAYERS.replace(
        "tets = 600\n[material]",
        "tets = 300\n[material]\norder = 1",
    ))
    .unwrap()
}

/// Presses of the body with quadratic tets of this modulus and ratio.
fn twin(gpu: &Gpu, truth: [f64; 2]) -> Vec<Experiment> {
    let scene = of_order(&linear(), ElementOrder::Quadratic);
    let mut twin = data();
    let body = MeasuredBody::new(gpu, &scene, &twin, &options(&BOTH)).unwrap();
    let forces = body.predict_forces(&truth, &no_progress).unwrap();
    let forces: Vec<f64> = forces.into_iter().map(Option::unwrap).collect();
    set_measured(&mut twin, &forces);
    twin
}

/// Returns what is found in a twin with so many corrections, and the last step, after an earlier one.
fn found_in_twin(
    (names, truth): (&[&str], [f64; 2]),
    corrections: u32,
    earlier: Option<&IdentifyStep>,
) -> (Identified, IdentifyStep) {
    let gpu = gpu();
    let wanted = IdentifyOptions {
        corrections,
        earlier: earlier.cloned().into_iter().collect(),
        ..options(names)
    };
    let mut last = None;
    let mut on_step = |step: &IdentifyStep| {
        last = Some(step.clone());
        Ok(())
    };
    let data = twin(&gpu, truth);
    let found = identify(&gpu, &linear(), &data, &wanted, &mut on_step, &no_progress).unwrap();
    println!("{}", found.sentences.join("\n"));
    let last = last.unwrap();
    assert_eq!(last.corrections, corrections);
    (found, last)
}

/// The modulus that quadratic tets have measured is the one that linear tets find with a correction, and not the
/// one that they find without.
#[test]
fn corrected_linear_tets_find_modulus_of_quadratic_ones() {
    let truth = [2.5e4, 0.4];
    let error = |found: &Identified| (found.unknowns[0].value / truth[0] - 1.0).abs();
    let asked = (&BOTH[..1], truth);
    let (without, _) = found_in_twin(asked, 0, None);
    assert!(error(&without) > 0.1, "{}", error(&without));
    assert!(without.correction.is_none());
    let (with, last) = found_in_twin(asked, 1, None);
    assert!(error(&with) < 2e-3, "{}", error(&with));
    let correction = with.correction.unwrap();
    assert_eq!((correction.times, &correction.last_changes), (1, &None));
    // Going on takes the factors that were found.
    let (again, step) = found_in_twin(asked, 1, Some(&last));
    assert_eq!(step.ratios, last.ratios);
    assert!(error(&again) < 2e-3 && step.step >= last.step);
}

/// Factors depend on Poisson's ratio; intervals with corrections hold the values of the twin, and without them
/// residuals say that linear tets do not explain the data.
#[test]
fn second_correction_is_made_at_the_values_found() {
    let truth = [2e4, 0.45];
    let found = |corrections| found_in_twin((&BOTH, truth), corrections, None);
    let [(plain, _), (once, _), (twice, last)] = [0, 1, 2].map(found);
    let said = plain.sentences.join("\n");
    assert!(plain.is_misfit && said.contains("(--correct 2)"), "{said}");
    for corrected in [&once, &twice] {
        assert!(!corrected.is_misfit && corrected.misfit < 0.2 * plain.misfit);
        for (own, truth) in corrected.unknowns.iter().zip(truth) {
            assert!((own.low..=own.high).contains(&truth), "{own:?} {truth}");
        }
    }
    let [first, second] = [&once, &twice].map(|found| found.correction.clone().unwrap());
    assert_ne!(first.ratios, second.ratios);
    let changes = second.last_changes.unwrap();
    for (k, change) in changes.iter().enumerate() {
        let own = twice.unknowns[k].value - once.unknowns[k].value;
        assert!(
            (change - own).abs() < 1e-6 * twice.unknowns[k].value,
            "{change} {own}"
        );
    } // What the last correction changed is not known to a search that goes on after it.
    let (resumed, _) = found_in_twin((&BOTH, truth), 2, Some(&last));
    assert_eq!(resumed.correction.as_ref().unwrap().last_changes, None);
    let said = resumed.sentences.join("\n");
    assert!(
        said.contains("is not known") && said.contains("(--correct 3)"),
        "{said}"
    );
}

/// Quadratic tets, and what has no unknowns, have nothing to correct.
#[test]
fn needless_corrections_are_rejected() {
    let gpu = gpu();
    let refused = |scene: &Scene, names: &[&str]| {
        let wanted = IdentifyOptions {
            corrections: 1,
            ..options(names)
        };
        let found = identify(&gpu, scene, &data(), &wanted, &mut |_| Ok(()), &no_progress);
        found.unwrap_err().to_string()
    };
    let quadratic = of_order(&linear(), ElementOrder::Quadratic);
    let why = refused(&quadratic, &["material.young"]);
    assert!(why.contains("those of quadratic tets"), "{why}");
    let why = refused(&linear(), &[]);
    assert!(why.contains("nothing is identified"), "{why}");
}
