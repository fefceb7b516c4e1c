//! `study elements`: the error of linear tets, per tet and with averaged volumes, and of quadratic
//! tets in static equilibrium, over tets, unknowns and time.

mod block;
mod problem;

use super::csv_table::significant;
use super::{Axis, Cell, Chart, Row, Run, Series, SeriesStyle};
use crate::Result;
use problem::{ElementKind, POISSON, Problem};
use std::path::Path;

/// Error at which the times are compared.
const ENOUGH: f64 = 0.02;

/// Measures every element on every mesh, draws a chart for each problem and reports the findings.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) for a scene, which this study does not take; otherwise an
/// error of the device or of writing.
pub fn run(run: &Run, scene: Option<&Path>) -> Result<()> {
    if let Some(scene) = scene {
        return Err(crate::Error::Input(format!(
            "the study of elements has problems of its own and takes no scene; remove {}",
            scene.display()
        )));
    }
    let references = references(run)?;
    let mut points = Vec::new();
    for problem in Problem::ALL {
        for element in ElementKind::ALL {
            for cells in problem.cells(element, run.quick) {
                points.push(vec![
                    Cell::from(problem.name()),
                    element.name().into(),
                    (*cells).into(),
                ]);
            }
        }
    }
    let rows = run.measure(
        "elements",
        &["problem", "element", "cells_across"],
        &["tets", "unknowns", "value", "error", "seconds"],
        &points,
        |point| {
            let problem = Problem::ALL.iter().find(|p| p.name() == point[0].text());
            let mut elements = ElementKind::ALL.iter();
            let element = elements.find(|e| e.name() == point[1].text());
            let (Some(problem), Some(element)) = (problem, element) else {
                return Ok(Vec::new());
            };
            let cells = point[2].number() as usize;
            let found = problem.solve(run.gpu, *element, cells, false)?;
            let mut references = references.iter();
            let reference = references.find(|r| r.text("problem") == problem.name());
            let reference = reference.map_or(f64::NAN, |r| r.number("value"));
            Ok(vec![
                found.tets.into(),
                found.unknowns.into(),
                significant(found.value, 6).into(),
                significant(found.value / reference - 1.0, 3).into(),
                significant(found.seconds, 3).into(),
            ])
        },
    )?;
    let mut charts = Vec::new();
    for problem in Problem::ALL {
        charts.push(draw(run, problem, &rows)?);
    }
    let charts: Vec<&str> = charts.iter().map(String::as_str).collect();
    let title = "Linear and quadratic tets: error against time";
    run.write_findings("elements", title, &tell(&references, &rows), &charts)
}

/// Returns the converged value of each problem: quadratic tets on three meshes, extrapolated to an
/// infinitely fine one.
fn references(run: &Run) -> Result<Vec<Row>> {
    let points = Problem::ALL.map(|problem| vec![Cell::from(problem.name())]);
    let results = ["value", "tets", "unknowns", "change", "order"];
    run.measure("elements_truth", &["problem"], &results, &points, |point| {
        let Some(problem) = Problem::ALL.iter().find(|p| p.name() == point[0].text()) else {
            return Ok(Vec::new());
        };
        let mut found = Vec::new();
        for cells in problem.reference_cells(run.quick) {
            found.push(problem.solve(run.gpu, ElementKind::Quadratic, cells, true)?);
        }
        let [.., a, b, c] = found.as_slice() else {
            return Ok(Vec::new());
        };
        let ratio = (b.value - a.value) / (c.value - b.value);
        let rest = match ratio > 1.0 {
            true => (c.value - b.value) / (ratio - 1.0),
            false => 0.0,
        };
        Ok(vec![
            significant(c.value + rest, 6).into(),
            c.tets.into(),
            c.unknowns.into(),
            significant((rest / c.value).abs(), 2).into(),
            significant(ratio.log2(), 3).into(),
        ])
    })
}

/// Returns the rows of an element in a problem.
fn of(rows: &[Row], problem: Problem, element: ElementKind) -> impl Iterator<Item = &Row> {
    rows.iter().filter(move |row| {
        row.text("problem") == problem.name() && row.text("element") == element.name()
    })
}

/// Draws the error over time of a problem. Returns the name of the chart.
fn draw(run: &Run, problem: Problem, rows: &[Row]) -> Result<String> {
    let mut series = Vec::new();
    for element in ElementKind::ALL {
        let points = of(rows, problem, element);
        let points = points.map(|r| [r.number("seconds"), 100.0 * r.number("error").abs()]);
        series.push(Series::new(
            element.name(),
            SeriesStyle::LineMarks,
            points.collect(),
        ));
    }
    let times = series.iter().flat_map(|s| s.points.iter().map(|p| p[0]));
    let (low, high) = times.fold((f64::MAX, 0.0), |(low, high), t: f64| {
        (t.min(low), t.max(high))
    });
    series.push(Series::new(
        format!("{} %", 100.0 * ENOUGH),
        SeriesStyle::Dashed,
        vec![[low, 100.0 * ENOUGH], [high, 100.0 * ENOUGH]],
    ));
    let name = format!("elements_{}", problem.name());
    Chart {
        title: format!("{}, ν = {POISSON}", problem.title()),
        x: Axis::log("time to equilibrium (s)"),
        y: Axis::log("error (%)"),
        series,
    }
    .save(run.dir, &name)?;
    Ok(name)
}

/// Cost, a time or a number of tets, at which an element reaches an error.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Reached {
    /// On a mesh between two measured ones, by interpolation.
    In(f64),
    /// On the coarsest mesh.
    AtMost(f64),
    /// Not on the finest mesh, whose cost this is.
    MoreThan(f64),
}

impl Reached {
    /// The cost at which the error of `points` (cost, error), coarse meshes first, falls to
    /// `enough`.
    fn of(points: &[[f64; 2]], enough: f64) -> Option<Reached> {
        let last = points.last()?;
        // The error may change its sign between coarse meshes.
        let over = points.iter().rposition(|p| p[1] > enough);
        Some(match over {
            None => Reached::AtMost(points.first()?[0]),
            Some(k) if k + 1 == points.len() => Reached::MoreThan(last[0]),
            Some(k) => {
                let [a, b] = [points[k], points[k + 1]].map(|p| p.map(f64::ln));
                let share = (enough.ln() - a[1]) / (b[1] - a[1]);
                Reached::In((a[0] + share * (b[0] - a[0])).exp())
            }
        })
    }

    fn value(self) -> f64 {
        match self {
            Reached::In(t) | Reached::AtMost(t) | Reached::MoreThan(t) => t,
        }
    }
}

impl std::fmt::Display for Reached {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let sign = match self {
            Reached::In(_) => "",
            Reached::AtMost(_) => "≤ ",
            Reached::MoreThan(_) => "> ",
        };
        write!(f, "{sign}{}", significant(self.value(), 2))
    }
}

/// Returns the table of the times in which, and the numbers of tets with which, the elements reach
/// [`ENOUGH`].
fn time_table(rows: &[Row]) -> String {
    let mut text = format!(
        "| {} % in | {} | quadratic over the faster linear |\n| --- | --- | --- | --- | --- |\n",
        100.0 * ENOUGH,
        ElementKind::ALL.map(ElementKind::name).join(" | ")
    );
    for problem in Problem::ALL {
        let reached = |column: &str| {
            let of_element = |element| {
                let points = of(rows, problem, element);
                let points = points.map(|r| [r.number(column), r.number("error").abs()]);
                Reached::of(&points.collect::<Vec<_>>(), ENOUGH)
            };
            let [per_tet, averaged, quadratic] = ElementKind::ALL.map(of_element);
            Some([per_tet?, averaged?, quadratic?])
        };
        let (Some(times), Some(tets)) = (reached("seconds"), reached("tets")) else {
            continue;
        };
        let cells = times.iter().zip(tets);
        let cells = cells.map(|(t, n)| format!("{t} s, {n} tets | "));
        let [per_tet, averaged, quadratic] = times;
        let faster = match (per_tet, averaged) {
            (Reached::MoreThan(_), other) | (other, Reached::MoreThan(_)) => other,
            _ if per_tet.value() < averaged.value() => per_tet,
            _ => averaged,
        };
        let is_bound =
            matches!(faster, Reached::MoreThan(_)) || matches!(quadratic, Reached::AtMost(_));
        text += &format!(
            "| {} | {}{}1/{} |\n",
            problem.name(),
            cells.collect::<String>(),
            if is_bound { "< " } else { "" },
            significant(faster.value() / quadratic.value(), 2)
        );
    }
    text
}

/// Returns the findings: what reaches [`ENOUGH`], and all rows.
fn tell(references: &[Row], rows: &[Row]) -> String {
    let mut text = format!(
        "Static equilibria of neo-Hookean bodies, ν = {POISSON}, five tets a cell: the deflection of the tip of a beam (0.8 × 0.2 × 0.2 m, 5 MPa) under its weight, and the force (work over depth) on a bump, 2 mm deep, bonded to the top of a cylindrical block of 5 cm radius and height, bonded at its base, in a disc of 2 cm radius at whose edge the bump has half its height, as a sphere in contact. Implicit steps of 100 s in float64, each to a residual of 10⁻⁴, until a step moves by less than 10⁻³ of the displacement; the time includes the set-up.\n\n"
    );
    text += &time_table(rows);
    for reference in references {
        text += &format!(
            "\nReference of the {}: {} {}, extrapolated from quadratic tets on three meshes, the finest of {} tets and {} unknowns, by {:.1e}; order {}.\n",
            reference.text("problem"),
            reference.number("value"),
            match reference.text("problem") {
                "beam" => "m",
                _ => "N",
            },
            reference.number("tets"),
            reference.number("unknowns"),
            reference.number("change"),
            reference.number("order"),
        );
    }
    text += "\n| problem | element | cells across | tets | unknowns | error | time |\n| --- | --- | --- | --- | --- | --- | --- |\n";
    for row in rows {
        text += &format!(
            "| {} | {} | {} | {} | {} | {:+.2} % | {} s |\n",
            row.text("problem"),
            row.text("element"),
            row.number("cells_across"),
            row.number("tets"),
            row.number("unknowns"),
            100.0 * row.number("error"),
            significant(row.number("seconds"), 2)
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cost_at_an_error_is_interpolated_or_bounded() {
        let points = [[1.0, 0.16], [10.0, 0.04], [100.0, 0.01]];
        let Some(Reached::In(t)) = Reached::of(&points, 0.02) else {
            panic!("not interpolated");
        };
        assert!((t / 1000_f64.sqrt() - 1.0).abs() < 1e-12, "{t}");
        assert_eq!(Reached::of(&points, 0.2), Some(Reached::AtMost(1.0)));
        assert_eq!(Reached::of(&points, 0.005), Some(Reached::MoreThan(100.0)));
        assert_eq!(Reached::of(&[], 0.02), None);
    }
}
