//! The study of elements: its quick form, and what it says about the order.

use palpate::study::STUDIES;
use std::sync::atomic::AtomicBool;

#[test]
fn quadratic_tets_are_closer_with_fewer_unknowns() {
    let dir = tempfile::tempdir().unwrap();
    let run = |scene: Option<&std::path::Path>| {
        super::frame::run(dir.path(), &AtomicBool::new(false), |run| {
            let (_, _, study) = STUDIES.iter().find(|s| s.0 == "elements").unwrap();
            study(run, scene)
        })
    };
    let refused = run(Some(dir.path())).unwrap_err().to_string();
    assert!(refused.contains("takes no scene"), "{refused}");
    run(None).unwrap();
    let mut reader = csv::Reader::from_path(dir.path().join("elements.csv")).unwrap();
    let columns = reader.headers().unwrap().clone();
    let at = |name: &str| columns.iter().position(|c| c == name).unwrap();
    let rows: Vec<csv::StringRecord> = reader.records().map(|r| r.unwrap()).collect();
    let number =
        |row: &csv::StringRecord, column: &str| -> f64 { row[at(column)].parse().unwrap() };
    for problem in ["beam", "bump"] {
        let own = |element: &str| {
            let of = |r: &&csv::StringRecord| {
                &r[at("problem")] == problem && &r[at("element")] == element
            };
            rows.iter().filter(of).collect::<Vec<_>>()
        };
        let quadratic = own("quadratic");
        for element in ["linear, per tet", "linear, averaged"] {
            let linear = own(element);
            assert_eq!(linear.len(), 2);
            // Twice the cells across: more nodes, because quadratic tets have none in the cells.
            let [fine, coarse] = [linear[1], quadratic[0]];
            assert!(number(fine, "unknowns") > number(coarse, "unknowns"));
            assert_eq!(number(fine, "tets"), 8.0 * number(coarse, "tets"));
            let [fine, coarse] = [fine, coarse].map(|r| number(r, "error").abs());
            println!("{problem}, {element}: {fine}, quadratic {coarse}");
            assert!(
                coarse < 0.6 * fine,
                "{problem}, {element}: {coarse}, {fine}"
            );
            // Finer is closer.
            assert!(fine < number(linear[0], "error").abs());
        }
    }
    let text = std::fs::read_to_string(dir.path().join("elements.md")).unwrap();
    assert!(text.contains("quadratic over the faster linear"), "{text}");
    for name in [
        "elements_beam.png",
        "elements_bump.svg",
        "elements_truth.csv",
    ] {
        assert!(dir.path().join(name).exists(), "{name}");
    }
}
