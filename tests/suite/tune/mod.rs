//! The tuner on scenes not used in its development, against exhaustive searches. Costs are counted
//! in spring evaluations, so they are the same on every machine.

use palpate::gpu::Gpu;
use palpate::mesh::ElementOrder;
use palpate::scene::{AccuracyEntry, OrderChoice, Scene};
use palpate::tune::{
    Body, Candidates, Cost, MotionPoint, MotionSearch, SearchResult, TuneTarget, tune_file,
};
use std::collections::HashMap;
use std::ops::ControlFlow;

const SECONDS: f64 = 0.4;

/// Returns five scenes with their names.
fn scenes() -> Vec<(&'static str, String)> {
    let solver = "[solver]\nname = \"implicit\"\ndt = 0.03\n";
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/data");
    vec![
        (
            "duct",
            format!(
                "[mesh]\ngenerate = \"duct\"\ntets = 900\n[material]\nyoung = 1e4\n{solver}\
                 gravity = [0, 0, -9.81]\n[[pin]]\naxis = \"x\"\nbelow = 0.1\n"
            ),
        ),
        (
            "ball",
            format!(
                "[mesh]\nfile = '{data}/ball.vtu'\nunit = \"m\"\n[material]\nyoung = 3e3\n{solver}\
                 gravity = [0, 0, -9.81]\n[[pin]]\naxis = \"z\"\nabove = 0.8\n"
            ),
        ),
        (
            "bar, twisted",
            format!(
                "[mesh]\ngenerate = \"bar\"\ntets = 900\n[material]\nyoung = 5e4\n{solver}\
                 gravity = [0, 0, 0]\n[[pin]]\naxis = \"x\"\nbelow = 0.05\n\
                 [[force]]\non = {{ axis = \"x\", above = 0.9 }}\ntotal = [0, 0.6, -0.8]\n"
            ),
        ),
        (
            "limb, stiff bones",
            format!(
                "[mesh]\ngenerate = \"limb\"\ntets = 2000\n[material]\nyoung = 5e4\nbone = {{ young = 1e6 }}\n{solver}\
                 gravity = [0, -9.81, 0]\n[[pin]]\naxis = \"x\"\nbelow = 0.1\n"
            ),
        ),
        (
            "cube, pulled",
            format!(
                "[mesh]\ngenerate = \"cube\"\ntets = 900\n[material]\nyoung = 1e4\n{solver}\
                 gravity = [0, 0, 0]\n[[pin]]\naxis = \"z\"\nbelow = 0.05\n\
                 [[force]]\non = {{ axis = \"z\", above = 0.95 }}\ntotal = [40, 0, 0]\n"
            ),
        ),
    ]
}

/// Costs and errors of all candidates, each evaluated once.
struct Table<'a> {
    motions: MotionSearch<'a>,
    costs: HashMap<String, f64>,
    errors: HashMap<String, f64>,
    /// Cost of the evaluations of the current search.
    spent: f64,
}

impl Candidates for Table<'_> {
    type Point = MotionPoint;

    fn points(&self) -> Vec<MotionPoint> {
        self.motions.points()
    }

    fn cost(&mut self, point: &MotionPoint) -> palpate::Result<f64> {
        let key = point.to_string();
        if let Some(known) = self.costs.get(&key) {
            return Ok(*known);
        }
        let cost = self.motions.cost(point)?;
        self.costs.insert(key, cost);
        Ok(cost)
    }

    fn error(&mut self, point: &MotionPoint, _: f64) -> palpate::Result<f64> {
        let cost = self.cost(point)?;
        self.spent += cost;
        let key = point.to_string();
        if let Some(known) = self.errors.get(&key) {
            return Ok(*known);
        }
        let error = self.motions.error(point, f64::INFINITY)?;
        self.errors.insert(key, error);
        Ok(error)
    }
}

/// Returns the lowest cost of a candidate within the tolerance, if any, and the total cost of all.
fn exhaustive(table: &mut Table, tolerance: f64) -> (Option<f64>, f64) {
    let points = table.points();
    let mut best: Option<f64> = None;
    let mut all = 0.0;
    for point in &points {
        let cost = table.cost(point).unwrap();
        if !cost.is_finite() {
            continue;
        }
        all += cost;
        if table.error(point, tolerance).unwrap() <= tolerance {
            best = Some(best.map_or(cost, |b: f64| b.min(cost)));
        }
    }
    (best, all)
}

#[test]
#[ignore = "long: scripts/test --full"]
fn tuned_choice_is_accurate_and_cheap_on_five_scenes() {
    let gpu = Gpu::new().unwrap();
    let mut finest_fails = 0;
    let mut spent_of_all = [0.0; 2];
    let mut chosen_of_all = Vec::new();
    for (name, text) in scenes() {
        let scene = Scene::parse(&text).unwrap();
        let motions =
            MotionSearch::new(&gpu, &scene, SECONDS, Cost::Visits, &palpate::no_progress).unwrap();
        let mut table = Table {
            motions,
            costs: HashMap::new(),
            errors: HashMap::new(),
            spent: 0.0,
        };
        let mut before: Option<SearchResult<MotionPoint>> = None;
        for tolerance in [0.05, 0.15, 0.4] {
            table.spent = 0.0;
            let found =
                SearchResult::cheapest(&mut table, tolerance, &|_| ControlFlow::Continue(()))
                    .unwrap();
            let spent = table.spent;
            let (best, all) = exhaustive(&mut table, tolerance);
            println!(
                "{name} to {tolerance}: {}, cost {:.1} of {best:?}, error {:.4}, tried {:?}, spent {:.3} of all",
                found.point,
                found.cost,
                found.error,
                found.tried,
                spent / all
            );
            assert_eq!(found.met, best.is_some(), "{name} to {tolerance}");
            let Some(best) = best else {
                continue;
            };
            spent_of_all = [spent_of_all[0] + spent, spent_of_all[1] + all];
            assert!(found.error <= tolerance);
            // The error equals that of a separate evaluation of the point.
            let again = table.motions.error(&found.point, f64::INFINITY).unwrap();
            assert!((again / found.error - 1.0).abs() < 1e-3, "{name}: {again}");
            assert!(found.cost <= 1.5 * best, "{name} to {tolerance}: {best}");
            if let Some(tighter) = before.filter(|f| f.met) {
                assert!(found.cost <= tighter.cost, "{name}: looser costs more");
            }
            // The finest candidate alone does not suffice.
            let finest = table
                .points()
                .into_iter()
                .map(|p| table.costs[&p.to_string()])
                .filter(|c| c.is_finite())
                .fold(0.0, f64::max);
            finest_fails += usize::from(finest > 1.5 * best);
            chosen_of_all.push(found.point);
            before = Some(found);
        }
        // No candidate meets a tolerance of zero, and the closest is reported.
        let none =
            SearchResult::cheapest(&mut table, 1e-9, &|_| ControlFlow::Continue(())).unwrap();
        assert!(!none.met && none.error > 1e-9);
        assert!(
            none.summary("motion", "ms", 1e-9)
                .contains("increase the tolerance")
        );
    }
    let [spent, all] = spent_of_all;
    assert!(spent < 0.5 * all, "{spent} of {all}");
    assert!(chosen_of_all.len() >= 8, "{chosen_of_all:?}");
    assert_eq!(finest_fails, chosen_of_all.len());
    // The choice depends on the scene.
    let different: std::collections::HashSet<String> =
        chosen_of_all.iter().map(|p| p.to_string()).collect();
    assert!(different.len() >= 4, "{different:?}");
}

/// The complete tuner, on the current machine: the output file can be read again and meets its
/// statement.
#[test]
#[ignore = "long: scripts/test --full"]
fn tuned_scene_round_trips() {
    let gpu = Gpu::new().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let from = folder.path().join("bar.toml");
    let text = "[mesh]\ngenerate = \"bar\"\ntets = 600\n[material]\nyoung = 5e4\n\
        [solver]\nname = \"implicit\"\ndt = 0.05\nsteps = 4\ngravity = [0, 0, -9.81]\n\
        [[pin]]\naxis = \"x\"\nbelow = 0.05\n[picture]\nsize = [64, 48]\n";
    std::fs::write(&from, text).unwrap();
    let scene = Scene::read(&from).unwrap();
    let wanted = |error: f64, fps: Option<f64>| palpate::tune::TuneTarget {
        error,
        fps,
        seconds: 0.4,
    };
    let tuned =
        palpate::tune::tune(&gpu, &scene, &wanted(0.1, None), &palpate::no_progress).unwrap();
    assert!(tuned.target_met, "{:?}", tuned.notes);
    let to = folder.path().join("tuned.toml");
    tuned.write(&from, &to).unwrap();
    let again = Scene::read(&to).unwrap();
    let point = tuned.motion.as_ref().unwrap().point;
    assert_eq!(again.solver.dt, Some(point.dt));
    assert_eq!(again.material.order, point.order.map(OrderChoice::Exactly));
    let seconds = f64::from(again.solver.steps.unwrap()) * point.dt;
    // As many steps as come closest.
    assert!((seconds - 0.2).abs() <= 0.5001 * point.dt, "{seconds}");
    assert_eq!(again.picture.size, Some(tuned.picture.point.size));
    let mut stage = palpate::scene::Stage::new(&gpu, &again).unwrap();
    stage.run(2, &mut |_| {}).unwrap();
    // An unattainable target is reported.
    let never = wanted(1e-6, Some(1e6));
    let tuned = palpate::tune::tune(&gpu, &scene, &never, &palpate::no_progress).unwrap();
    assert!(!tuned.target_met);
    let message = tuned.notes.join("\n");
    assert!(message.contains("increase the tolerance"), "{message}");
    assert!(message.contains("images per second not met"), "{message}");
    for bad in [0.0, -1.0, f64::NAN] {
        assert!(
            palpate::tune::tune(&gpu, &scene, &wanted(bad, None), &palpate::no_progress).is_err()
        );
    }
}

/// A coarse bar that bends: linear tets are far too stiff at any step.
const BENDING_BAR: &str = "[mesh]\ngenerate = \"bar\"\ntets = 60\n[material]\nyoung = 5e4\npoisson = 0.45\n\
    [solver]\nname = \"implicit\"\ndt = 0.04\nsteps = 4\ngravity = [0, 0, -9.81]\n\
    [[pin]]\naxis = \"x\"\nbelow = 0.05\n[picture]\nsize = [32, 24]\n";

#[test]
fn order_of_elements_is_chosen_and_written() {
    let gpu = crate::support::gpu();
    let folder = tempfile::tempdir().unwrap();
    let [from, to] = ["bar.toml", "tuned.toml"].map(|name| folder.path().join(name));
    std::fs::write(&from, BENDING_BAR).unwrap();
    let scene = Scene::read(&from).unwrap();
    let wanted = TuneTarget {
        error: 0.1,
        fps: None,
        seconds: 0.16,
    };
    let tuned = palpate::tune::tune(&gpu, &scene, &wanted, &palpate::no_progress).unwrap();
    let motion = tuned.motion.as_ref().unwrap();
    assert!(motion.met, "{:?}", tuned.notes);
    let point = motion.point;
    assert_eq!(point.body, Body::Own);
    assert_eq!(point.order, Some(ElementOrder::Quadratic));
    assert!(
        tuned.notes[0].contains("quadratic tets of the mesh"),
        "{:?}",
        tuned.notes
    );
    tuned.write(&from, &to).unwrap();
    let again = Scene::read(&to).unwrap();
    let quadratic = OrderChoice::Exactly(ElementOrder::Quadratic);
    assert_eq!(again.material.order, Some(quadratic));
    assert_eq!(again.material.young, Some(5e4));

    // No candidate of linear tets would have been accurate enough.
    let mut motions =
        MotionSearch::new(&gpu, &scene, 0.16, Cost::Visits, &palpate::no_progress).unwrap();
    let linear = Some(ElementOrder::Linear);
    let (mut least, mut count) = (f64::INFINITY, 0);
    for point in motions.points() {
        if point.order == linear {
            least = least.min(motions.error(&point, f64::INFINITY).unwrap());
            count += 1;
        }
    }
    assert!(count > 20 && least > 0.1, "{least} of {count}");
}

/// A body without order 2 has no choice of it, and its order is not written.
/// The mesh is refined first, for a number at rest; methods are chosen on it by trial.
#[test]
fn mesh_of_scene_with_accuracy_is_refined_first() {
    let folder = tempfile::tempdir().unwrap();
    let [from, to] = ["bar.toml", "tuned.toml"].map(|name| folder.path().join(name));
    let goal = "[accuracy]\nwithin = \"8%\"\n";
    std::fs::write(&from, format!("{BENDING_BAR}{goal}")).unwrap();
    let scene = Scene::read(&from).unwrap();
    let wanted = TuneTarget {
        error: 0.1,
        fps: None,
        seconds: 0.2,
    };
    let mut rounds = Vec::new();
    let tuned = tune_file(
        &crate::support::gpu(),
        &scene,
        &wanted,
        (&from, &to),
        &mut |round| rounds.push(round.clone()),
        &palpate::no_progress,
    )
    .unwrap();
    assert!(tuned.target_met, "{:?}", tuned.notes);
    let last = rounds.last().unwrap();
    assert!(last.share().unwrap() <= 0.08, "{rounds:?}");
    let again = Scene::read(&to).unwrap();
    assert_eq!(again.accuracy, AccuracyEntry::default());
    let mesh = palpate::io::read(to.with_extension("vtu")).unwrap();
    assert_eq!(
        (mesh.order.number(), mesh.element_count()),
        (last.order, last.elements)
    );
    let mut stage = palpate::scene::Stage::new(&crate::support::gpu(), &again).unwrap();
    stage.run(2, &mut |_| {}).unwrap();

    // An error that cannot be had is no success.
    let goal = "[accuracy]\nwithin = \"0.01%\"\nmax_tets = 100\n";
    let scene = Scene::parse(&format!("{BENDING_BAR}{goal}")).unwrap();
    let missed = tune_file(
        &crate::support::gpu(),
        &scene,
        &wanted,
        (&from, &to),
        &mut |_| {},
        &palpate::no_progress,
    )
    .unwrap();
    assert!(!missed.target_met);
    let notes = missed.notes.join("\n");
    assert!(notes.contains("not as exact as wanted"), "{notes}");
}

#[test]
fn order_is_no_choice_for_springs_and_averaged_volumes() {
    let gpu = crate::support::gpu();
    for setting in ["model = \"springs\"", "volume = \"averaged\""] {
        let text = BENDING_BAR.replace("poisson = 0.45", setting);
        let scene = Scene::parse(&text).unwrap();
        let motions =
            MotionSearch::new(&gpu, &scene, 0.16, Cost::Visits, &palpate::no_progress).unwrap();
        let points = motions.points();
        assert!(points.iter().all(|p| p.order.is_none()), "{setting}");
        let mut tuned = scene.clone();
        points[0].apply(&mut tuned);
        assert_eq!(tuned.material.order, None);
    }
}

/// Mid-edge nodes of a file are simulated by the candidates of order 2 only, and all are posed in the
/// picture.
#[test]
fn ten_node_tets_of_a_file_are_tuned_by_either_order() {
    let gpu = crate::support::gpu();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bar.vtu");
    let mut mesh = palpate::generate::bar([4, 1, 1], glam::DVec3::new(0.4, 0.1, 0.1)).unwrap();
    mesh = mesh.with_mid_edge_nodes().unwrap();
    palpate::io::write(&file, &mesh).unwrap();
    let generated = "generate = \"bar\"\ntets = 60\n";
    let text = BENDING_BAR.replace(
        generated,
        &format!("file = '{}'\nunit = \"m\"\n", file.display()),
    );
    let scene = Scene::parse(&text).unwrap();
    let mut motions =
        MotionSearch::new(&gpu, &scene, 0.16, Cost::Visits, &palpate::no_progress).unwrap();
    let end = motions.final_reference();
    assert_eq!(end.len(), mesh.nodes.len());
    let [mut linear, mut quadratic] = [f64::INFINITY; 2];
    for point in motions.points() {
        if point.body != Body::Own {
            continue;
        }
        let least = match point.order {
            Some(ElementOrder::Quadratic) => &mut quadratic,
            _ => &mut linear,
        };
        *least = least.min(motions.error(&point, f64::INFINITY).unwrap());
    }
    assert!(quadratic < 0.02 && linear > 0.05, "{quadratic} {linear}");
}
