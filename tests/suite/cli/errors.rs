//! Errors that commands report: of reactions, of reports, and as a field.

use super::{failure, folder, palpate, stdout, text};
use palpate::mesh::Location;

/// A bar that sags to rest in long steps on two supports.
const SAGGING: &str = r#"
[mesh]
generate = "bar"
tets = 320
[material]
young = 1e5
poisson = 0.4
order = 1
[solver]
name = "implicit"
engine = "cpu"
dt = 100
steps = 2
tolerance = 1e-4
[[pin]]
name = "left, low"
axis = "x"
below = 0.01
[[pin]]
name = "right"
axis = "x"
above = 0.99
[picture]
size = [48, 32]
"#;

#[test]
fn reactions_at_rest_have_errors_in_last_frame() {
    let here = folder("errors_reactions");
    let scene = here.join("sagging.toml");
    std::fs::write(&scene, SAGGING).unwrap();
    let table = here.join("reactions.csv");
    let run = |more: &[&str]| {
        let given = [
            "simulate",
            text(&scene),
            "--out",
            text(&here),
            "--no-pictures",
        ];
        let frames = ["--frames", "3", "--reactions", text(&table)];
        let output = palpate(&[&given[..], &frames, more].concat());
        let notes = String::from_utf8_lossy(&output.stderr).into_owned();
        stdout(&output);
        (notes, std::fs::read_to_string(&table).unwrap())
    };
    let (notes, rows) = run(&[]);
    assert!(
        notes.contains("force on right at the end: ") && notes.contains(" N ± "),
        "{notes}"
    );
    let mut lines = rows.lines();
    assert!(lines.next().unwrap().ends_with(",force_error_n"));
    let errors: Vec<&str> = lines.map(|line| line.rsplit(',').next().unwrap()).collect();
    assert_eq!(errors.len(), 8);
    assert!(errors[..6].iter().all(|error| error.is_empty()), "{rows}");
    let last = errors[6..]
        .iter()
        .map(|error| error.parse::<f64>().unwrap());
    assert!(last.into_iter().all(|error| error > 0.0), "{rows}");
    // Not asked for.
    let (notes, rows) = run(&["--no-error"]);
    assert!(!notes.contains('±') && rows.lines().skip(1).all(|line| line.ends_with(',')));
    // In motion there are none, which is said.
    let moving = SAGGING.replace("dt = 100", "dt = 0.001");
    std::fs::write(&scene, moving).unwrap();
    let (notes, _) = run(&[]);
    assert!(
        notes.contains("no errors of the reactions: the body is in fast motion"),
        "{notes}"
    );
}

#[test]
fn error_field_shows_coarse_places() {
    let here = folder("errors_field");
    let scene = here.join("sagging.toml");
    std::fs::write(&scene, SAGGING).unwrap();
    let (picture, mesh) = (here.join("error.png"), here.join("error.vtu"));
    let render = |more: &[&str]| {
        let given = [
            "render",
            text(&scene),
            "--field",
            "error",
            "--out",
            text(&picture),
        ];
        palpate(&[&given[..], more].concat())
    };
    let report = here.join("report.json");
    stdout(&render(&[
        "--mesh-out",
        text(&mesh),
        "--report",
        text(&report),
    ]));
    let written = palpate::io::read(&mesh).unwrap();
    let shares = &written.field("error", Location::Cell).unwrap().values;
    assert!((shares.iter().sum::<f64>() - 100.0).abs() < 1e-3);
    // Largest at the supports.
    let (low, high) = written.bounds();
    let length = high.x - low.x;
    let nearest = |x: f64| {
        let middle = |t: usize| written.tet_nodes(t).iter().map(|p| p.x).sum::<f64>() / 4.0;
        let at = (0..shares.len()).filter(|t| (middle(*t) - x).abs() < 0.2 * length);
        let all: Vec<f64> = at.map(|t| shares[t]).collect();
        all.iter().sum::<f64>() / all.len() as f64
    };
    assert!(nearest(low.x) > 2.0 * nearest(0.5 * (low.x + high.x)));
    let shown = palpate::render::Image::read_for_comparison(&picture).unwrap();
    assert_eq!(shown.size, [48, 32]);
    let report: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    assert_eq!(report["errors"]["forces"][1]["name"], "right");
    // The written mesh has the field, which is then drawn as any other.
    stdout(&palpate(&[
        "render",
        text(&mesh),
        "--field",
        "error",
        "--out",
        text(&picture),
    ]));
    let said = failure(&render(&["--dt", "0.001"]));
    assert!(
        said.contains("no error to draw: the body is in fast motion"),
        "{said}"
    );
    let still = here.join("still.toml");
    std::fs::write(&still, "[mesh]\ngenerate = \"bar\"\n").unwrap();
    let said = failure(&palpate(&[
        "render",
        text(&still),
        "--field",
        "error",
        "--out",
        text(&picture),
    ]));
    assert!(
        said.contains("no field \"error\"") && said.contains("with a solver"),
        "{said}"
    );
}

#[test]
fn bodies_are_refined_until_number_is_as_exact_as_wanted() {
    let here = folder("errors_within");
    let scene = here.join("sagging.toml");
    std::fs::write(&scene, SAGGING.replace("order = 1\n", "")).unwrap();
    let picture = here.join("sagging.png");
    let render = [
        "render",
        text(&scene),
        "--out",
        text(&picture),
        "--within",
        "2%",
    ];
    let output = palpate(&render);
    let notes = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && picture.exists(), "{notes}");
    let rounds: Vec<&str> = notes
        .lines()
        .filter(|line| line.contains(" tets of order "))
        .collect();
    assert!(
        rounds.len() >= 3 && rounds[0].contains("of order 1: "),
        "{notes}"
    );
    assert!(rounds.last().unwrap().contains(" ± "), "{notes}");
    // The best picture is there, and the exit code tells.
    std::fs::remove_file(&picture).unwrap();
    let output = palpate(&[&render[..5], &["0.001%", "--max-tets", "500"]].concat());
    let notes = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && picture.exists(), "{notes}");
    assert!(
        notes.contains("not as exact as wanted (--within)"),
        "{notes}"
    );
    // A press, with its film of the meshes.
    let out = here.join("pressed");
    let press = [
        "press",
        text(&scene),
        "--out",
        text(&out),
        "--within",
        "30%",
        "--tets",
        "900",
    ];
    let output = palpate(&[&press[..], &["--radius", "0.02", "--json"]].concat());
    let notes = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.success() && out.join("refinement.gif").exists(),
        "{notes}"
    );
    let report: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    let rounds = report["rounds"].as_array().unwrap();
    let error = rounds.last().unwrap()["error"].as_f64().unwrap();
    assert!(
        error <= 0.3 * report["max_force_n"].as_f64().unwrap(),
        "{report}"
    );
    let idle = failure(&palpate(&[&press[..4], &["--max-tets", "1000"]].concat()));
    assert!(idle.contains("belong to --within"), "{idle}");
    // A map whose points are refined.
    let map = [
        &press[..4],
        &["--map", "2x1", "--radius", "0.02", "--within"],
    ]
    .concat();
    let small = ["5%", "--tets", "900", "--max-tets", "1000"];
    let output = palpate(&[&map[..], &small].concat());
    let notes = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        !output.status.success() && notes.contains("2 of 2 stiffnesses are not as exact as wanted"),
        "{notes}"
    );
    let rows = std::fs::read_to_string(out.join("map.csv")).unwrap();
    let mut rows = rows.lines();
    assert_eq!(rows.next(), Some("x,y,z,stiffness,error"));
    for row in rows {
        let cells: Vec<f64> = row.split(',').map(|cell| cell.parse().unwrap()).collect();
        assert!(cells[4] > 0.05 * cells[3], "{row}");
    }
    // Its results are kept.
    let again = palpate(&[&map[..], &small].concat());
    let notes = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(
        notes.contains("with 2 completed points") && !again.status.success(),
        "{notes}"
    );
}
