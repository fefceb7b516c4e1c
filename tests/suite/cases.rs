//! Small files of other people whose simulations and pictures once went wrong without a message.

use crate::support::{gpu, real_data};
use palpate::press::{Press, PressOptions};
use palpate::render::Image;
use palpate::scene::{PlannedRun, Scene, Stage};
use std::path::Path;

/// Returns the stage of the case file `name` with the scene entries `more`, if real data is found.
fn case(name: &str, (unit, more): (&str, &str)) -> Option<Stage> {
    let file = real_data(&format!("cases/{name}"))?;
    let text = format!("[mesh]\nfile = '{}'\n{unit}\n{more}", file.display());
    let mut scene = Scene::parse(&text).unwrap();
    // As on the command line, which chooses the load from the number of steps.
    scene.solver.run = Some(PlannedRun {
        steps: 2000,
        draws_frames: false,
    });
    Some(Stage::new(&gpu(), &scene).unwrap_or_else(|e| panic!("{name}: {e}")))
}

/// Runs `steps` steps and returns the largest displacement over the extent.
fn displacement(stage: &mut Stage, steps: u32) -> f64 {
    stage.run(steps, &mut |_| {}).unwrap();
    let report = stage.motion().unwrap().report().unwrap();
    report.max_displacement / report.extent
}

#[test]
fn loaded_bodies_do_not_sleep() {
    // 2,000 steps reach a displacement of 0.12 of the size; far fewer show that it moves on.
    let load = "[solver]\nname = \"symplectic\"";
    if let Some(mut stage) = case("01_sleep_bar_2000_units.vtu", ("", load)) {
        let early = displacement(&mut stage, 100);
        let late = displacement(&mut stage, 100);
        // From rest by a constant force: as the square of the time, and faster as it bends.
        assert!((late / early - 4.66).abs() < 0.05, "{early:e} {late:e}");
        assert!(!stage.motion().unwrap().asleep());
    }
    let implicit = "[solver]\nname = \"implicit\"\ndt = 0.075\nengine = \"cpu\"";
    if let Some(mut stage) = case("02_sleep_skin_0.1mm.vtu", ("unit = \"mm\"", implicit)) {
        // It swings about a displacement of 0.12.
        let moved = displacement(&mut stage, 40);
        assert!((moved / 0.1971 - 1.0).abs() < 0.02, "{moved:e}");
    }
}

#[test]
fn stiff_bar_under_its_weight_has_displacement_and_stress() {
    let run = |young: f64| {
        let more = format!(
            "[material]\nmodel = \"neo-hookean\"\nyoung = {young:e}\n[solver]\nname = \"implicit\"\nengine = \"cpu\"\ndt = 0.05\ngravity = [0, 0, -9.81]\n[picture]\nfield = \"von_mises\"\nsize = [48, 32]"
        );
        let mut stage = case("04_bar_2m.vtu", ("", &more))?;
        let moved = displacement(&mut stage, 60);
        stage.image().unwrap();
        Some((young * moved, stage.field_note().unwrap()))
    };
    let (Some((soft, _)), Some((steel, note))) = (run(1e6), run(2.1e11)) else {
        return;
    };
    // At 10⁶ Pa it bends by a tenth of its length, where displacements are no longer proportional to
    // loads: 1.3 % more.
    assert!((steel / soft - 1.0).abs() < 0.02, "{soft} {steel}");
    assert!((steel / run(1e9).unwrap().0 - 1.0).abs() < 0.001);
    let most: f64 = note
        .split(" to ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next())
        .unwrap()
        .parse()
        .unwrap();
    assert!((most / 7.05e4 - 1.0).abs() < 0.01, "{note}");
}

fn brightest(image: &Image) -> f32 {
    let lit = image.values.chunks(image.channels);
    lit.map(|p| p[..3].iter().sum::<f32>() / 3.0)
        .fold(0.0, f32::max)
}

#[test]
fn thin_and_constant_bodies_are_visible() {
    let small = "[picture]\nsize = [80, 60]";
    if let Some(mut stage) = case("03_black_skin_3mm.vtu", ("", small)) {
        let image = stage.image().unwrap();
        assert!(brightest(&image) > 0.3, "{}", brightest(&image));
    }
    let constant = "[picture]\nsize = [80, 60]\nfield = \"c\"";
    if let Some(mut stage) = case("12_constant_field.vtu", ("", constant)) {
        assert!(brightest(&stage.image().unwrap()) > 0.3);
        let (low, high) = stage.scalar_field().range;
        assert!(
            (0.5 * (low + high) - 0.35).abs() < 1e-6 && high > low,
            "{low} {high}"
        );
    }
}

#[test]
fn body_with_missing_value_is_pressed() {
    let Some(file) = real_data("cases/13_one_nan.vtu") else {
        return;
    };
    let force = |file: &Path| {
        let scene = Scene::parse(&format!("[mesh]\nfile = '{}'", file.display())).unwrap();
        let mut press = Press::new(&gpu(), &scene, &PressOptions::default()).unwrap();
        press.advance().unwrap().unwrap().force_n
    };
    // The same body without its values.
    let folder = tempfile::tempdir().unwrap();
    let bare = folder.path().join("bare.vtu");
    let mut mesh = palpate::io::read(&file).unwrap();
    mesh.fields.clear();
    palpate::io::write(&bare, &mesh).unwrap();
    let (with, without) = (force(&file), force(&bare));
    assert!((with / without - 1.0).abs() < 1e-9, "{with} {without}");
}

#[test]
fn utf16_surface_is_read() {
    if let Some(file) = real_data("cases/23_s_utf16.stl") {
        let surface = palpate::io::read_surface(&file).unwrap();
        assert_eq!(surface.triangles.len(), 12);
        let volume = palpate::mesh::SurfaceDescription::new(&surface).volume;
        assert!((volume - 1.0).abs() < 1e-6, "{volume}");
    }
}

#[test]
fn stiffness_of_zero_is_rejected() {
    let error_of = |material: &str| {
        let text = format!(
            "[mesh]\ngenerate = \"breast\"\ntets = 4000\n[material]\n{material}\n[solver]\nname = \"implicit\""
        );
        let made = Scene::parse(&text).and_then(|scene| Stage::new(&gpu(), &scene));
        made.err().map(|e| e.to_string()).unwrap_or_default()
    };
    let whole = error_of("young = 0");
    assert!(
        whole.contains("must be a finite positive number, got 0"),
        "{whole}"
    );
    let region = "gland = { regions = [\"gland\"], young = 0 }";
    assert!(
        error_of(region).contains("in region"),
        "{}",
        error_of(region)
    );
}
