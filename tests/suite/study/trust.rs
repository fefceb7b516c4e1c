//! The study of errors on its first cases.

use palpate::study::STUDIES;
use std::sync::atomic::AtomicBool;

/// Reported errors of quadratic tets hold in the first cases (a press, a sag and a twist of a block;
/// the number of a second press is refused), and would not without the safety factor.
#[test]
#[ignore = "long: scripts/test --full"]
fn quick_trust_study_has_errors_that_hold() {
    let dir = tempfile::tempdir().unwrap();
    super::frame::run(dir.path(), &AtomicBool::new(false), |run| {
        let (_, _, study) = STUDIES.iter().find(|s| s.0 == "trust").unwrap();
        study(run, None).unwrap();
    });
    let mut reader = csv::Reader::from_path(dir.path().join("trust.csv")).unwrap();
    let columns = reader.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = reader.records().map(|r| r.unwrap()).collect();
    let number = |row: &csv::StringRecord, name: &str| -> f64 {
        let column = columns.iter().position(|c| c == name).unwrap();
        row[column].parse().unwrap()
    };
    assert_eq!(rows.len(), 4);
    let valid: Vec<_> = rows
        .iter()
        .filter(|r| number(r, "quadratic").is_finite())
        .collect();
    assert_eq!(valid.len(), 3);
    for row in valid {
        let error = (number(row, "quadratic") - number(row, "truth")).abs();
        let raw = number(row, "quadratic_raw");
        let ratio = raw / error;
        assert!(ratio > 0.5 && ratio < 1.0, "{row:?}: {ratio}");
        assert!(number(row, "quadratic_rest") < 0.2 * raw, "{row:?}");
        assert!(number(row, "uncertainty") < 0.3 * error, "{row:?}");
        // Linear tets are further off.
        let linear = (number(row, "linear") - number(row, "truth")).abs();
        assert!(linear.is_nan() || linear > 3.0 * error, "{row:?}");
    }
    let findings = std::fs::read_to_string(dir.path().join("trust.md")).unwrap();
    assert!(findings.contains("3 of 3 (100 %)"), "{findings}");
    assert!(dir.path().join("trust.png").is_file());
}
