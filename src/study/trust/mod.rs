//! `study trust`: whether estimated errors hold, in random cases whose converged numbers are known.

mod case;
mod measure;

use super::{Axis, Cell, Chart, Row, Run, Series, SeriesStyle};
use crate::Result;
use crate::accuracy::mesh_factor;
use crate::mesh::ElementOrder;
use case::Case;
use measure::{Measured, measure};
use std::path::Path;

/// Number of cases, each by linear and by quadratic tets.
const CASES: usize = 100;
const QUICK_CASES: usize = 4;
/// Uncertainty of a converged number, over the error of the reported one, above which the case says
/// nothing.
const MAX_UNCERTAINTY: f64 = 0.3;

/// Measures the cases, draws a chart and reports how many errors hold.
pub(super) fn run(run: &Run, scene: Option<&Path>) -> Result<()> {
    if let Some(scene) = scene {
        return Err(crate::Error::Input(format!(
            "the study of errors has cases of its own and takes no scene; remove {}",
            scene.display()
        )));
    }
    let count = if run.quick { QUICK_CASES } else { CASES };
    let points: Vec<Vec<Cell>> = (0..count)
        .map(|number| {
            let case = Case::new(number);
            vec![
                (case.number).into(),
                case.body.into(),
                case.load.name().into(),
                case.poisson.into(),
                case.contrast.into(),
            ]
        })
        .collect();
    let rows = run.measure(
        "trust",
        &["case", "body", "load", "poisson", "contrast"],
        &[
            "tets",
            "linear",
            "linear_raw",
            "linear_rest",
            "quadratic",
            "quadratic_raw",
            "quadratic_rest",
            "finer",
            "finest",
            "truth",
            "uncertainty",
            "failure",
        ],
        &points,
        |point| {
            let case = Case::new(point[0].number() as usize);
            Ok(match measure(run.gpu, &case) {
                Ok(found) => cells(&found),
                Err(crate::Error::Cancelled) => return Err(crate::Error::Cancelled),
                Err(why) => failed(&why.to_string()),
            })
        },
    )?;
    let judged: Vec<Judged> = rows.iter().flat_map(Judged::of_row).collect();
    draw(run, &judged)?;
    let text = describe(&rows, &judged);
    run.write_findings(
        "trust",
        "Estimated errors compared with true ones",
        &text,
        &["trust"],
    )
}

fn cells(found: &Measured) -> Vec<Cell> {
    let mut cells: Vec<Cell> = vec![found.tets.into()];
    for reported in found.reported {
        let numbers = reported.map_or([f64::NAN; 3], |r| [r.value, r.raw, r.rest]);
        cells.extend(numbers.map(|x| Cell::from(rounded(x))));
    }
    let (truth, uncertainty) = extrapolated(&found.finer);
    let last = |back: usize| {
        found
            .finer
            .iter()
            .rev()
            .nth(back)
            .copied()
            .unwrap_or(f64::NAN)
    };
    cells.extend([last(1), last(0), truth, uncertainty].map(|x| Cell::from(rounded(x))));
    cells.push("".into());
    cells
}

fn failed(why: &str) -> Vec<Cell> {
    let mut cells = vec![Cell::from(f64::NAN); 11];
    cells.push(why.into());
    cells
}

fn rounded(x: f64) -> f64 {
    format!("{x:.5e}").parse().unwrap_or(x)
}

/// Returns the limit of numbers in successively finer spaces by Richardson's extrapolation, and its
/// uncertainty: the distance from the last number.
fn extrapolated(numbers: &[f64]) -> (f64, f64) {
    let [.., a, b, c] = numbers else {
        return (f64::NAN, f64::NAN);
    };
    let ratio = (b - a) / (c - b);
    let rest = match ratio.is_finite() && ratio > 1.5 {
        true => (c - b) / (ratio.min(16.0) - 1.0),
        // Does not converge regularly.
        false => c - b,
    };
    (c + rest, rest.abs())
}

/// A reported error beside the true one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Judged {
    is_quadratic: bool,
    load: &'static str,
    /// True error, over the converged number.
    error: f64,
    /// Difference to the finer space, and the whole reported error, over the converged number.
    raw: f64,
    bar: f64,
}

impl Judged {
    fn of_row(row: &Row) -> Vec<Judged> {
        let (truth, uncertainty) = (row.number("truth"), row.number("uncertainty"));
        let names = ["press", "sag", "twist"];
        let load = names
            .into_iter()
            .find(|l| *l == row.text("load"))
            .unwrap_or("");
        let of = |is_quadratic: bool| {
            let (name, order) = match is_quadratic {
                true => ("quadratic", ElementOrder::Quadratic),
                false => ("linear", ElementOrder::Linear),
            };
            let number = |what: &str| row.number(&format!("{name}{what}"));
            let error = (number("") - truth).abs();
            let known = error.is_finite() && uncertainty <= MAX_UNCERTAINTY * error;
            known.then(|| Judged {
                is_quadratic,
                load,
                error: error / truth.abs(),
                raw: number("_raw") / truth.abs(),
                bar: (mesh_factor(order) * number("_raw") + number("_rest")) / truth.abs(),
            })
        };
        [false, true].into_iter().filter_map(of).collect()
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Draws the reported over the true errors.
fn draw(run: &Run, judged: &[Judged]) -> Result<()> {
    let of = |is_quadratic: bool, name: &str| {
        let own = judged.iter().filter(|j| j.is_quadratic == is_quadratic);
        let points = own.map(|j| [100.0 * j.error, 100.0 * j.bar]);
        Series::new(name, SeriesStyle::Marks, points.collect())
    };
    let errors = judged.iter().map(|j| 100.0 * j.error);
    let (low, high) = errors.fold((f64::MAX, 0.0), |(low, high), e: f64| {
        (e.min(low), e.max(high))
    });
    let line = |name: &str, factor: f64| {
        let points = vec![[low, factor * low], [high, factor * high]];
        Series::new(name, SeriesStyle::Dashed, points)
    };
    Chart {
        title: "Reported errors against true ones".into(),
        x: Axis::log("true error (%)"),
        y: Axis::log("reported error (%)"),
        series: vec![
            of(false, "linear tets"),
            of(true, "quadratic tets"),
            line("equal: below it an error does not hold", 1.0),
            line("three times as large", 3.0),
        ],
    }
    .save(run.dir, "trust")
}

/// Returns the findings: a table by load and order, and what was left out.
fn describe(rows: &[Row], judged: &[Judged]) -> String {
    let mut text = String::from(
        "| load | tets | cases | median error | difference to the finer space over the error, median | reported error over the error, median | errors that hold |\n| --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let groups = [
        ("press", "press"),
        ("sag", "sag"),
        ("twist", "twist"),
        ("all", ""),
    ];
    for (name, load) in groups {
        for (order, is_quadratic) in [("linear", false), ("quadratic", true)] {
            let own: Vec<&Judged> = judged
                .iter()
                .filter(|j| j.is_quadratic == is_quadratic && (load.is_empty() || j.load == load))
                .collect();
            if own.is_empty() {
                continue;
            }
            let of = |f: &dyn Fn(&Judged) -> f64| median(own.iter().map(|j| f(j)).collect());
            let holds = own.iter().filter(|j| j.error <= j.bar).count();
            text += &format!(
                "| {name} | {order} | {} | {:.1} % | {:.2} | {:.2} | {} of {} ({:.0} %) |\n",
                own.len(),
                100.0 * of(&|j| j.error),
                of(&|j| j.raw / j.error),
                of(&|j| j.bar / j.error),
                holds,
                own.len(),
                100.0 * holds as f64 / own.len() as f64
            );
        }
    }
    let failed = rows
        .iter()
        .filter(|r| !r.text("failure").is_empty())
        .count();
    let valid = rows.len() - failed;
    let refused = |name: &str| {
        let none = rows
            .iter()
            .filter(|r| r.text("failure").is_empty() && !r.number(name).is_finite());
        none.count()
    };
    text + &format!(
        "\n{} cases, each by linear and by quadratic tets: {failed} failed; of the other {valid} the number was refused for {} of linear and {} of quadratic tets, and {} were left out because the converged number is not known well enough (its uncertainty is more than {} of the error).",
        rows.len(),
        refused("linear"),
        refused("quadratic"),
        2 * valid - refused("linear") - refused("quadratic") - judged.len(),
        MAX_UNCERTAINTY
    )
}
