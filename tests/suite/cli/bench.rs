//! `palpate bench`: the report, its golden comparisons, and what costs a row.

use super::{failure, folder, palpate, text};
use palpate::bench::{
    Case, Context, GOLDEN, GOLDEN_PICTURES, Machine, Outcome, Part, Report, Row, Supervision,
    measure_all, run_part,
};
use std::ops::Range;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Copies the golden pictures to a folder.
fn copy_goldens(to: &Path) {
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    for name in GOLDEN_PICTURES {
        let file = format!("{name}.png");
        std::fs::copy(from.join(&file), to.join(&file)).unwrap();
    }
}

/// All golden comparisons but two, whose picture is wrong or missing, pass; these fail the command and are its
/// first rows.
#[test]
#[ignore = "long: all golden comparisons and the memory of each part"]
fn bench_writes_golden_rows_and_measurements() {
    let (goldens, out) = (folder("bench_goldens"), folder("bench"));
    copy_goldens(&goldens);
    std::fs::copy(goldens.join("limb-bone.png"), goldens.join("limb-skin.png")).unwrap();
    std::fs::remove_file(goldens.join("cube-thickness.png")).unwrap();
    let run = ["bench", "--quick", "--only", "memory", "--json"];
    let folders = ["--goldens", text(&goldens), "--out", text(&out)];
    let output = palpate(&[&run[..], &folders].concat());
    let printed: Report = serde_json::from_slice(&output.stdout).unwrap();
    let errors = failure(&output);
    assert!(
        errors.contains("golden comparison differs: limb-skin"),
        "{errors}"
    );
    let report = Report::read(&out.join("bench.json")).unwrap();
    assert_eq!(report, printed);
    assert!(report.quick && !report.ended_early && !report.machine.adapter.is_empty());
    let golden: Vec<&Row> = report.rows.iter().filter(|r| r.part == GOLDEN).collect();
    assert!(
        golden.len() > GOLDEN_PICTURES.len() + 10,
        "{}",
        golden.len()
    );
    let first = [&report.rows[0], &report.rows[1]].map(|r| (r.what.as_str(), r.outcome));
    assert_eq!(first[0], ("limb-skin, stored", Outcome::Differs));
    assert_eq!(first[1], ("cube-thickness, stored", Outcome::Failed));
    assert!(
        report.rows[1].note.contains("cube-thickness.png"),
        "{:?}",
        report.rows[1]
    );
    for row in &golden[2..] {
        assert_eq!(row.outcome, Outcome::Passed, "{row:?}");
        assert!(row.median.unwrap() <= row.bound.unwrap(), "{row:?}");
    }
    let memory: Vec<&Row> = report.rows.iter().filter(|r| r.part == "memory").collect();
    assert_eq!(memory.len() + golden.len(), report.rows.len());
    let geometry = memory.iter().find(|r| r.what == "geometry").unwrap();
    assert!(geometry.median.unwrap() > 32.0 && geometry.outcome == Outcome::Measured);

    let mut csv = csv::Reader::from_path(out.join("bench.csv")).unwrap();
    let header = csv.headers().unwrap().clone();
    for column in ["part", "what", "size", "median", "unit", "bound", "outcome"] {
        assert!(header.iter().any(|c| c == column), "{header:?}");
    }
    let rows: Vec<csv::StringRecord> = csv.records().map(|r| r.unwrap()).collect();
    assert_eq!(rows.len(), report.rows.len());
    assert_eq!(
        (&rows[0][0], &rows[0][1]),
        (GOLDEN, golden[0].what.as_str())
    );
    let page = std::fs::read_to_string(out.join("bench.md")).unwrap();
    assert!(
        page.contains("**Outside their bounds: 2 of ") && page.contains("**differs**"),
        "{page}"
    );
    assert!(page.contains(&report.machine.adapter), "{page}");
}

/// The stored pictures pass, and the page says so.
#[test]
fn bench_of_stored_pictures_passes() {
    let gpu = crate::support::gpu();
    let context = Context {
        gpu: &gpu,
        quick: true,
        goldens: None,
    };
    let mut report = Report::new(Machine::of(&gpu), true);
    let golden = palpate::bench::part(GOLDEN).unwrap();
    run_part(&context, golden, 0..GOLDEN_PICTURES.len(), &mut |message| {
        report.add(message.rows.clone(), None);
        Ok(())
    })
    .unwrap();
    let count = report.rows.len();
    assert_eq!(count, GOLDEN_PICTURES.len());
    assert_eq!(report.golden_passes(), count);
    assert_eq!(report.golden_failures().count(), 0);
    let out = folder("bench_stored");
    report.write(&out).unwrap();
    let page = std::fs::read_to_string(out.join("bench.md")).unwrap();
    let summary = format!("All {count} golden comparisons are within");
    assert!(page.contains(&summary), "{page}");
}

#[test]
fn bench_rejects_unknown_parts_and_other_files() {
    let out = folder("bench_refused");
    let errors = failure(&palpate(&["bench", "--only", "speed", "--out", text(&out)]));
    assert!(
        errors.contains("\"speed\"") && errors.contains("raycast"),
        "{errors}"
    );
    let other = out.join("other.json");
    std::fs::write(&other, "[1, 2]").unwrap();
    let run = ["bench", "--compare", text(&other), "--out", text(&out)];
    let errors = failure(&palpate(&run));
    assert!(
        errors.contains("other.json") && errors.contains("bench.json"),
        "{errors}"
    );
}

/// Three cases, the second of which fails; none needs the device.
fn three(_quick: bool) -> Vec<Case> {
    let case = |name: &'static str| {
        Case::new(Row::new(name, "cpu", "ms"), move |_, row| match name {
            "second" => Err(palpate::Error::Input("no second".into())),
            _ => Ok(row.value(1.0)),
        })
    };
    ["first", "second", "third"].map(case).into()
}

const THREE: Part = Part {
    name: "three",
    title: "Three",
    about: "Three cases.",
    separate: false,
    cases: three,
};

#[test]
fn failed_case_costs_its_row_only() {
    let gpu = crate::support::gpu();
    let context = Context {
        gpu: &gpu,
        quick: true,
        goldens: None,
    };
    let mut rows = Vec::new();
    run_part(&context, &THREE, 0..3, &mut |message| {
        rows.extend(message.rows.clone());
        Ok(())
    })
    .unwrap();
    let ends: Vec<Outcome> = rows.iter().map(|row| row.outcome).collect();
    assert_eq!(
        ends,
        [Outcome::Measured, Outcome::Failed, Outcome::Measured]
    );
    assert_eq!(
        (rows[1].what.as_str(), rows[1].note.as_str()),
        ("second", "no second")
    );
    let huge = Part {
        cases: |_| {
            let case = Case::new(Row::new("huge", "cpu", "ms"), |_, row| Ok(row.value(1.0)));
            vec![case.memory(u64::MAX)]
        },
        ..THREE
    };
    run_part(&context, &huge, 0..1, &mut |message| {
        assert_eq!(message.rows[0].outcome, Outcome::LeftOut, "{message:?}");
        assert!(message.rows[0].note.contains("GB"), "{message:?}");
        Ok(())
    })
    .unwrap();
}

/// Measures the three cases in processes that run this script, with the first case as `$0`.
#[cfg(unix)]
fn supervised(script: &str, limit: Duration) -> Vec<Row> {
    let command = |_: &Part, cases: Range<usize>| {
        let mut command = Command::new("sh");
        let script = format!("{SAY}; {script}");
        command.args(["-c", &script, &cases.start.to_string()]);
        command
    };
    let how = Supervision {
        command: &command,
        quick: true,
        limit,
        progress: &|_, _, _| {},
        stop: &AtomicBool::new(false),
    };
    let mut rows = Vec::new();
    measure_all(&how, &[&THREE], &mut |more| {
        rows.extend(more);
        Ok(())
    })
    .unwrap();
    rows
}

/// Prints the message of a case: its index, and whether the device is lost.
#[cfg(unix)]
const SAY: &str =
    r#"say() { echo "{\"case\":$1,\"lost\":$2,\"rows\":[{\"what\":\"case $1\"}]}"; }"#;

#[cfg(unix)]
#[test]
fn crashed_process_costs_one_row_and_the_next_continues() {
    // The second case crashes its process.
    let script = "echo noise; case $0 in
        0) say 0 false; echo boom >&2; kill -SEGV $$;;
        2) say 2 false;; esac";
    let rows = supervised(script, Duration::from_secs(600));
    let names: Vec<&str> = rows.iter().map(|row| row.what.as_str()).collect();
    assert_eq!(names, ["case 0", "second", "case 2"]);
    let reason = &rows[1].note;
    assert_eq!(
        (rows[1].outcome, rows[1].part.as_str()),
        (Outcome::Failed, "three")
    );
    assert!(
        reason.contains("SIGSEGV") && reason.contains("boom"),
        "{reason}"
    );
}

#[cfg(unix)]
#[test]
fn lost_device_costs_no_other_row() {
    let script = "case $0 in 0) say 0 true; exit 1;; 1) say 1 false; say 2 false;; esac";
    let rows = supervised(script, Duration::from_secs(600));
    let names: Vec<&str> = rows.iter().map(|row| row.what.as_str()).collect();
    assert_eq!(names, ["case 0", "case 1", "case 2"]);
}

#[cfg(unix)]
#[test]
fn cases_that_do_not_end_are_given_up() {
    let rows = supervised("exec sleep 600", Duration::ZERO);
    assert_eq!(rows.len(), 3);
    for row in rows {
        assert_eq!(row.outcome, Outcome::Failed);
        assert!(row.note.contains("did not end"), "{}", row.note);
    }
}
