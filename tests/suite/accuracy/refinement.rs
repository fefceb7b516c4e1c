//! Bodies at rest on meshes refined until a number is as exact as wanted.

use crate::support::gpu;
use palpate::accuracy::Round;
use palpate::scene::{Scene, Stage};
use std::ops::ControlFlow;

/// A bar that sags to rest on two supports, with regions and a rigid end.
const BAR: &str = r#"
[mesh]
generate = "bar"
tets = 320
[material]
young = 1e5
poisson = 0.45
[solver]
name = "implicit"
engine = "cpu"
dt = 100
steps = 2
tolerance = 1e-4
[[pin]]
name = "left"
axis = "x"
below = 0.01
[[force]]
on = { axis = "x", above = 0.99 }
total = [0.0, 0.0, -1.0]
[picture]
size = [48, 32]
"#;

/// Refines a bar; returns its stage, the rounds, and why the goal was missed.
fn refined(more: &str, tets: &str) -> palpate::Result<(Stage, Vec<Round>, Option<String>)> {
    let text = format!("{}{more}", BAR.replace("tets = 320", tets));
    let scene = Scene::parse(&text)?;
    let mut rounds = Vec::new();
    let mut on_round = |round: &Round| rounds.push(round.clone());
    let goes_on = |_: &str, _: f64| ControlFlow::Continue(());
    let (stage, missed) = Stage::refined(&gpu(), &scene, &mut on_round, &goes_on)?;
    Ok((stage, rounds, missed))
}

#[test]
fn sagging_bar_is_within_its_error() {
    let of =
        |name: &str, within: &str| format!("[accuracy]\nwithin = \"{within}\"\nof = \"{name}\"\n");
    for name in ["displacement", "energy"] {
        let (_, fine, missed) = refined(&of(name, "0.1%"), "tets = 2500").unwrap();
        assert!(missed.is_none(), "{missed:?}");
        let truth = fine.last().unwrap().value;
        let (stage, rounds, missed) = refined(&of(name, "2%"), "tets = 320").unwrap();
        assert!(missed.is_none(), "{missed:?}");
        let last = rounds.last().unwrap();
        assert!(
            last.share().unwrap() <= 0.02 && last.order == 2,
            "{rounds:?}"
        );
        assert_eq!(stage.mesh().element_count(), last.elements);
        for round in &rounds[1..] {
            let off = (round.value - truth).abs();
            assert!(off <= round.error.unwrap(), "{name}: {round:?} {truth}");
        }
        // Linear tets of the first mesh are far off.
        assert!(
            (rounds[0].value / truth - 1.0).abs() > 0.2,
            "{rounds:?} {truth}"
        );
    }
}

#[test]
fn force_on_pin_needs_no_refinement() {
    // It balances the loads on any mesh.
    let (_, rounds, missed) =
        refined("[accuracy]\nwithin = \"1%\"\nof = \"left\"\n", "tets = 320").unwrap();
    assert!(missed.is_none() && rounds.len() == 2, "{rounds:?}");
}

#[test]
fn goals_that_cannot_be_met_are_explained() {
    let goal = "[accuracy]\nwithin = \"0.01%\"\nmax_tets = 800\n";
    let (stage, rounds, missed) = refined(goal, "tets = 320").unwrap();
    let why = missed.unwrap();
    assert!(
        why.contains("more than the 800 allowed (--max-tets)"),
        "{why}"
    );
    assert!(rounds.len() > 1 && stage.mesh().element_count() <= 800);
    let error = |more: &str| match refined(more, "tets = 320") {
        Err(error) => error.to_string(),
        Ok((_, rounds, _)) => panic!("{rounds:?}"),
    };
    let unknown = error("[accuracy]\nwithin = \"1%\"\nof = \"middle\"\n");
    assert!(
        unknown.contains("displacement, energy, volume or one of the pins and tools: left"),
        "{unknown}"
    );
    let text = error("[accuracy]\nwithin = \"zero\"\n");
    assert!(text.contains("expected a percentage"), "{text}");
    assert!(error("").contains("--within 2%"));
}
