//! Charts of error against time, and their description.

use super::by_default;
use super::device::ACCURATE;
use super::setting::RAPIER;
use super::trial::MotionTrial;
use crate::Result;
use crate::physics::SolverKind;
use crate::study::pareto::pareto_front;
use crate::study::{Axis, Chart, Row, Run, Series, SeriesStyle};

const COST: &str = "ms_per_simulated_s";

/// Returns the base of the file names: the scene and its stiffness.
fn name(trial: &MotionTrial) -> String {
    format!("motion_{}_{}", trial.name, trial.stiffness)
}

fn place(row: &Row) -> [f64; 2] {
    [row.number(COST), row.number("error")]
}

/// Whether a series has a finite point.
fn seen(series: &Series) -> bool {
    let mut points = series.points.iter();
    points.any(|p| p.iter().all(|c| c.is_finite()))
}

/// Draws error against milliseconds per simulated second. Returns the chart's name.
pub fn chart_error_over_time(run: &Run, trial: &MotionTrial, rows: &[Row]) -> Result<String> {
    let of = |name: &str, default: bool| -> Vec<[f64; 2]> {
        let rows = rows.iter();
        rows.filter(|r| r.text("solver") == name && by_default(r) == default)
            .map(place)
            .collect()
    };
    let mut series = Vec::new();
    for kind in trial.kinds() {
        let name = kind.name();
        series.push(Series::new(name, SeriesStyle::LineMarks, of(name, true)));
    }
    series.push(Series::new(
        RAPIER,
        SeriesStyle::LineMarks,
        of(RAPIER, true),
    ));
    series.push(Series::new(
        "implicit, other CG stops",
        SeriesStyle::Marks,
        of(SolverKind::Implicit.name(), false),
    ));
    let all: Vec<[f64; 2]> = rows.iter().map(place).collect();
    series.push(Series::new(
        "Pareto front",
        SeriesStyle::Rings,
        pareto_front(&all),
    ));
    series.retain(seen);
    let name = name(trial);
    Chart {
        title: format!("{}, {} {}", trial.name, trial.stiffness, trial.unit),
        x: Axis::log("ms per simulated second"),
        y: Axis::log("relative L2 error"),
        series,
    }
    .save(run.dir, &name)?;
    Ok(name)
}

/// Draws time discretisation, solver and f32 errors against the step. Returns the chart's name.
pub fn error_components(run: &Run, trial: &MotionTrial, rows: &[Row]) -> Result<String> {
    let of = |kind: SolverKind, column: &str, keep: &dyn Fn(&Row) -> bool| -> Vec<[f64; 2]> {
        let rows = rows.iter();
        rows.filter(|r| r.text("solver") == kind.name() && keep(r))
            .map(|r| [r.number("h_s"), r.number(column)])
            .collect()
    };
    let verlet = SolverKind::VelocityVerlet;
    let implicit = SolverKind::Implicit;
    let line = |name: &str, points| Series::new(name, SeriesStyle::LineMarks, points);
    let five = |r: &Row| r.number("cg_iterations") == 5.0;
    let mut series = vec![
        line(
            "velocity-verlet: time",
            of(verlet, "time_error", &by_default),
        ),
        line("velocity-verlet: f32", of(verlet, "f32_error", &by_default)),
        line("implicit: time", of(implicit, "time_error", &by_default)),
        line(
            "implicit: CG to 0.001",
            of(implicit, "solver_error", &by_default),
        ),
        line(
            "implicit: 5 CG iterations",
            of(implicit, "solver_error", &five),
        ),
        line("implicit: f32", of(implicit, "f32_error", &by_default)),
    ];
    series.retain(seen);
    let chart = format!("{}_parts", name(trial));
    Chart {
        title: format!(
            "Where errors come from: {}, {} {}",
            trial.name, trial.stiffness, trial.unit
        ),
        x: Axis::log("step h (s)"),
        y: Axis::log("relative L2 error"),
        series,
    }
    .save(run.dir, &chart)?;
    Ok(chart)
}

/// Describes one trial in a sentence or two.
pub fn describe_trial(trial: &MotionTrial, rows: &[Row], truths: &[Row]) -> String {
    let mut text = format!("**{}, {} {}**", trial.name, trial.stiffness, trial.unit);
    if let Some(truth) = truths.first() {
        text += &match truth.text("truth") {
            "exact" => " (exact solution)".to_owned(),
            _ => format!(
                " (reference: float64 at h = {:.1e} s; relative change by halving {:.0e}, of the extrapolation {:.0e})",
                truth.number("h_s"),
                truth.number("change_by_halving"),
                truth.number("change_of_extrapolation"),
            ),
        };
    }
    text += ": ";
    let mut results = Vec::new();
    for limit in [0.05, 0.01, 0.001] {
        let within = rows.iter().filter(|r| r.number("error") <= limit);
        let best = within.min_by(|a, b| a.number(COST).total_cmp(&b.number(COST)));
        results.push(match best {
            None => format!("{} % is not reached", 100.0 * limit),
            Some(row) => format!(
                "{} % costs {:.0} ms per simulated second ({}, h = {:.1e} s{})",
                100.0 * limit,
                row.number(COST),
                row.text("solver"),
                row.number("h_s"),
                solve(row),
            ),
        });
    }
    let diverged = rows
        .iter()
        .filter(|r| r.text("state") == "diverged")
        .count();
    text + &results.join("; ") + &format!("; {diverged} of {} points diverged.\n\n", rows.len())
}

fn solve(row: &Row) -> String {
    match (row.number("cg_iterations"), row.number("cg_tolerance")) {
        (n, _) if n.is_nan() => String::new(),
        (n, _) if n < 2000.0 => format!(", {n} CG iterations"),
        (_, tolerance) => format!(", CG to {tolerance}"),
    }
}

/// Describes all points together.
pub fn describe_all(rows: &[Row]) -> String {
    let sound = || {
        rows.iter()
            .filter(|r| matches!(r.text("state"), ACCURATE | "inaccurate"))
    };
    let worst = |column: &str, keep: &dyn Fn(&Row) -> bool| {
        let numbers = sound().filter(|r| keep(r)).map(|r| r.number(column));
        numbers.fold(0.0, f64::max)
    };
    let tolerance = |t: f64| {
        move |r: &Row| r.number("cg_tolerance") == t && r.number("cg_iterations") >= 2000.0
    };
    let implicit = |r: &Row| r.text("solver") == SolverKind::Implicit.name();
    let grid = |r: &Row| r.text("scene") == "pulled";
    let euler = |r: &Row| r.text("solver") == SolverKind::Explicit.name();
    let second_order = |r: &Row| {
        let mut kinds = SolverKind::ELEMENT_ONLY.iter();
        kinds.any(|k| k.name() == r.text("solver"))
    };
    let rapier = |r: &Row| r.text("solver") == RAPIER;
    let explicit =
        |r: &Row| !implicit(r) && !second_order(r) && !grid(r) && !euler(r) && !rapier(r);
    let of_grid = match rows.iter().any(grid) {
        true => format!(" {:.0e} for a grid body,", worst("f32_error", &grid)),
        false => String::new(),
    };
    format!(
        "Over all motions, the maximum error from f32 arithmetic is {:.0e} for explicit solvers, {:.0e} for explicit Euler, which amplifies errors,{of_grid} and {:.0e} for implicit Euler solved to 0.001; from conjugate gradients {:.0e} at tolerance 0.001 and {:.0e} with 5 iterations. The rest is the time discretisation error of the scheme. {} of {} points diverged; all were detected.\n",
        worst("f32_error", &explicit),
        worst("f32_error", &euler),
        worst("f32_error", &|r| implicit(r) && by_default(r)),
        worst("solver_error", &tolerance(1e-3)),
        worst("solver_error", &|r| r.number("cg_iterations") == 5.0),
        rows.iter()
            .filter(|r| r.text("state") == "diverged")
            .count(),
        rows.len(),
    )
}
