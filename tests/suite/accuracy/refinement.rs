//! Bodies at rest on meshes refined until a number is as exact as wanted.

use crate::support::gpu;
use glam::DVec3;
use palpate::accuracy::Round;
use palpate::mesh::ElementOrder;
use palpate::scene::{Scene, Stage};
use palpate::{generate, io};
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

/// The converged numbers are those of 64,352 tets, `palpate render bar.toml --within 0.1%` from 2,500.
#[test]
fn sagging_bar_is_within_its_error() {
    for (name, truth) in [("displacement", 0.017466), ("energy", 0.024388)] {
        let goal = format!("[accuracy]\nwithin = \"2%\"\nof = \"{name}\"\n");
        let (stage, rounds, missed) = refined(&goal, "tets = 320").unwrap();
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

/// A body of order 2 has it from the first round: the second one of a body whose order is not set.
#[test]
fn order_of_scene_is_that_of_each_round() {
    let goal = "[accuracy]\nwithin = \"0.01%\"\nmax_tets = 400\n";
    let (_, raised, _) = refined(goal, "tets = 320").unwrap();
    for order in [1, 2] {
        let text = BAR.replace("tets = 320", "tets = 320\n[material]\norder = ORDER");
        let text = text.replace("ORDER\n[material]", &order.to_string());
        let scene = Scene::parse(&format!("{text}{goal}")).unwrap();
        let mut rounds = Vec::new();
        let mut on_round = |round: &Round| rounds.push(round.clone());
        Stage::refined(&gpu(), &scene, &mut on_round, &palpate::no_progress).unwrap();
        let same = &raised[order as usize - 1];
        assert_eq!(
            (rounds[0].order, rounds[0].nodes),
            (order, same.nodes),
            "{rounds:?}"
        );
        assert!((rounds[0].value / same.value - 1.0).abs() < 1e-3);
        assert!(rounds.iter().all(|round| round.order == order));
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

#[test]
fn curved_tets_of_file_stay_curved() {
    let straight = generate::bar([6, 2, 2], DVec3::new(0.3, 0.1, 0.1)).unwrap();
    let mut mesh = straight.with_mid_edge_nodes().unwrap();
    let bend = |p: DVec3| DVec3::new(p.x, p.y, p.z + 0.5 * p.x * p.x);
    mesh.nodes.iter_mut().for_each(|p| *p = bend(*p));
    let file = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("curved_bar.vtu");
    io::write(&file, &mesh).unwrap();
    let source = format!("file = {:?}", file.to_str().unwrap());
    let goal = "[accuracy]\nwithin = \"3%\"\n";
    let text = BAR
        .replace("generate = \"bar\"\n", "")
        .replace("1e5", "1e6");
    let scene = Scene::parse(&format!("{}{goal}", text.replace("tets = 320", &source))).unwrap();
    let mut rounds = Vec::new();
    let mut on_round = |round: &Round| rounds.push(round.clone());
    let goes_on = |_: &str, _: f64| ControlFlow::Continue(());
    let (stage, missed) = Stage::refined(&gpu(), &scene, &mut on_round, &goes_on).unwrap();
    assert!(
        missed.is_none() && rounds.iter().all(|r| r.order == 2),
        "{rounds:?}"
    );
    assert_eq!(rounds[0].elements, straight.tets.len());
    // The boundary of the refined body is that of the curved one, not of its corners.
    let fine = stage.mesh();
    assert_eq!(fine.order, ElementOrder::Quadratic);
    let lowest = |p: &&DVec3| (p.z - 0.5 * p.x * p.x).abs() < 1e-9;
    let (old, new) = fine.nodes.split_at(mesh.nodes.len());
    assert_eq!(old, mesh.nodes);
    assert!(new.iter().filter(lowest).count() > 20);
}
