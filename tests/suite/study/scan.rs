//! The study of scans: a scan carried by a cage is sharper than node values.

use palpate::study::STUDIES;
use std::sync::atomic::AtomicBool;

/// The quick study: pictures by cages are close to the reference, coarser ones less so, and those
/// by node values are far from it, for its mesh sizes. A second run measures nothing.
#[test]
#[ignore = "long: scripts/test --full"]
fn quick_scan_study_finds_cages_sharper_than_values() {
    let dir = tempfile::tempdir().unwrap();
    let run = |stop: bool| {
        super::frame::run(dir.path(), &AtomicBool::new(stop), |run| {
            let (_, _, study) = STUDIES.iter().find(|s| s.0 == "scan").unwrap();
            study(run, None).unwrap();
        });
    };
    run(false);
    let path = dir.path().join("scan.csv");
    let sheet = std::fs::read_to_string(&path).unwrap();
    let mut reader = csv::Reader::from_path(&path).unwrap();
    let columns = reader.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = reader.records().map(|r| r.unwrap()).collect();
    let text = |row: &csv::StringRecord, name: &str| -> String {
        row[columns.iter().position(|c| c == name).unwrap()].to_owned()
    };
    let of = |what: &str, name: &str| -> Vec<f64> {
        let own = rows.iter().filter(|r| text(r, "what") == what);
        own.map(|r| text(r, name).parse().unwrap()).collect()
    };
    let [cages, values] = ["cage", "means"].map(|what| of(what, "rmse_255"));
    println!("cages {cages:?}, values {values:?}");
    assert!(cages.is_sorted_by(|a, b| a > b) && values.is_sorted_by(|a, b| a > b));
    // The finest mesh of node values has four times the tets of the finest cage, and ten times its
    // error.
    assert!(of("means", "tets")[2] > 4.0 * of("cage", "tets")[1]);
    assert!(values[2] > 10.0 * cages[1] && of("samples", "rmse_255")[2] > 10.0 * cages[1]);
    let [cages, values] = ["cage", "means"].map(|what| of(what, "gradient_r2"));
    assert!(cages[1] > 0.95 && values[2] < 0.5, "{cages:?} {values:?}");
    assert!(
        of("cage", "share")
            .iter()
            .all(|s| *s > 0.0 && s.is_finite())
    );
    // A scan of 64 × 64 × 64 half floats.
    assert!(of("cage", "gpu_mb").iter().all(|mb| *mb > 0.52));
    let message = std::fs::read_to_string(dir.path().join("scan.md")).unwrap();
    assert!(
        message.contains("do not reach the error of the cage"),
        "{message}"
    );
    for name in [
        "scan-time.svg",
        "scan-tets.svg",
        "scan-truth.png",
        "scan-cage-10.png",
        "scan-samples-16.png",
    ] {
        assert!(dir.path().join(name).is_file(), "{name}");
    }
    // A run that is stopped immediately keeps everything.
    run(true);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), sheet);
}
