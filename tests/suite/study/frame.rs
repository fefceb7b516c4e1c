//! Common parts of studies: sheets, runs, charts.

use crate::support::gpu;
use palpate::Result;
use palpate::study::{Axis, Cell, Chart, Run, Series, SeriesStyle, StateMap};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

pub fn run<T>(dir: &Path, stop: &AtomicBool, work: impl FnOnce(&Run) -> T) -> T {
    work(&Run {
        gpu: &gpu(),
        dir,
        quick: true,
        progress: &|_, _| {},
        note: &|_| {},
        stop,
    })
}

fn points(count: usize) -> Vec<Vec<Cell>> {
    let point = |i: usize| vec!["a name, with a comma".into(), Cell::from(0.1 * i as f64)];
    (0..count).map(point).collect()
}

#[test]
fn measured_points_are_reused() {
    let dir = tempfile::tempdir().unwrap();
    let (mut measured, stop) = (0, AtomicBool::new(false));
    let mut square = |count| {
        run(dir.path(), &stop, |run| {
            run.measure(
                "s",
                &["name", "x"],
                &["square", "state"],
                &points(count),
                |p| {
                    measured += 1;
                    Ok(vec![p[1].number().powi(2).into(), "fine".into()])
                },
            )
        })
        .unwrap()
    };
    assert_eq!(square(3).len(), 3);
    let rows = square(5);
    assert_eq!(rows.len(), 5);
    assert_eq!(rows[4].number("square"), (0.1_f64 * 4.0).powi(2));
    assert_eq!(rows[4].text("name"), "a name, with a comma");
    assert_eq!(rows[4].text("state"), "fine");
    assert!(rows[4].number("absent").is_nan() && rows[4].text("absent").is_empty());
    assert_eq!(measured, 5);
    let text = std::fs::read_to_string(dir.path().join("s.csv")).unwrap();
    assert_eq!(text.lines().count(), 6);
    assert!(
        text.starts_with("name,x,square,state,adapter,date\n"),
        "{text}"
    );
}

#[test]
fn stopped_run_keeps_measured_points() {
    let dir = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    let measure = |at: usize, fail: bool| {
        run(dir.path(), &stop, |run| {
            run.measure(
                "s",
                &["name", "x"],
                &["y"],
                &points(6),
                |p| -> Result<Vec<Cell>> {
                    if p[1].number() >= 0.1 * at as f64 {
                        if fail {
                            return Err(palpate::Error::Input("failed".into()));
                        }
                        stop.store(true, Ordering::Relaxed);
                    }
                    Ok(vec![1.0.into()])
                },
            )
        })
    };
    assert!(measure(2, true).unwrap_err().to_string().contains("failed"));
    // Points 0 and 1 are present; 2 and 3 are measured, and the stop comes during 3.
    assert_eq!(measure(3, false).unwrap().len(), 4);
    stop.store(false, Ordering::Relaxed);
    assert_eq!(measure(6, false).unwrap().len(), 6);
}

#[test]
fn csv_with_other_columns_is_rejected_unchanged() {
    let dir = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    let path = dir.path().join("s.csv");
    std::fs::write(&path, "something,else\n1,2\n").unwrap();
    let error = run(dir.path(), &stop, |run| {
        run.measure("s", &["name", "x"], &["y"], &points(1), |_| {
            Ok(vec![1.0.into()])
        })
    });
    assert!(
        error
            .unwrap_err()
            .to_string()
            .contains("move the file away")
    );
    assert_eq!(
        std::fs::read_to_string(&path).unwrap(),
        "something,else\n1,2\n"
    );
}

/// Counts the pixels of a PNG whose colour is near `colour`.
fn pixels(path: &Path, colour: [u8; 3]) -> usize {
    let picture = image::open(path).unwrap().to_rgb8();
    let near = |p: &&image::Rgb<u8>| (0..3).all(|c| p[c].abs_diff(colour[c]) < 24);
    picture.pixels().filter(near).count()
}

#[test]
fn chart_draws_series_and_omits_invalid_points() {
    let dir = tempfile::tempdir().unwrap();
    let series = |look, points: &[[f64; 2]]| Series::new("implicit Euler", look, points.to_vec());
    let chart = |points: &[[f64; 2]]| Chart {
        title: "Error against time".into(),
        x: Axis::log("ms per simulated second"),
        y: Axis::log("relative error"),
        series: vec![
            series(SeriesStyle::LineMarks, points),
            series(SeriesStyle::Rings, &points[..1]),
        ],
    };
    let good = [[1e-3, 2.0], [0.5, 1e-4], [20.0, 3e-6]];
    chart(&good).save(dir.path(), "good").unwrap();
    let bad = [
        good[0],
        [0.0, 1.0],
        [-1.0, 1.0],
        [f64::NAN, 1.0],
        [1.0, f64::INFINITY],
        good[1],
        good[2],
    ];
    chart(&bad).save(dir.path(), "bad").unwrap();
    let png = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    assert_eq!(png("good.png"), png("bad.png"));
    assert!(pixels(&dir.path().join("good.png"), [0, 114, 178]) > 500);
    // Letters are drawn.
    assert!(pixels(&dir.path().join("good.png"), [0, 0, 0]) > 500);
    let svg = String::from_utf8(png("good.svg")).unwrap();
    assert!(svg.contains("ms per simulated second") && svg.contains("implicit Euler"));
    chart(&[[f64::NAN, 1.0]]).save(dir.path(), "empty").unwrap();
}

#[test]
fn state_map_colours_cells_by_state() {
    let dir = tempfile::tempdir().unwrap();
    let map = |cells: [usize; 6]| StateMap {
        title: "Verlet".into(),
        x: Axis::log("step h (s)"),
        y: Axis::log("stiffness κ (N/m)"),
        xs: vec![1e-4, 1e-3, 1e-2],
        ys: vec![1e3, 1e4],
        states: vec!["stable".into(), "inaccurate".into(), "diverged".into()],
        cells: cells.to_vec(),
        curves: vec![Series::new(
            "theory",
            SeriesStyle::Dashed,
            vec![[1e-4, 9e3], [1e-2, 2e3], [1.0, 1.0]],
        )],
    };
    let diverged = |name: &str, cells| {
        map(cells).save(dir.path(), name).unwrap();
        pixels(&dir.path().join(format!("{name}.png")), [213, 94, 0])
    };
    let (one, two) = (
        diverged("one", [0, 0, 1, 0, 1, 2]),
        diverged("two", [0, 0, 2, 0, 1, 2]),
    );
    // A cell is a sixth of the plane, minus its marks; the legend has its own patch.
    assert!(one > 160_000 && two > one + 160_000, "{one} {two}");
}
