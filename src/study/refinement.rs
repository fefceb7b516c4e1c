//! `study refinement`: meshes refined where they are too coarse (`--within`) against equal tets of both
//! orders, on five scenes: error over time.

use super::csv_table::significant;
use super::{Axis, Cell, Chart, Row, Run, Series, SeriesStyle};
use crate::accuracy::Round;
use crate::mesh::ElementOrder;
use crate::physics::VolumetricFormulation;
use crate::press::{Press, PressOptions};
use crate::scene::{OrderChoice, Scene, Stage};
use crate::{Error, Result, no_progress};
use glam::DVec3;
use std::path::Path;

/// Error at which the times are compared, and wanted of refined meshes.
const ENOUGH: f64 = 0.02;
/// Errors wanted of refined meshes.
const GOALS: [f64; 3] = [0.2, 0.05, ENOUGH];
/// Error of the reference, by its own estimate.
const REFERENCE: f64 = 0.002;
/// Largest number of elements of a refined mesh.
const MAX_TETS: usize = 150_000;

/// A scene, and what is asked of it.
struct Case {
    name: &'static str,
    title: &'static str,
    /// Its mesh is `tets` of the generator.
    text: &'static str,
    /// Radius of the fingertip and press point; `None` for a body at rest.
    press: Option<(f64, Option<DVec3>)>,
    /// Number of tets of the first mesh.
    coarse: usize,
    /// Numbers of equal tets of order 1 and 2.
    linear: &'static [usize],
    quadratic: &'static [usize],
}

const LINEAR: &[usize] = &[1_000, 5_000, 20_000, 80_000];
const QUADRATIC: &[usize] = &[400, 1_500, 6_000, 20_000];

const CASES: [Case; 5] = [
    Case {
        name: "block",
        title: "A fingertip on a block, ν = 0.3",
        text: "[mesh]\ngenerate = \"box\"\ntets = TETS\n[material]\nyoung = 2e4\npoisson = 0.3\n",
        press: Some((0.025, None)),
        coarse: 900,
        linear: LINEAR,
        quadratic: &[900, 3_000, 10_000, 30_000],
    },
    Case {
        name: "edge",
        title: "A fingertip near the edge of a block, ν = 0.45",
        text: "[mesh]\ngenerate = \"box\"\ntets = TETS\n[material]\nyoung = 2e4\npoisson = 0.45\n",
        press: Some((0.02, Some(DVec3::new(0.08, 0.05, 0.1)))),
        coarse: 900,
        linear: LINEAR,
        quadratic: &[900, 3_000, 10_000, 30_000],
    },
    Case {
        name: "tip",
        title: "The tip of a clamped bar, ν = 0.45",
        text: "[mesh]\ngenerate = \"bar\"\ntets = TETS\n[material]\nyoung = 1e5\npoisson = 0.45\n[solver]\nname = \"implicit\"\nengine = \"cpu\"\ndt = 100\nsteps = 2\ntolerance = 1e-4\n[[pin]]\naxis = \"x\"\nbelow = 0.01\n[[force]]\non = { axis = \"x\", above = 0.99 }\ntotal = [0.0, 0.0, -1.0]\n",
        press: None,
        coarse: 300,
        linear: LINEAR,
        quadratic: QUADRATIC,
    },
    Case {
        name: "energy",
        title: "The energy of a bar on two supports, ν = 0.3",
        text: "[mesh]\ngenerate = \"bar\"\ntets = TETS\n[material]\nyoung = 1e5\npoisson = 0.3\ndensity = 1000\n[solver]\nname = \"implicit\"\nengine = \"cpu\"\ndt = 100\nsteps = 2\ntolerance = 1e-4\ngravity = [0.0, 0.0, -9.81]\n[[pin]]\naxis = \"x\"\nbelow = 0.01\n[[pin]]\naxis = \"x\"\nabove = 0.99\n[accuracy]\nof = \"energy\"\n",
        press: None,
        coarse: 300,
        linear: LINEAR,
        quadratic: QUADRATIC,
    },
    Case {
        name: "pulled",
        title: "A block pulled at its top, ν = 0.49",
        text: "[mesh]\ngenerate = \"box\"\ntets = TETS\n[material]\nyoung = 2e4\npoisson = 0.49\n[solver]\nname = \"implicit\"\nengine = \"cpu\"\ndt = 100\nsteps = 2\ntolerance = 1e-4\n[[pin]]\naxis = \"z\"\nbelow = 0.001\n[[force]]\non = { axis = \"z\", above = 0.999 }\ntotal = [2.0, 0.0, 10.0]\n",
        press: None,
        coarse: 300,
        linear: LINEAR,
        quadratic: QUADRATIC,
    },
];

/// A way to choose the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Method {
    Linear,
    Averaged,
    Quadratic,
    Refined,
}

impl Method {
    const ALL: [Method; 4] = [Self::Linear, Self::Averaged, Self::Quadratic, Self::Refined];

    fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Averaged => "averaged",
            Self::Quadratic => "quadratic",
            Self::Refined => "refined",
        }
    }

    /// What is asked of it in `case`: numbers of tets, or errors (%).
    fn asked(self, case: &Case, quick: bool) -> Vec<f64> {
        let most = if quick { 1 } else { usize::MAX };
        let count = |tets: &[usize]| tets.iter().take(most).map(|n| *n as f64).collect();
        match self {
            Self::Linear | Self::Averaged => count(case.linear),
            Self::Quadratic => count(case.quadratic),
            Self::Refined => GOALS.iter().take(most).map(|goal| 100.0 * goal).collect(),
        }
    }
}

/// Measures every method on every scene, draws a chart for each scene and reports the findings.
///
/// # Errors
/// [`Error::Input`] for a scene, which this study does not take; otherwise an error of the device or
/// of writing.
pub fn run(run: &Run, scene: Option<&Path>) -> Result<()> {
    if let Some(scene) = scene {
        return Err(Error::Input(format!(
            "the study of refinement has scenes of its own and takes none; remove {}",
            scene.display()
        )));
    }
    let truths = references(run)?;
    let mut points = Vec::new();
    for case in &CASES {
        for method in Method::ALL {
            for asked in method.asked(case, run.quick) {
                points.push(vec![
                    Cell::from(case.name),
                    method.name().into(),
                    asked.into(),
                ]);
            }
        }
    }
    let rows = run.measure(
        "refinement",
        &["scene", "method", "tets_or_percent"],
        &["tets", "value", "error", "reported", "seconds"],
        &points,
        |point| {
            let case = CASES.iter().find(|case| case.name == point[0].text());
            let mut methods = Method::ALL.into_iter();
            let method = methods.find(|method| method.name() == point[1].text());
            let (Some(case), Some(method)) = (case, method) else {
                return Ok(Vec::new());
            };
            let rounds = match case.solve(run, method, point[2].number()) {
                Err(Error::Solver { .. }) => Vec::new(),
                found => found?,
            };
            let Some(last) = rounds.last() else {
                return Ok(vec![Cell::from(f64::NAN); 5]);
            };
            let mut truths = truths.iter();
            let truth = truths.find(|row| row.text("scene") == case.name);
            let truth = truth.map_or(f64::NAN, |row| row.number("value"));
            let seconds: f64 = rounds.iter().map(|round| round.seconds).sum();
            Ok(vec![
                last.elements.into(),
                significant(last.value, 6).into(),
                significant(last.value / truth - 1.0, 3).into(),
                significant(last.share().unwrap_or(f64::NAN), 3).into(),
                significant(seconds, 3).into(),
            ])
        },
    )?;
    let mut charts = Vec::new();
    for case in &CASES {
        charts.push(case.draw(run, &rows)?);
    }
    let charts: Vec<&str> = charts.iter().map(String::as_str).collect();
    let title = "Refined meshes and equal tets: error against time";
    run.write_findings("refinement", title, &tell(&truths, &rows), &charts)
}

/// Returns the converged number of each scene: that of a mesh refined further than those compared.
fn references(run: &Run) -> Result<Vec<Row>> {
    let points = CASES.each_ref().map(|case| vec![Cell::from(case.name)]);
    let results = ["value", "tets", "reported"];
    run.measure("refinement_truth", &["scene"], &results, &points, |point| {
        let Some(case) = CASES.iter().find(|case| case.name == point[0].text()) else {
            return Ok(Vec::new());
        };
        let goal = if run.quick { GOALS[0] } else { REFERENCE };
        let rounds = case.solve(run, Method::Refined, 100.0 * goal)?;
        let Some(last) = rounds.last() else {
            return Ok(Vec::new());
        };
        Ok(vec![
            significant(last.value, 6).into(),
            last.elements.into(),
            significant(last.share().unwrap_or(f64::NAN), 2).into(),
        ])
    })
}

impl Case {
    /// Returns the meshes on the way: one of equal tets, or those that are refined.
    fn solve(&self, run: &Run, method: Method, asked: f64) -> Result<Vec<Round>> {
        let (tets, within, most) = match method {
            Method::Refined => (self.coarse, asked / 100.0, MAX_TETS),
            // A single round.
            _ => (asked as usize, ENOUGH, 1),
        };
        let mut scene = Scene::parse(&self.text.replace("TETS", &tets.to_string()))?;
        scene.material.order = match method {
            Method::Linear | Method::Averaged => Some(OrderChoice::Exactly(ElementOrder::Linear)),
            Method::Quadratic => Some(OrderChoice::Exactly(ElementOrder::Quadratic)),
            Method::Refined => None,
        };
        scene.material.volume =
            (method == Method::Averaged).then_some(VolumetricFormulation::NodalAveraged);
        scene.picture.size = Some([32, 24]);
        scene.accuracy.within = Some(within);
        scene.accuracy.max_tets = Some(most);
        let mut rounds = Vec::new();
        match self.press {
            Some((radius, at)) => {
                let wanted = PressOptions {
                    radius: Some(radius),
                    at,
                    ..PressOptions::default()
                };
                let mut on_round = |round: &Round, _: &mut dyn FnMut() -> _| {
                    rounds.push(round.clone());
                    Ok(())
                };
                Press::refined(run.gpu, (&scene, &wanted), &mut on_round, &no_progress)?;
            }
            None => {
                let mut on_round = |round: &Round| rounds.push(round.clone());
                Stage::refined(run.gpu, &scene, &mut on_round, &no_progress)?;
            }
        }
        Ok(rounds)
    }

    /// Returns the rows of a method.
    fn of<'a>(&self, rows: &'a [Row], method: Method) -> impl Iterator<Item = &'a Row> {
        let name = self.name;
        rows.iter()
            .filter(move |row| row.text("scene") == name && row.text("method") == method.name())
    }

    /// Draws the error over time. Returns the name of the chart.
    fn draw(&self, run: &Run, rows: &[Row]) -> Result<String> {
        let series = Method::ALL.into_iter().map(|method| {
            let points = self.of(rows, method).filter(|row| !has_failed(row));
            let points = points.map(|r| [r.number("seconds"), 100.0 * r.number("error").abs()]);
            let name = match method {
                Method::Refined => "refined (--within)".to_owned(),
                _ => format!("{}, equal tets", method.name()),
            };
            Series::new(name, SeriesStyle::LineMarks, points.collect())
        });
        let name = format!("refinement_{}", self.name);
        Chart {
            title: self.title.into(),
            x: Axis::log("time (s)"),
            y: Axis::log("error (%)"),
            series: series.collect(),
        }
        .save(run.dir, &name)?;
        Ok(name)
    }
}

/// Whether the body had no equilibrium on this mesh.
fn has_failed(row: &Row) -> bool {
    row.number("error").is_nan()
}

/// Returns the mesh of equal tets that reached [`ENOUGH`] in the shortest time, and stays below it with
/// more tets.
fn best_of_equal<'a>(case: &Case, rows: &'a [Row]) -> Option<&'a Row> {
    let equal = [Method::Linear, Method::Averaged, Method::Quadratic];
    let first_enough = |method| {
        let own: Vec<&Row> = case.of(rows, method).collect();
        let over = own
            .iter()
            .rposition(|row| has_failed(row) || row.number("error").abs() > ENOUGH);
        own.get(over.map_or(0, |k| k + 1)).copied()
    };
    let found = equal.into_iter().filter_map(first_enough);
    found.min_by(|a, b| a.number("seconds").total_cmp(&b.number("seconds")))
}

/// Returns the findings: times to [`ENOUGH`], and all rows.
fn tell(truths: &[Row], rows: &[Row]) -> String {
    let percent = 100.0 * ENOUGH;
    let mut text = format!(
        "A number within {percent} %: of the fastest mesh of equal tets that has it (found by trying all; how far off it is one does not know without the truth), and by `--within {percent}%` from a coarse mesh, with all its rounds. Without pictures and without the steps of a press on the last mesh.\n\n| scene | equal tets | | | refined | | | | time over equal tets |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n| | tets | error | s | tets | error | reported | s | |\n"
    );
    for case in &CASES {
        let refined = case.of(rows, Method::Refined).last();
        let (Some(equal), Some(refined)) = (best_of_equal(case, rows), refined) else {
            continue;
        };
        text += &format!(
            "| {} | {} {} | {:.1} % | {} | {} | {:.1} % | {:.1} % | {} | {} |\n",
            case.name,
            equal.number("tets"),
            equal.text("method"),
            100.0 * equal.number("error").abs(),
            equal.number("seconds"),
            refined.number("tets"),
            100.0 * refined.number("error").abs(),
            100.0 * refined.number("reported"),
            refined.number("seconds"),
            significant(refined.number("seconds") / equal.number("seconds"), 2)
        );
    }
    text += "\nConverged numbers, of refined meshes of more tets:\n\n| scene | number | tets | reported error |\n| --- | --- | --- | --- |\n";
    for truth in truths {
        text += &format!(
            "| {} | {} | {} | {:.2} % |\n",
            truth.text("scene"),
            truth.number("value"),
            truth.number("tets"),
            100.0 * truth.number("reported")
        );
    }
    text += "\n| scene | method | tets | number | error | reported | s |\n| --- | --- | --- | --- | --- | --- | --- |\n";
    for row in rows {
        if has_failed(row) {
            text += &format!(
                "| {} | {} | about {} | tets are inverted | | | |\n",
                row.text("scene"),
                row.text("method"),
                row.number("tets_or_percent")
            );
            continue;
        }
        let reported = row.number("reported");
        let reported = match reported.is_nan() {
            true => String::new(),
            false => format!("{:.1} %", 100.0 * reported),
        };
        text += &format!(
            "| {} | {} | {} | {} | {:+.2} % | {reported} | {} |\n",
            row.text("scene"),
            row.text("method"),
            row.number("tets"),
            row.number("value"),
            100.0 * row.number("error"),
            row.number("seconds")
        );
    }
    text
}
