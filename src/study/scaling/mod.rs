//! The scaling study: time of a step, an update, an image, a table and a cut, against tets, pixels,
//! layers and texels; time of finite element steps; and memory per node and tet.

mod cases;
mod memory;
mod steps;

use super::{Axis, Cell, Chart, Row, Run, Series, SeriesStyle};
use crate::Result;
use cases::Cases;
use std::path::Path;

pub use memory::computed_bytes;
pub(super) use memory::taken;
pub(crate) use memory::{DEVICE_PARTS, part_bytes};

/// Columns that identify a point.
const SETTINGS: [&str; 7] = [
    "what", "on", "against", "tets", "pixels", "layers", "texels",
];
/// Columns of results; iterations are those of conjugate gradients in the last step.
const RESULTS: [&str; 3] = ["nodes", "iterations", "ms"];

/// One point: operation, device and size.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point {
    what: &'static str,
    on: &'static str,
    against: &'static str,
    /// Requested number of tets.
    tets: usize,
    pixels: usize,
    layers: usize,
    texels: usize,
}

const GPU: &str = "GPU";
/// The CPU engine.
const CPU: &str = "CPU";
/// The float64 reference implementation.
const REFERENCE: &str = "CPU twin";
/// A cut is computed on the CPU, and its changes are uploaded.
const BOTH: &str = "CPU + GPU";

impl Point {
    fn cells(&self) -> Vec<Cell> {
        let numbers = [self.tets, self.pixels, self.layers, self.texels].map(Cell::from);
        let names = [self.what, self.on, self.against].map(Cell::from);
        names.into_iter().chain(numbers).collect()
    }
}

/// Returns the number of pixels of images measured against tets and layers.
fn pixels(quick: bool) -> usize {
    if quick { 128 * 128 } else { 256 * 256 }
}

/// A point with nothing measured.
const BASE: Point = Point {
    what: "",
    on: GPU,
    against: "tets",
    tets: 0,
    pixels: 0,
    layers: 0,
    texels: 0,
};

/// Returns all points; those of one mesh are adjacent, so that it is generated once.
fn points(quick: bool) -> Vec<Point> {
    let (tets, twin_most): (&[usize], usize) = match quick {
        true => (&[1_000, 3_000, 10_000], 3_000),
        false => (
            &[1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000],
            100_000,
        ),
    };
    let mut all = Vec::new();
    for tets in tets {
        let base = Point {
            tets: *tets,
            ..BASE
        };
        for what in [
            "symplectic step",
            "implicit step",
            "refresh",
            "raycast",
            "cut",
        ] {
            let pixels = if what == "raycast" { pixels(quick) } else { 0 };
            let point = Point {
                what,
                on: if what == "cut" { BOTH } else { GPU },
                pixels,
                ..base
            };
            all.push(point);
            match what {
                "symplectic step" | "implicit step" => all.push(Point { on: CPU, ..point }),
                "cut" => {}
                _ if *tets <= twin_most => all.push(Point {
                    on: REFERENCE,
                    ..point
                }),
                _ => {}
            }
        }
    }
    add_images(quick, &mut all);
    add_tables(quick, &mut all);
    all
}

/// Adds images of several sizes and numbers of layers.
fn add_images(quick: bool, all: &mut Vec<Point>) {
    let sides: &[usize] = if quick {
        &[64, 128, 256]
    } else {
        &[64, 128, 256, 512, 1024]
    };
    for side in sides {
        let point = Point {
            what: "raycast",
            against: "pixels",
            tets: if quick { 3_000 } else { 48_000 },
            pixels: side * side,
            ..BASE
        };
        all.push(point);
        if *side <= if quick { 64 } else { 256 } {
            all.push(Point {
                on: REFERENCE,
                ..point
            });
        }
    }
    let layers: &[usize] = if quick {
        &[1, 4, 16]
    } else {
        &[1, 2, 4, 8, 16, 32]
    };
    for layers in layers {
        all.push(Point {
            what: "raycast",
            against: "layers",
            tets: if quick { 3_000 } else { 48_000 },
            pixels: pixels(quick),
            layers: *layers,
            ..BASE
        });
    }
}

/// Adds tables of several sizes.
fn add_tables(quick: bool, all: &mut Vec<Point>) {
    let sizes: &[usize] = if quick {
        &[64, 128]
    } else {
        &[32, 64, 128, 256, 512]
    };
    for size in sizes {
        let point = Point {
            what: "table",
            against: "texels",
            tets: 1_000,
            texels: size * size,
            ..BASE
        };
        all.push(point);
        if *size <= if quick { 64 } else { 128 } {
            all.push(Point {
                on: REFERENCE,
                ..point
            });
        }
    }
}

/// Measures time and memory against size.
///
/// # Errors
/// An error if a file cannot be written, or the device fails.
pub fn run(run: &Run, scene: Option<&Path>) -> Result<()> {
    if scene.is_some() {
        run.report_note("ignoring the scene: the scaling study uses generated cubes");
    }
    let points = points(run.quick);
    let cells: Vec<Vec<Cell>> = points.iter().map(Point::cells).collect();
    let mut cases = Cases::new(run.gpu, run.quick);
    let rows = run.measure("scaling", &SETTINGS, &RESULTS, &cells, |cell| {
        let at = cells.iter().position(|c| c == cell).unwrap_or(0);
        cases.measure(&points[at])
    })?;
    drop(cases);
    let mut charts = vec![
        chart(
            run,
            &rows,
            "steps",
            &["symplectic step", "implicit step"],
            "tets",
        )?,
        chart(
            run,
            &rows,
            "drawing",
            &["refresh", "raycast", "cut"],
            "tets",
        )?,
        chart(run, &rows, "pixels", &["raycast"], "pixels")?,
        chart(run, &rows, "layers", &["raycast"], "layers")?,
        chart(run, &rows, "table", &["table"], "texels")?,
    ];
    let (elements, elements_charts) = steps::measure(run)?;
    charts.extend(elements_charts);
    let (memory, memory_chart) = memory::measure(run)?;
    charts.push(memory_chart);
    let names: Vec<&str> = charts.iter().map(String::as_str).collect();
    let text = format!("{}\n\n{elements}\n{memory}", finding(&rows));
    run.write_findings(
        "scaling",
        "Scaling: time and memory against size",
        &text,
        &names,
    )
}

/// Returns the sizes and times of the points of one kind, by size.
fn curve(rows: &[Row], what: &str, on: &str, against: &str) -> Vec<[f64; 2]> {
    let own = rows
        .iter()
        .filter(|r| r.text("what") == what && r.text("on") == on && r.text("against") == against);
    let mut points: Vec<[f64; 2]> = own.map(|r| [r.number(against), r.number("ms")]).collect();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    points
}

/// Returns the exponent p of y ∝ xᵖ by least squares in logarithms, over the larger half of the
/// points.
pub(super) fn fit_exponent(points: &[[f64; 2]]) -> Option<f64> {
    let from = (points.len() / 2).min(points.len().saturating_sub(3));
    let logs: Vec<[f64; 2]> = points[from..].iter().map(|p| p.map(f64::ln)).collect();
    if logs.len() < 2 {
        return None;
    }
    let mean = |k: usize| logs.iter().map(|p| p[k]).sum::<f64>() / logs.len() as f64;
    let (x, y) = (mean(0), mean(1));
    let both: f64 = logs.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
    let own: f64 = logs.iter().map(|p| (p[0] - x).powi(2)).sum();
    (own > 0.0).then(|| both / own)
}

fn chart(run: &Run, rows: &[Row], name: &str, kinds: &[&str], against: &str) -> Result<String> {
    let mut series = Vec::new();
    for what in kinds {
        for on in [GPU, CPU, REFERENCE, BOTH] {
            let points = curve(rows, what, on, against);
            if let Some(p) = fit_exponent(&points) {
                let name = format!("{what}, {on}: x^{p:.2}");
                series.push(Series::new(name, SeriesStyle::LineMarks, points));
            }
        }
    }
    if let Some(first) = series.first().and_then(|s| s.points.last().copied()) {
        let low = series
            .iter()
            .flat_map(|s| &s.points)
            .map(|p| p[0])
            .fold(first[0], f64::min);
        let line = [low, first[0]].map(|x| [x, first[1] * x / first[0]]);
        series.push(Series::new("linear", SeriesStyle::Dashed, line.to_vec()));
    }
    let unit = match against {
        "texels" => "texels of a slice of the table",
        "layers" => "layers that a ray enters",
        other => other,
    };
    let chart = Chart {
        title: format!("Time of {} against {against}", kinds.join(", ")),
        x: Axis::log(unit),
        y: Axis::log("time (ms)"),
        series,
    };
    let file = format!("scaling-{name}");
    chart.save(run.dir, &file)?;
    Ok(file)
}

/// Describes the exponents and explains them.
fn finding(rows: &[Row]) -> String {
    let mut lines = vec![
        "| what | against | on | exponent | largest | time |\n|---|---|---|---|---|---|".to_owned(),
    ];
    let mut seen: Vec<(&str, &str, &str)> = Vec::new();
    for row in rows {
        let key = (row.text("what"), row.text("against"), row.text("on"));
        if seen.contains(&key) {
            continue;
        }
        seen.push(key);
        let points = curve(rows, key.0, key.2, key.1);
        if let (Some(p), Some([size, ms])) = (fit_exponent(&points), points.last()) {
            lines.push(format!(
                "| {} | {} | {} | {p:.2} | {size:.0} | {ms:.3} ms |",
                key.0, key.1, key.2
            ));
        }
    }
    let iterations = |on: &str| {
        let steps = rows.iter().filter(|r| r.text("what") == "implicit step");
        let own = steps.filter(|r| r.text("on") == on);
        let counts: Vec<String> = own
            .map(|r| format!("{:.0}", r.number("iterations")))
            .collect();
        counts.join(", ")
    };
    format!(
        "{}\n\n\
         Exponents are fitted to the larger half of the sizes. Times are constant at small sizes, \
         where the dispatch of a pass dominates. A symplectic step and a refresh are linear in the \
         tets. An implicit step on the GPU grows faster, because its conjugate gradients need more \
         iterations on finer meshes ({} from the smallest mesh to the largest): information \
         propagates from node to node. On the CPU, a coarse space propagates it globally ({}). An \
         image grows more slowly, as the cube root of many tets, because a ray passes that many \
         of them. A cut through the whole cube opens a number of faces proportional to the power \
         2/3 of the tets, but checks every tet once, on the CPU. Each layer costs a search for the \
         next faces over the whole boundary, which here also grows with the layers. \
         The table has that number of texels in each of \
         its slices, regardless of the number of tets.",
        lines.join("\n"),
        iterations(GPU),
        iterations(CPU)
    )
}
