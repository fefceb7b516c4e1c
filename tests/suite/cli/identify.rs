//! `palpate identify`: from the files of a press to a scene with the modulus.

use super::{failure, folder, palpate, stdout, text};
use serde_json::Value;

const BLOCK: &str = "[mesh]\ngenerate = \"box\"\ntets = 600\n[material]\nyoung = YOUNG\npoisson = 0.3\norder = 1\n\
    [picture]\nsize = [48, 32]\n";

#[test]
fn press_of_twin_gives_its_modulus() {
    let here = folder("identify");
    let scene = |name: &str, young: &str| {
        let file = here.join(name);
        std::fs::write(&file, BLOCK.replace("YOUNG", young)).unwrap();
        file
    };
    let [truth, guess] = [scene("truth.toml", "2e4"), scene("guess.toml", "6e3")];
    let (pressed, out) = (here.join("pressed"), here.join("out"));
    let how = ["--radius", "0.03", "--depth", "0.008", "--no-error"];
    let given = ["press", text(&truth), "--out", text(&pressed), "--quiet"];
    stdout(&palpate(&[&given[..], &how].concat()));

    let given = ["identify", text(&guess), "--data", text(&pressed)];
    let wanted = ["--unknown", "material.young", "--noise", "1%", "--json"];
    let output = palpate(&[&given[..], &wanted, &["--out", text(&out)]].concat());
    let report: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let young = &report["unknowns"][0];
    let [value, low, high] = ["value", "low", "high"].map(|key| young[key].as_f64().unwrap());
    assert!((value / 2e4 - 1.0).abs() < 0.01, "{young}");
    assert!(low < 2e4 && 2e4 < high && high < 10.0 * low, "{young}");
    assert_eq!(report["is_misfit"], false);
    let notes = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        notes.contains("material.young = ") && notes.contains("90 % interval"),
        "{notes}"
    );
    // The scene that was written is the same body.
    let found = std::fs::read_to_string(out.join("identified.toml")).unwrap();
    let found: toml::Table = found.parse().unwrap();
    let written = found["material"]["young"].as_float().unwrap();
    assert!((written / value - 1.0).abs() < 1e-12, "{written} {value}");
    let rows = std::fs::read_to_string(out.join("residuals.csv")).unwrap();
    assert_eq!(rows.lines().count(), 9, "{rows}");
    for file in ["identified.json", "residuals.svg"] {
        assert!(out.join(file).is_file(), "{file}");
    }

    // A search whose results cannot be written goes on from its last step.
    let blocked = here.join("blocked");
    let taken = blocked.join("identified.toml");
    std::fs::create_dir_all(&taken).unwrap();
    let there = ["--out", text(&blocked), "--no-advice"];
    failure(&palpate(&[&given[..], &wanted, &there].concat()));
    assert!(blocked.join("steps.json").is_file());
    std::fs::remove_dir(&taken).unwrap();
    let output = palpate(&[&given[..], &wanted, &there].concat());
    let again: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let again = again["unknowns"][0]["value"].as_f64().unwrap();
    assert!((again / value - 1.0).abs() < 1e-4, "{again} {value}");
    let notes = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(notes.contains("going on from step"), "{notes}");
    assert!(!notes.contains("step 0:"), "{notes}");
    assert!(!blocked.join("steps.json").exists());

    // Forces that no modulus explains.
    let csv = pressed.join("press.csv");
    let curve = std::fs::read_to_string(&csv).unwrap();
    let bent = curve.lines().enumerate().map(|(k, line)| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if let Ok(force) = cells[3].parse::<f64>() {
            // Every second depth is compared.
            cells[3] = (force * if k / 2 % 2 == 0 { 1.3 } else { 0.8 }).to_string();
        }
        cells.join(",")
    });
    std::fs::write(&csv, bent.collect::<Vec<_>>().join("\n")).unwrap();
    let output = palpate(&[&given[..], &wanted, &["--out", text(&out)]].concat());
    assert_eq!(output.status.code(), Some(1));
    let notes = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(notes.contains("does not explain the data"), "{notes}");

    // Files that are empty, or of something else.
    std::fs::write(&csv, "depth_m,force_n\n").unwrap();
    let why = failure(&palpate(&[&given[..], &wanted].concat()));
    assert!(why.contains("no rows of numbers"), "{why}");
    std::fs::write(&csv, "a,b\n1,2\n").unwrap();
    let why = failure(&palpate(&[&given[..], &wanted].concat()));
    assert!(why.contains("depth_m and force_n"), "{why}");
    let empty = here.join("nothing");
    std::fs::create_dir_all(&empty).unwrap();
    let given = ["identify", text(&guess), "--data", text(&empty)];
    let why = failure(&palpate(&[&given[..], &wanted].concat()));
    assert!(why.contains("neither press.csv nor map.csv"), "{why}");
}
