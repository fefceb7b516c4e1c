//! Meshes that people take for granted, on which presses are far off: each is refused, or its bar says
//! so.

use crate::press::pressed;
use crate::support::real_data;
use palpate::no_progress;
use palpate::press::{PressOptions, PressReport};
use palpate::scene::Scene;

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
