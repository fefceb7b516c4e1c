//! End-to-end tests of the command line.

mod bake;
mod bench;
mod book;
mod capabilities;
/// The program's flags module.
#[allow(dead_code)]
#[path = "../../../src/cli/mod.rs"]
mod command_line;
mod convert;
mod docs;
mod errors;
mod film;
mod frames;
mod identify;
mod mesh;
mod pick;
mod pieces;
mod report_keys;
mod resume;
mod scan;
mod shell;
mod terminal;
mod tutorials;
mod warp;

use palpate::render::{Image, ImageDifference};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data");

fn real(file: &str) -> Option<String> {
    let path = crate::support::real_data(file)?;
    Some(path.to_string_lossy().into_owned())
}

fn palpate(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(arguments)
        .output()
        .unwrap()
}

fn stdout(output: &Output) -> String {
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn failure(output: &Output) -> String {
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(!errors.contains("panicked"), "{errors}");
    errors
}

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn info_prints_json_and_text() {
    let limb = format!("{DATA}/limb.vtu");
    let json: serde_json::Value =
        serde_json::from_str(&stdout(&palpate(&["info", &limb, "--json"]))).unwrap();
    let mesh = palpate::io::read(&limb).unwrap();
    assert_eq!(json["nodes"], mesh.nodes.len());
    assert_eq!(json["tets"], mesh.tets.len());
    assert_eq!(json["components"], 1);
    let names: Vec<_> = json["fields"].as_array().unwrap().iter().collect();
    assert_eq!(names.len(), mesh.fields.len());
    let words = stdout(&palpate(&["info", &limb]));
    assert!(
        words.contains("regions          from field \"label\""),
        "{words}"
    );
}

#[test]
fn info_describes_real_heart() {
    let Some(heart) = real("scalar/chaste_heart_decimation.vtu") else {
        return;
    };
    let json: serde_json::Value =
        serde_json::from_str(&stdout(&palpate(&["info", &heart, "--json"]))).unwrap();
    assert_eq!(json["nodes"], 172);
    assert_eq!(json["tets"], 610);
    assert_eq!(json["boundary_faces"], 312);
    assert_eq!(json["components"], 1);
    for key in [
        "volume",
        "bounds",
        "inverted_fixed",
        "degenerate",
        "warnings",
    ] {
        assert!(!json[key].is_null(), "{key}");
    }
    let field = &json["fields"][0];
    assert_eq!(field["name"], "Distance from origin");
    assert_eq!(field["location"], "point");
    assert_eq!(field["components"], 1);
    assert!((field["min"].as_f64().unwrap() - 0.5728).abs() < 1e-4);
    assert!((field["max"].as_f64().unwrap() - 2.0948).abs() < 1e-4);
    let words = stdout(&palpate(&["info", &heart]));
    assert!(words.contains("Distance from origin") && words.contains("1 unused nodes"));
}

#[test]
fn info_rejects_files_without_mesh() {
    let folder = folder("no_mesh");
    let junk = folder.join("junk.vtk");
    std::fs::write(&junk, "not a mesh at all").unwrap();
    for file in [text(&junk), "/no/such/file.vtu", text(&folder)] {
        let errors = failure(&palpate(&["info", file]));
        assert!(errors.contains(file), "{errors}");
    }
    let errors = failure(&palpate(&["render", text(&junk), "--out", "x.png"]));
    assert!(errors.contains("junk.vtk"), "{errors}");
}

#[test]
fn render_simulates_draws_and_reports() {
    draws_moves_and_reports(&format!("{DATA}/limb.vtu"), "m", "8");
}

#[test]
fn render_simulates_draws_and_reports_real_heart() {
    if let Some(heart) = real("scalar/chaste_heart_decimation.vtu") {
        draws_moves_and_reports(&heart, "cm", "40");
    }
}

fn draws_moves_and_reports(mesh: &str, unit: &str, steps: &str) {
    let folder = folder(&format!("render_{unit}"));
    let (picture, report) = (folder.join("body.png"), folder.join("body.json"));
    let moved = folder.join("body.vtu");
    stdout(&palpate(&[
        "render",
        mesh,
        "--mesh-out",
        text(&moved),
        "--out",
        text(&picture),
        "--size",
        "96x64",
        "--solver",
        "implicit",
        "--dt",
        "0.01",
        "--steps",
        steps,
        "--unit",
        unit,
        "--repeat",
        "2",
        "--background",
        "black",
        "--report",
        text(&report),
    ]));
    let drawn = image::open(&picture).unwrap().to_rgb8();
    assert_eq!(drawn.dimensions(), (96, 64));
    assert!(drawn.pixels().filter(|p| p.0 != [0, 0, 0]).count() > 500);
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    for key in [
        "adapter",
        "tets",
        "nodes",
        "frame_ms",
        "step_ms",
        "passes",
        "rays",
        "lost_rays",
        "tets_per_ray",
        "peel_layers",
        "readbacks",
        "cg",
        "energy",
        "volume_ratio",
        "max_displacement",
        "inverted",
    ] {
        assert!(!json[key].is_null(), "{key}: {json}");
    }
    assert_eq!(json["readbacks"], 0);
    assert_eq!(json["lost_rays"], 0);
    assert!(json["frame_ms"].as_f64().unwrap() > 0.0);
    assert!(json["cg"]["iterations"].as_u64().unwrap() > 0);
    // That of the written mesh, and more than 1 % of the size.
    let [rest, moved] = [Path::new(mesh), &moved].map(|file| palpate::io::read(file).unwrap());
    let (low, high) = rest.bounds();
    let size = (high - low).max_element();
    let pairs = rest.nodes.iter().zip(&moved.nodes);
    let farthest = pairs.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    let reported = json["max_displacement"].as_f64().unwrap();
    assert!(farthest > 0.01 * size, "{farthest} of {size}");
    assert!(
        (reported / farthest - 1.0).abs() < 1e-6,
        "{reported} {farthest}"
    );
}

#[test]
fn unstable_step_fails_with_advice_and_picture() {
    let folder = folder("unstable");
    let picture = folder.join("bar.png");
    let scene = folder.join("bar.toml");
    std::fs::write(&scene, "[mesh]\ngenerate = \"bar\"\n").unwrap();
    let run = |dt: &str| {
        palpate(&[
            "render",
            text(&scene),
            "--out",
            text(&picture),
            "--size",
            "64x64",
            "--solver",
            "verlet",
            "--stiffness",
            "3000",
            "--damping",
            "0",
            "--dt",
            dt,
            "--steps",
            "300",
        ])
    };
    let errors = failure(&run("0.01"));
    assert!(errors.contains("verlet failed at step"), "{errors}");
    assert!(
        errors.contains("--dt") && errors.contains("implicit"),
        "{errors}"
    );
    assert!(picture.exists(), "the last valid state is rendered");
    stdout(&run("0.001"));
}

#[test]
fn simulated_series_plays_back_identically() {
    let folder = folder("series");
    let (made, played) = (folder.join("made"), folder.join("played"));
    let scene = folder.join("bar.toml");
    std::fs::write(
        &scene,
        "[mesh]\ngenerate = \"bar\"\n[material]\nyoung = 2e4\n[solver]\nname = \"implicit\"\nsteps = 3\n\
         [camera]\neye = [0.06, -0.4, 0.2]\nlook_at = [0.06, 0.03, 0.0]\nup = [0.0, 0.0, 1.0]\n\
         [picture]\nsize = [64, 64]\nmode = \"surface\"\n",
    )
    .unwrap();
    stdout(&palpate(&[
        "simulate",
        text(&scene),
        "--frames",
        "3",
        "--out",
        text(&made),
    ]));
    let camera = [
        "--eye",
        "0.06,-0.4,0.2",
        "--look-at",
        "0.06,0.03,0",
        "--up",
        "0,0,1",
        "--size",
        "64x64",
        "--mode",
        "surface",
    ];
    let series = made.join("bar.pvd");
    let mut play = vec!["simulate", text(&series), "--out", text(&played)];
    play.extend(camera);
    stdout(&palpate(&play));
    let pictures: Vec<(PathBuf, PathBuf)> = (0..=3)
        .map(|i| format!("bar_{i:04}.png"))
        .map(|name| (made.join(&name), played.join(&name)))
        .collect();
    for (a, b) in &pictures {
        stdout(&palpate(&["compare", text(a), text(b)]));
    }
    // It moved: the first and the last picture differ, and compare reports it.
    let moved = palpate(&["compare", text(&pictures[0].0), text(&pictures[3].0)]);
    assert_eq!(moved.status.code(), Some(1));
    let told = String::from_utf8_lossy(&moved.stdout).into_owned();
    let [first, last] = [0, 3].map(|k: usize| Image::read_for_comparison(&pictures[k].0).unwrap());
    let difference = ImageDifference::between(&first, &last).unwrap();
    assert_eq!(told.trim(), format!("{difference}: different"));
}

#[test]
fn compare_rejects_different_sizes() {
    let folder = folder("sizes");
    let (a, b) = (folder.join("a.png"), folder.join("b.png"));
    image::RgbImage::new(8, 8).save(&a).unwrap();
    image::RgbImage::new(8, 9).save(&b).unwrap();
    let errors = failure(&palpate(&["compare", text(&a), text(&b)]));
    assert!(errors.contains("8 x 9"), "{errors}");
}

/// Each scene runs as it is shipped.
#[test]
#[ignore = "long: scripts/test --full"]
fn shipped_scenes_render() {
    let folder = folder("scenes");
    let mut scenes = 0;
    for entry in std::fs::read_dir(Path::new(DATA).join("scenes")).unwrap() {
        let scene = entry.unwrap().path();
        let picture = folder
            .join(scene.file_name().unwrap())
            .with_extension("png");
        let given = ["render", text(&scene), "--size", "120x120", "--out"];
        stdout(&palpate(&[&given[..], &[text(&picture)]].concat()));
        let pixels = image::open(&picture).unwrap().to_rgb8();
        let seen = pixels
            .pixels()
            .filter(|p| p.0.iter().any(|c| *c > 40))
            .count();
        let name = scene.display();
        assert!(seen > 300, "{name}: {seen} pixels show anything");
        scenes += 1;
    }
    assert!(scenes > 20, "{scenes} scenes ship");
}

#[test]
#[ignore = "long: a press on a refined mesh"]
fn demo_writes_pictures_and_series() {
    let folder = folder("demo");
    let output = palpate(&[
        "demo",
        "--out",
        text(&folder),
        "--tets",
        "4000",
        "--frames",
        "3",
        "--size",
        "96x72",
        "--within",
        "30%",
        "--json",
        "--quiet",
    ]);
    let report: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    assert_eq!(report["frames"], 3);
    let tets = report["tets"].as_u64().unwrap();
    assert!((3000..5000).contains(&tets), "{report}");
    let press = std::fs::read(folder.join("press/press.json")).unwrap();
    let press: serde_json::Value = serde_json::from_slice(&press).unwrap();
    assert_eq!(report["press"], press);
    let [force, error] = ["max_force_n", "max_force_error_n"].map(|k| press[k].as_f64().unwrap());
    assert!(error > 0.0 && error < 0.35 * force, "{press}");
    for file in ["rest.png", "bent.png", "bend.gif", "bend.pvd"] {
        assert!(folder.join(file).exists(), "{file}");
    }
}

/// The API surface is small: ten types suffice for every example.
#[test]
fn examples_import_at_most_ten_types() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    for example in std::fs::read_dir(folder).unwrap() {
        let path = example.unwrap().path();
        if path.extension().is_none_or(|e| e != "rs") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let imports = text.split("use palpate::").skip(1);
        let words = imports.flat_map(|rest| {
            let import = rest.split(';').next().unwrap_or_default();
            import.split(|c: char| !c.is_alphanumeric())
        });
        let types: BTreeSet<&str> = words
            .filter(|w| w.starts_with(|c: char| c.is_uppercase()))
            .collect();
        assert!(
            (1..=10).contains(&types.len()),
            "{}: {types:?}",
            path.display()
        );
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn examples_run() {
    let folder = folder("examples");
    let profile = Path::new(env!("CARGO_BIN_EXE_palpate")).parent().unwrap();
    let built = profile.join("examples");
    let runs: [(&str, &[&str]); 9] = [
        ("quickstart", &[]),
        ("own_device", &[]),
        ("other_engine", &["twist"]),
        ("regression_picture", &[]),
        ("grid_body", &[]),
        ("skin", &[]),
        ("cut", &[]),
        ("pick", &[]),
        ("levels", &[]),
    ];
    for (example, arguments) in runs {
        let output = Command::new(built.join(example))
            .args(arguments)
            .current_dir(&folder)
            .output()
            .unwrap_or_else(|e| panic!("{example}: {e}; `cargo build --examples` makes it"));
        stdout(&output);
    }
    for picture in [
        "quickstart.png",
        "twist/twist_4.png",
        "golden.png",
        "grid_body.png",
        "skin.png",
        "cut.png",
        "pick.png",
        "levels.png",
    ] {
        assert!(folder.join(picture).exists(), "{picture}");
    }
    // The second run compares with the stored picture, and it is equal.
    let again = Command::new(built.join("regression_picture"))
        .current_dir(&folder)
        .output();
    let printed = stdout(&again.unwrap());
    assert!(printed.contains("RMSE 0.000/255"), "{printed}");
    assert!(printed.contains("maximum 0.000/255"), "{printed}");
}
