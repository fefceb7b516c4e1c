//! `study motion`: the error of every solver, step and linear solve against a float64 reference,
//! split by its source, over its cost; orders of convergence; and the model error.

mod device;
mod model;
mod orders;
mod picture;
mod scenes;
mod setting;
mod trial;

use super::{Cell, Row, Run};
use crate::Result;
use crate::physics::{CgSettings, SolverKind};
use crate::study::reference_motion::ReferenceMotion;
use setting::MotionSetting;
use std::path::Path;
use trial::{MotionTrial, STOPS};

/// Columns of `motion.csv` that identify a point.
const SETTINGS: [&str; 7] = [
    "scene",
    "stiffness",
    "stiffness_unit",
    "solver",
    "h_s",
    "cg_tolerance",
    "cg_iterations",
];

/// Columns of results.
const RESULTS: [&str; 11] = [
    "state",
    "error",
    "largest_node_error",
    "time_error",
    "solver_error",
    "f32_error",
    "energy_error",
    "volume_error",
    "ms_per_simulated_s",
    "steps",
    "iterations_a_step",
];

/// Maximum number of steps of one motion.
const MAX_STEPS: u32 = 20_000;

/// Conjugate gradient settings: converged, default, and stopped early.
const SOLVES: [(f64, u32); 5] = [
    (1e-3, 2000),
    (1e-2, 2000),
    (1e-5, 2000),
    (1e-7, 20),
    (1e-7, 5),
];

/// Runs the study on the built-in scenes or on the user's scene.
///
/// # Errors
/// An error if a scene cannot be read or studied, a folder cannot be written, or the device fails.
pub fn run(run: &Run, scene: Option<&Path>) -> Result<()> {
    let mut trials = match scene {
        None => scenes::all(run.gpu, run.quick)?,
        Some(path) => vec![scenes::of_file(run.gpu, path)?],
    };
    let points: Vec<(usize, MotionSetting)> = (0..trials.len())
        .flat_map(|t| {
            settings(&trials[t], run.quick)
                .into_iter()
                .map(move |s| (t, s))
        })
        .collect();
    let cells: Vec<Vec<Cell>> = points
        .iter()
        .map(|(t, setting)| cells(&trials[*t], *setting))
        .collect();
    let truths = truths(run, &mut trials)?;
    let rows = run.measure("motion", &SETTINGS, &RESULTS, &cells, |cell| {
        let known = cells.iter().position(|c| c == cell);
        let Some((t, setting)) = known.map(|k| points[k]) else {
            return Ok(Vec::new());
        };
        let found = trials[t].measure(setting)?;
        let numbers = [
            found.error,
            found.largest,
            found.scheme_error,
            found.solver_error,
            found.f32_error,
            found.energy,
            found.volume,
            found.ms,
            f64::from(STOPS * setting.steps),
            found.iterations,
        ];
        let mut results = vec![Cell::from(found.state)];
        results.extend(numbers.map(rounded));
        Ok(results)
    })?;
    let mut charts = Vec::new();
    let mut text = String::new();
    for trial in &trials {
        let rows = of(&rows, trial);
        charts.push(picture::chart_error_over_time(run, trial, &rows)?);
        text += &picture::describe_trial(trial, &rows, &of(&truths, trial));
    }
    if let Some(trial) = trials.first() {
        charts.push(picture::error_components(run, trial, &of(&rows, trial))?);
    }
    text += &picture::describe_all(&rows);
    if let Some(trial) = trials.first() {
        text += &format!("Engine: {}.\n", trial.engine());
    }
    if scene.is_none() {
        let (orders, drawn) = orders::run(run)?;
        let (model, drawn_model) = model::run(run)?;
        text += &format!(
            "\n{orders}\nVerlet damps with the velocity of half a step earlier and drops to first order with damping; velocity Verlet damps with the new velocity and stays second order.\n\n{model}"
        );
        charts.extend(drawn);
        charts.extend(drawn_model);
    }
    let charts: Vec<&str> = charts.iter().map(String::as_str).collect();
    run.write_findings(
        "motion",
        "Motion: accuracy against cost",
        text.trim(),
        &charts,
    )
}

/// Returns the rows of a trial.
fn of(rows: &[Row], trial: &MotionTrial) -> Vec<Row> {
    let rows = rows.iter();
    rows.filter(|r| r.text("scene") == trial.name && r.number("stiffness") == trial.stiffness)
        .cloned()
        .collect()
}

/// Reports how the reference of each trial was obtained.
fn truths(run: &Run, trials: &mut [MotionTrial]) -> Result<Vec<Row>> {
    let points: Vec<Vec<Cell>> = trials
        .iter()
        .map(|t| vec![t.name.as_str().into(), t.stiffness.into(), t.unit.into()])
        .collect();
    let results = [
        "truth",
        "h_s",
        "change_by_halving",
        "order_of_change",
        "change_of_extrapolation",
        "halvings",
    ];
    run.measure("motion_truth", &SETTINGS[..3], &results, &points, |point| {
        let Some(k) = points.iter().position(|p| p == point) else {
            return Ok(Vec::new());
        };
        let trial = &mut trials[k];
        let halvings = trial.reference()?.halvings.clone();
        let Some(last) = halvings.last() else {
            let mut cells = vec![Cell::from("exact")];
            cells.extend([0.0; 5].map(Cell::from));
            return Ok(cells);
        };
        let all = halvings.iter();
        let changes: Vec<[f64; 2]> = all.map(|x| [trial.h(x.steps), x.change]).collect();
        Ok(vec![
            "float64, extrapolated".into(),
            rounded(trial.h(2 * last.steps)),
            rounded(last.change),
            rounded(ReferenceMotion::fitted_order(&changes)),
            rounded(last.extrapolated),
            halvings.len().into(),
        ])
    })
}

/// Returns the settings to measure for a trial.
fn settings(trial: &MotionTrial, quick: bool) -> Vec<MotionSetting> {
    let simple = trial.name == "falling" || trial.name == "spring";
    let kinds = trial.kinds();
    let kinds = kinds.into_iter().filter(|kind| {
        let three = [
            SolverKind::Symplectic,
            SolverKind::VelocityVerlet,
            SolverKind::Implicit,
        ];
        let second_order = SolverKind::ELEMENT_ONLY.contains(kind);
        !quick || kinds_of_one(trial) || three.contains(kind) || second_order
    });
    let mut settings = Vec::new();
    for kind in kinds {
        let steps: Vec<u32> = match kind {
            kind if kind.is_implicit() => {
                // Implicit Euler is refined until it is as accurate as the second-order schemes, if
                // there are any.
                let beside = trial.kinds().contains(&SolverKind::Bdf2);
                let halvings = match (quick, beside && kind == SolverKind::Implicit) {
                    (true, _) => 4,
                    (false, true) => 12,
                    (false, false) => 7,
                };
                (0..halvings).map(|k| 2 << k).collect()
            }
            _ => {
                // One step above the stability limit, then halved steps.
                let first = (trial.fewest_stable(kind) / 2).max(1);
                (0..if quick { 4 } else { 6 }).map(|k| first << k).collect()
            }
        };
        let solves: &[(f64, u32)] = match (kind.is_implicit(), quick || simple) {
            (true, false) => &SOLVES,
            (true, true) => &[SOLVES[0], SOLVES[4]],
            (false, _) => &[],
        };
        for steps in steps.into_iter().filter(|n| STOPS * n <= MAX_STEPS) {
            let setting = |cg| MotionSetting {
                kind,
                steps,
                cg,
                rapier: false,
            };
            match solves {
                [] => settings.push(setting(None)),
                solves => settings.extend(solves.iter().map(|cg| setting(Some(*cg)))),
            }
        }
    }
    if trial.has_rapier() {
        let steps = (0..if quick { 4 } else { 8 }).map(|k| 2 << k);
        settings.extend(steps.map(|steps| MotionSetting {
            kind: SolverKind::Implicit,
            steps,
            cg: Some(SOLVES[0]),
            rapier: true,
        }));
    }
    settings
}

/// Whether only one solver can move it.
fn kinds_of_one(trial: &MotionTrial) -> bool {
    trial.kinds().len() == 1
}

fn cells(trial: &MotionTrial, setting: MotionSetting) -> Vec<Cell> {
    let (tolerance, iterations) = match setting.cg {
        None => (Cell::from(""), Cell::from("")),
        // No residual is listed if the iteration limit decides.
        Some((tolerance, most)) => (tolerance.into(), (most as usize).into()),
    };
    vec![
        trial.name.as_str().into(),
        trial.stiffness.into(),
        trial.unit.into(),
        setting.name().into(),
        trial.h(setting.steps).into(),
        tolerance,
        iterations,
    ]
}

/// Whether the linear solves of a row use the default stopping criteria, or it has none.
fn by_default(row: &Row) -> bool {
    let default = CgSettings::default();
    // Explicit schemes solve no linear systems.
    row.number("cg_iterations").is_nan()
        || row.number("cg_tolerance") == default.tolerance
            && row.number("cg_iterations") == f64::from(default.max_iterations)
}

/// Rounds a number to its significant digits.
fn rounded(value: f64) -> Cell {
    let text = format!("{value:.3e}");
    Cell::Number(text.parse().unwrap_or(value))
}
