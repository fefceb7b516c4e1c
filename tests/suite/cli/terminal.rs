//! Terminal output: reports as JSON on standard output, notes and errors on standard error, and no
//! output of other libraries.

use super::bake::sphere;
use super::*;
use serde_json::Value;

/// A bar of elements that falls on its pins, three steps per frame.
const BAR: &str = "[mesh]\ngenerate = \"bar\"\n[material]\nyoung = 2e4\n\
                   [solver]\nname = \"implicit\"\ndt = 0.01\nsteps = 3\n[picture]\nsize = [48, 32]\n";

fn scene(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("bar.toml");
    std::fs::write(&path, text).unwrap();
    path
}

/// Returns the report that a command prints with `--json`, the only output; with `--quiet` standard
/// error is empty.
fn reported(arguments: &[&str]) -> Value {
    let output = palpate(&[arguments, &["--json", "--quiet"]].concat());
    let text = stdout(&output);
    assert_eq!(String::from_utf8_lossy(&output.stderr), "", "{arguments:?}");
    let report: Value = serde_json::from_str(&text).unwrap();
    assert!(report.is_object(), "{text}");
    report
}

fn written(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn close(value: &Value, expected: f64) -> bool {
    value
        .as_f64()
        .is_some_and(|x| (x - expected).abs() <= 1e-9 * expected.abs())
}

/// Returns the lines that do not have the form of Palpate's messages.
fn foreign(stderr: &str) -> Vec<&str> {
    let ours = |line: &&str| !line.starts_with("palpate: ");
    stderr.lines().filter(ours).collect()
}

#[test]
fn stderr_has_only_palpate_lines() {
    let folder = folder("terminal_bare");
    let scene = scene(&folder, BAR);
    let (picture, frames) = (folder.join("bar.png"), folder.join("frames"));
    let bare = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
        command.args(arguments).env_clear();
        // Without the setting that selects a driver there may be none.
        for name in ["VK_ICD_FILENAMES", "VK_DRIVER_FILES", "LD_LIBRARY_PATH"] {
            command.envs(std::env::var_os(name).map(|value| (name, value)));
        }
        command.envs(std::env::var_os("SystemRoot").map(|value| ("SystemRoot", value)));
        let output = command.output().unwrap();
        stdout(&output);
        String::from_utf8(output.stderr).unwrap()
    };
    assert_eq!(bare(&["adapters"]), "");
    let bar = format!("{DATA}/bar.vtu");
    let told = bare(&["render", &bar, "--size", "32x32", "--out", text(&picture)]);
    let wanted = "palpate: no varying scalar field; rendering the depth below the surface\n";
    assert_eq!(told, wanted);
    for arguments in [
        &[
            "render",
            text(&scene),
            "--repeat",
            "1",
            "--out",
            text(&picture),
        ][..],
        &[
            "simulate",
            text(&scene),
            "--frames",
            "1",
            "--out",
            text(&frames),
        ],
    ] {
        let told = bare(arguments);
        assert_eq!(foreign(&told), Vec::<&str>::new(), "{arguments:?}");
    }
}

#[test]
fn foreign_stderr_lines_are_detected() {
    let wayland = "error: XDG_RUNTIME_DIR is invalid or not set in the environment.";
    assert_eq!(foreign(&format!("palpate: a note\n{wayland}\n")), [wayland]);
    assert_eq!(foreign("palpate: a note\npalpate: another\n"), [""; 0]);
}

#[test]
fn quiet_keeps_results_and_errors() {
    let folder = folder("terminal_quiet");
    let knee = format!("{DATA}/knee.nrrd");
    let out = folder.join("knee.vtu");
    let mesh = [
        "mesh",
        &knee,
        "--labels",
        "all",
        "--tets",
        "2000",
        "--out",
        text(&out),
    ];
    let told = palpate(&mesh);
    // A line for each region, with its number of tets.
    let notes = String::from_utf8_lossy(&told.stderr).into_owned();
    let mesh_out = palpate::io::read(&out).unwrap();
    let labels = &mesh_out.region_field().unwrap().values;
    for region in mesh_out.region_names.keys() {
        let tets = labels.iter().filter(|l| **l as i64 == *region).count();
        let line = format!("palpate: region {region}");
        let line = notes.lines().find(|l| l.starts_with(&line)).unwrap();
        assert!(line.contains(&format!(": {tets} tets, ")), "{line} {tets}");
    }
    let quiet = palpate(&[&["-q"][..], &mesh].concat());
    assert_eq!((stdout(&quiet), quiet.stderr), (String::new(), Vec::new()));
    let info = palpate(&["info", text(&out), "--quiet"]);
    assert_eq!(stdout(&info), stdout(&palpate(&["info", text(&out)])));
    let errors = failure(&palpate(&["info", "no_such.vtu", "--quiet"]));
    assert!(errors.starts_with("palpate: no_such.vtu"), "{errors}");
}

#[test]
fn adapters_and_presets_print_json() {
    let adapters = reported(&["adapters"]);
    let list = adapters["adapters"].as_array().unwrap();
    let chosen: Vec<_> = list.iter().filter(|a| a["chosen"] == true).collect();
    assert_eq!(chosen[0]["adapter"], crate::support::gpu().adapter_name());
    assert_eq!(list[0]["index"], 0);
    let presets = reported(&["presets"]);
    let names: Vec<_> = presets["presets"].as_array().unwrap().iter().collect();
    let lines = stdout(&palpate(&["presets"]));
    assert_eq!(names, lines.lines().collect::<Vec<_>>());
    assert!(names.iter().any(|name| **name == "magma"));
}

#[test]
fn mesh_and_convert_print_json() {
    let folder = folder("terminal_mesh");
    let at = |name: &str| text(&folder.join(name)).to_owned();
    let knee = format!("{DATA}/knee.nrrd");
    let (out, msh, lobe) = (at("knee.vtu"), at("knee.msh"), format!("{DATA}/lobe.stl"));
    let report = at("report.json");
    let made = reported(&[
        "mesh", &knee, "--labels", "all", "--tets", "2000", "--out", &out, "--report", &report,
    ]);
    assert_eq!(made, written(Path::new(&report)));
    let mesh = palpate::io::read(&out).unwrap();
    assert_eq!(made["mesher"]["tets"], mesh.tets.len());
    assert_eq!(made["mesher"]["nodes"], mesh.nodes.len());
    let info = reported(&["info", &out]);
    assert_eq!(info["tets"], mesh.tets.len());
    assert_eq!(info["regions"][0]["tets"], made["regions"][0]["tets"]);
    let converted = reported(&["convert", &out, &msh]);
    assert_eq!(converted["output"], msh);
    assert_eq!(converted["tets"], mesh.tets.len());
    assert_eq!(converted["nodes"], mesh.nodes.len());
    let surface = reported(&[
        "mesh",
        &format!("{DATA}/ball.vtu"),
        "--out",
        &at("ball.ply"),
    ]);
    assert_eq!(surface["closed"], true);
    assert_eq!(surface["components"], 1);
    let copied = reported(&["convert", &lobe, &at("lobe.ply")]);
    let read = palpate::io::read_surface(at("lobe.ply")).unwrap();
    assert_eq!(copied["vertices"], read.vertices.len());
    assert_eq!(copied["triangles"], read.triangles.len());
}

#[test]
fn bake_and_compare_print_json() {
    let folder = folder("terminal_bake");
    let at = |name: &str| folder.join(name);
    let (coarse, map, other) = (at("ball.obj"), at("a.png"), at("b.png"));
    sphere(&coarse, 8, true, |_, _| 1.0);
    let (file, report) = (text(&coarse), at("bake.json"));
    let baked = reported(&[
        "bake",
        file,
        file,
        "--size",
        "40x20",
        "--out",
        text(&map),
        "--report",
        text(&report),
    ]);
    assert_eq!(baked, written(&report));
    assert_eq!(baked["missed"], 0);
    let grey = |level: u8, path: &Path| {
        image::RgbImage::from_pixel(8, 8, image::Rgb([level; 3]))
            .save(path)
            .unwrap();
    };
    grey(100, &map);
    grey(101, &other);
    let compared = reported(&["compare", text(&map), text(&other), "--rmse", "2"]);
    // Of the four channels, alpha is equal.
    let rmse = 0.75_f64.sqrt() / 255.0;
    assert!((compared["rmse"].as_f64().unwrap() - rmse).abs() < 1e-6);
    assert!((compared["max"].as_f64().unwrap() - 1.0 / 255.0).abs() < 1e-6);
}

#[test]
fn render_and_simulate_print_json() {
    let folder = folder("terminal_series");
    let scene = scene(&folder, BAR);
    let at = |name: &str| text(&folder.join(name)).to_owned();
    let (picture, report) = (at("bar.png"), at("bar.json"));
    let drawn = reported(&[
        "render",
        text(&scene),
        "--out",
        &picture,
        "--report",
        &report,
    ]);
    assert_eq!(drawn, written(Path::new(&report)));
    assert_eq!(drawn["lost_rays"], 0);
    let made = reported(&[
        "simulate",
        text(&scene),
        "--frames",
        "2",
        "--out",
        &at("made"),
    ]);
    assert_eq!(made["tets"], drawn["tets"]);
    assert_eq!(made["frames"], 3);
    assert!(close(&made["time_s"], 0.06), "{made}");
    let series = folder.join("made/bar.pvd");
    let played = reported(&["simulate", text(&series), "--out", &at("played")]);
    assert_eq!(played["frames"], 3);
    assert_eq!(played["nodes"], made["nodes"]);
    assert!(close(&played["time_s"], 0.06), "{played}");
    // A pick has its own report.
    let two = palpate(&["render", text(&scene), "--pick", "1,1", "--json"]);
    assert_eq!(two.status.code(), Some(2));
}

#[test]
fn press_prints_json() {
    let folder = folder("terminal_press");
    let block = "[mesh]\ngenerate = \"box\"\ntets = 900\n[material]\nyoung = 2e4\n[picture]\nsize = [48, 32]\n";
    let scene = scene(&folder, block);
    let at = |name: &str| folder.join(name);
    let out = at("pressed");
    let pressed = reported(&[
        "press",
        text(&scene),
        "--out",
        text(&out),
        "--depth",
        "0.002",
    ]);
    assert_eq!(pressed, written(&out.join("press.json")));
    assert!(
        (pressed["max_depth_m"].as_f64().unwrap() - 0.002).abs() < 1e-4,
        "{pressed}"
    );
    let out = at("map");
    let map = reported(&[
        "press",
        text(&scene),
        "--map",
        "3x3",
        "--radius",
        "0.025",
        "--out",
        text(&out),
    ]);
    assert_eq!(map, written(&out.join("map.json")));
    assert_eq!(map["grid"], serde_json::json!([3, 3]));
    assert_eq!(map["pressed"], map["points"]);
}

#[test]
fn tune_prints_json() {
    let folder = folder("terminal_tune");
    let still = "[mesh]\ngenerate = \"bar\"\n[picture]\nsize = [48, 32]\n";
    let scene = scene(&folder, still);
    let out = folder.join("tuned.toml");
    let tuned = reported(&["tune", text(&scene), "--error", "5%", "--out", text(&out)]);
    assert_eq!(tuned["met"], true);
    assert_eq!(tuned["motion"], Value::Null);
    assert!(tuned["picture"]["error"].as_f64().unwrap() <= 0.05);
    assert!(out.exists());
}

#[test]
fn warp_prints_json() {
    let folder = folder("terminal_warp");
    let at = |name: &str| text(&folder.join(name)).to_owned();
    let (knee, rest) = (format!("{DATA}/knee.nrrd"), at("rest.vtu"));
    reported(&[
        "mesh", &knee, "--labels", "all", "--tets", "2000", "--out", &rest,
    ]);
    let warped = reported(&[
        "warp",
        &knee,
        "--mesh",
        &rest,
        "--to",
        &rest,
        "--labels",
        "--out",
        &at("same.nrrd"),
    ]);
    let volume = palpate::io::read_volume(&knee).unwrap();
    let [x, y, z] = volume.grid().size;
    assert_eq!(warped["bent"]["voxels"], x * y * z);
    assert_eq!(warped["inverted"], 0);
    assert_eq!(warped["rest"], Value::Null);
}

#[test]
#[ignore = "long: scripts/test --full"]
fn study_prints_json() {
    let folder = folder("terminal_study");
    let scene = scene(&folder, BAR);
    let out = folder.join("study");
    let done = reported(&[
        "study",
        "pictures",
        text(&scene),
        "--quick",
        "--out",
        text(&out),
    ]);
    assert_eq!(done["study"], "pictures");
    assert_eq!(done["ended_early"], false);
    let files = done["files"].as_array().unwrap();
    assert!(files.iter().any(|name| name == "pictures.csv"), "{done}");
}
