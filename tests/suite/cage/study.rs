//! The quick study of cages.

use palpate::gpu::Gpu;
use palpate::study::{Run, STUDIES};
use std::sync::atomic::AtomicBool;

#[test]
#[ignore = "long: scripts/test --full"]
fn cage_error_decreases_with_refinement() {
    let gpu = Gpu::new().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let run = Run {
        gpu: &gpu,
        dir: folder.path(),
        quick: true,
        progress: &|_, _| {},
        note: &|_| {},
        stop: &AtomicBool::new(false),
    };
    let (_, _, study) = STUDIES.iter().find(|s| s.0 == "cages").unwrap();
    study(&run, None).unwrap();
    let text = std::fs::read_to_string(folder.path().join("cages.csv")).unwrap();
    println!("{text}");
    let mut lines = text.lines().map(|l| l.split(',').collect::<Vec<_>>());
    let names = lines.next().unwrap();
    let column = |name: &str| names.iter().position(|n| *n == name).unwrap();
    let [matter, body, end] = ["matter", "body", "end error"].map(column);
    let rows: Vec<Vec<&str>> = lines.collect();
    for (model, kind, expected) in [
        ("neo-hookean", "lattice", [0.3950, 0.1276, 0.1068]),
        ("springs", "lattice", [0.7710, 0.1770, 0.1030]),
        ("springs", "grid", [0.1961, 0.1944, 0.2333]),
    ] {
        let errors: Vec<f64> = rows
            .iter()
            .filter(|r| r[matter] == model && r[body] == kind)
            .map(|r| r[end].parse().unwrap())
            .collect();
        assert_eq!(errors.len(), 3, "{kind} of {model}");
        for (error, expected) in errors.iter().zip(expected) {
            assert!(
                (error / expected - 1.0).abs() < 0.05,
                "{kind} of {model}: {errors:?}"
            );
        }
    }
    for file in ["cages_nodes.svg", "cages_time.png", "cages.md"] {
        assert!(folder.path().join(file).exists(), "{file}");
    }
}
