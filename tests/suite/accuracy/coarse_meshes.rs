//! Meshes that people take for granted, on which presses are far off: each is refused, or its bar says
//! so.

use crate::press::pressed;
use crate::support::{gpu, real_data};
use glam::DVec3;
use palpate::no_progress;
use palpate::press::{InteractiveStage, PressOptions, PressReport};
use palpate::scene::Scene;
use std::path::Path;

fn report(text: &str, wanted: &PressOptions) -> PressReport {
    let mut press = pressed(&Scene::parse(text).unwrap(), wanted);
    press.estimate_error(&no_progress).unwrap();
    press.report(0.0)
}

#[track_caller]
fn assert_refused(report: &PressReport) {
    let why = report.warnings.join("; ");
    assert!(why.contains("smaller than the faces beneath it"), "{why}");
    assert!(why.contains("finer mesh (--tets)"), "{why}");
    assert_eq!(
        (report.stiffness_n_per_m, report.hertz_young_pa),
        (None, None)
    );
    assert_eq!(report.max_force_error_n, None);
}

/// Of 5,000 tets under a fingertip of 8 mm.
#[test]
fn coarse_breast_is_refused() {
    let text = "[mesh]\ngenerate = \"breast\"\ntets = 5000\nlump_mm = 15\ndepth_mm = 10\ncontrast = 5\n[material]\nmodel = \"neo-hookean\"\norder = 1\nstiffness_field = \"stiffness\"\nfat = {}\ngland = [\"gland\", \"lump\"]\nmuscle = {}\n";
    let wanted = PressOptions {
        radius: Some(0.008),
        depth: Some(0.006),
        ..PressOptions::default()
    };
    assert_refused(&report(text, &wanted));
}

/// Of 1,000 tets, the fewest that the generator makes.
#[test]
fn coarse_liver_is_refused() {
    let text = "[mesh]\ngenerate = \"liver\"\ntets = 1000\nlump_mm = 40\n[material]\norder = 1\n";
    assert_refused(&report(text, &PressOptions::default()));
}

/// The ellipsoid of Chaste, by linear tets: quadratic tets of the same mesh, which lie on the same
/// faces, read 4.140 N (`palpate press --order 2`), and the finer space reads the same.
#[test]
fn bar_of_real_ellipsoid_is_as_large_as_its_force() {
    let Some(file) = real_data("tet/chaste_ellipsoid_15811.node") else {
        return;
    };
    let text = format!("[mesh]\nfile = {file:?}\n[material]\norder = 1\n");
    let report = report(&text, &PressOptions::default());
    let error = report.max_force_error_n.unwrap();
    println!("{} N ± {error}", report.max_force_n);
    assert!(error > 0.5 * report.max_force_n);
    let parts = report.error_parts.unwrap();
    assert!((parts.finer_max_force_n / 4.140 - 1.0).abs() < 2e-3);
    assert!(parts.max_force_n.support > 0.0);
}

/// The knee of the viewer, pressed by hand: wherever its curve means nothing, it says so.
#[test]
#[ignore = "long: 40 steps of 50,000 tets"]
fn knee_pressed_deep_by_hand_has_a_problem() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/data/scenes/knee.toml");
    let scene = Scene::read(Path::new(file)).unwrap();
    let mesh = scene.load_mesh(&no_progress).unwrap();
    let made = InteractiveStage::new(&gpu(), &scene, &mesh, None).unwrap();
    let (mut stage, mut fingertip) = (made.stage, made.fingertip.unwrap());
    // The point of the body nearest to the eye.
    let eye = DVec3::from(scene.camera.eye.unwrap());
    fingertip.touch(&mut stage, eye).unwrap();
    let motion = stage.motion_mut().unwrap();
    let mut had_problem = false;
    for (goal, phase) in [(18.0, "load"), (0.0, "unload")] {
        for _ in 0..100 {
            let advanced = fingertip.step_towards(motion, goal, phase).unwrap();
            had_problem |= !advanced || fingertip.problem().is_some();
            let last = fingertip.samples().last().unwrap();
            println!(
                "{:.4} m: {:.1} N, problem: {had_problem}",
                last.depth_m, last.force_n
            );
            // A finger is not pulled.
            assert!(last.force_n > -1e-3 || had_problem, "{last:?}");
            if !advanced || fingertip.depth().unwrap() == goal {
                break;
            }
        }
    }
    assert!(had_problem);
}
