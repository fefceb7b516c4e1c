//! Estimated errors, compared with the numbers in the finer space found another way.

mod closed_forms;
mod coarse_meshes;
mod refinement;
mod slow_motion;

use crate::press::{block, finger, pressed};
use crate::support::gpu;
use palpate::accuracy::RestErrors;
use palpate::mesh::ElementOrder;
use palpate::no_progress;
use palpate::press::{Press, PressOptions};
use palpate::scene::{OrderChoice, Scene, Stage};

/// Converged force of the press of [`press_error_is_difference_to_quadratic_tets`], N: 24,000 and 48,000
/// quadratic tets have 1.425 and 1.417 N.
const CONVERGED_FORCE: f64 = 1.41;

fn press_of(order: ElementOrder) -> Press {
    let mut scene = block("");
    scene.mesh.tets = Some(3000);
    scene.material.order = Some(OrderChoice::Exactly(order));
    let wanted = PressOptions {
        depth: Some(5e-3),
        ..finger()
    };
    pressed(&scene, &wanted)
}

/// The finer space of linear tets is that of quadratic tets on the same mesh: the press there, solved
/// from the linear one, has the force of a press by quadratic tets.
#[test]
fn press_error_is_difference_to_quadratic_tets() {
    let mut linear = press_of(ElementOrder::Linear);
    assert_eq!(linear.report(0.0).max_force_error_n, None);
    linear.estimate_error(&no_progress).unwrap();
    let report = linear.report(0.0);
    let errors = report.error_parts.as_ref().unwrap();
    let quadratic = press_of(ElementOrder::Quadratic).report(0.0);
    let off = errors.finer_max_force_n / quadratic.max_force_n - 1.0;
    assert!(off.abs() < 2e-3, "{off}");
    assert!((report.max_force_n / quadratic.max_force_n - 1.0).abs() > 0.2);
    // The parts are those of the total, and the mesh is by far the largest.
    let parts = errors.max_force_n;
    assert_eq!(report.max_force_error_n, Some(parts.total()));
    let raw = report.max_force_n - errors.finer_max_force_n;
    assert!(parts.mesh >= raw && parts.mesh < 3.0 * raw, "{parts:?}");
    assert!(
        parts.time + parts.solver + parts.contact < 0.02 * parts.mesh,
        "{parts:?}"
    );
    let true_error = (report.max_force_n - CONVERGED_FORCE).abs();
    assert!(parts.total() > true_error, "{parts:?} {true_error}");
    // The curve has errors that grow with depth; the deepest has that of the largest force.
    let load: Vec<f64> = linear
        .samples()
        .iter()
        .filter(|s| s.phase == "load")
        .map(|s| linear.force_error(s).unwrap())
        .collect();
    assert!(load.windows(2).all(|w| w[1] >= w[0]), "{load:?}");
    let deepest = load.last().unwrap();
    assert!((deepest / parts.total() - 1.0).abs() < 1e-12, "{deepest}");
    assert!(report.stiffness_error_n_per_m.unwrap() > 0.0);
    assert!(report.hertz_young_error_pa.unwrap() > 0.0);
}

/// A press that is not valid says why it has no errors.
#[test]
fn press_without_an_estimate_says_why() {
    // A fingertip smaller than the faces.
    let small = PressOptions {
        radius: Some(0.004),
        ..PressOptions::default()
    };
    let mut press = pressed(&block(""), &small);
    press.estimate_error(&no_progress).unwrap();
    let report = press.report(0.0);
    assert!(report.error_parts.is_none() && !report.warnings.is_empty());
    let why = report.no_error_because.unwrap();
    assert!(why.contains("not valid"), "{why}");
}

#[test]
fn cancelled_estimate_is_an_error() {
    let mut press = press_of(ElementOrder::Linear);
    let stop = |_: &str, _: f64| std::ops::ControlFlow::Break(());
    let cancelled = press.estimate_error(&stop);
    assert!(matches!(cancelled, Err(palpate::Error::Cancelled)));
}

/// A block that sags under its weight.
fn sagging(order: u32, more: &str) -> Stage {
    let text = format!(
        "[mesh]\ngenerate = \"box\"\ntets = 750\n[material]\nyoung = 1e4\npoisson = 0.4\norder = {order}\n[solver]\nname = \"implicit\"\nengine = \"cpu\"\ndt = 1\ngravity = [0, 0, -5]\n[[pin]]\naxis = \"x\"\nbelow = 0.01\n{more}"
    );
    let mut stage = Stage::new(&gpu(), &Scene::parse(&text).unwrap()).unwrap();
    stage.run(20, &mut |_| {}).unwrap();
    stage
}

#[test]
fn errors_at_rest_are_differences_to_quadratic_tets() {
    let mut linear = sagging(1, "");
    let report = linear.motion().unwrap().report().unwrap();
    let errors = RestErrors::estimate(&mut linear, &no_progress)
        .unwrap()
        .unwrap();
    let finer = sagging(2, "").motion().unwrap().report().unwrap();
    let pairs = [
        (
            errors.max_displacement,
            report.max_displacement,
            finer.max_displacement,
        ),
        (
            errors.elastic_energy,
            report.energy.elastic,
            finer.energy.elastic,
        ),
    ];
    for (parts, given, finer) in pairs {
        let ratio = parts.mesh / (given - finer).abs();
        assert!(ratio > 0.99 && ratio < 3.0, "{parts:?} {given} {finer}");
        assert!((given / finer - 1.0).abs() > 0.1, "{given} {finer}");
    }
    assert!(errors.volume_ratio.mesh > 0.0);
    // A support carries the weight, whatever the mesh.
    let [pin] = &errors.forces[..] else {
        panic!("{:?}", errors.forces);
    };
    let mass: f64 = linear
        .motion()
        .unwrap()
        .simulator
        .model()
        .unwrap()
        .masses
        .iter()
        .sum();
    assert!(
        (pin.force_n / (5.0 * mass) - 1.0).abs() < 0.02,
        "{pin:?} {mass}"
    );
    assert!(pin.error_n.total() < 0.05 * pin.force_n, "{pin:?}");
    assert_eq!(errors.finer_elements, 750);
}
