//! Stability maps over step size and stiffness.

use super::cell::{ACCURATE, Method, STATES, Trial};
use crate::Result;
use crate::generate;
use crate::gpu::Gpu;
use crate::mesh::{QualityReport, TetMesh};
use crate::physics::{Material, SolverKind, Stiffness};
use crate::study::bodies;
use crate::study::{Axis, Cell, Row, Run, Series, SeriesStyle, StateMap};
use std::path::Path;

const SETTINGS: [&str; 5] = ["body", "solver", "damping_time_s", "stiffness", "step_s"];
const RESULTS: [&str; 4] = ["state", "error_percent", "steps", "limit_s"];

/// Stiffness-proportional damping, s; explicit Euler is then stable at the paper's step of 0.001 s
/// for its κ of 3,000 N/m.
const DAMPING: f64 = 1e-3;

const METHODS: [Method; 6] = [
    method("explicit", SolverKind::Explicit, None),
    method("symplectic", SolverKind::Symplectic, None),
    method("verlet", SolverKind::Verlet, None),
    method("velocity-verlet", SolverKind::VelocityVerlet, None),
    method("implicit", SolverKind::Implicit, None),
    method("implicit-10", SolverKind::Implicit, Some(10)),
];

const fn method(name: &'static str, kind: SolverKind, iterations: Option<u32>) -> Method {
    Method {
        name,
        kind,
        iterations,
    }
}

/// A body to map.
struct Subject {
    name: String,
    mesh: TetMesh,
    material: Material,
    /// Nodes up to this x are pinned.
    held: f64,
    /// Stiffness: axis label and values.
    axis: &'static str,
    stiffnesses: Vec<f64>,
    steps: Vec<f64>,
    dampings: Vec<f64>,
    methods: Vec<Method>,
}

impl Subject {
    fn material(&self, stiffness: f64, damping_time: f64) -> Material {
        Material {
            stiffness: match self.material.stiffness {
                Stiffness::Young(_) => Stiffness::Young(stiffness),
                Stiffness::Uniform(_) => Stiffness::Uniform(stiffness),
            },
            damping_time,
            ..self.material.clone()
        }
    }

    fn trial(&self, gpu: &Gpu, stiffness: f64, damping_time: f64) -> Result<Trial> {
        let material = self.material(stiffness, damping_time);
        Trial::new(gpu, &self.mesh, &material, |p| p.x <= self.held)
    }

    fn points(&self) -> Vec<Vec<Cell>> {
        let mut points = Vec::new();
        for damping in &self.dampings {
            for stiffness in &self.stiffnesses {
                for method in &self.methods {
                    for step in &self.steps {
                        points.push(vec![
                            self.name.clone().into(),
                            method.name.into(),
                            (*damping).into(),
                            (*stiffness).into(),
                            (*step).into(),
                        ]);
                    }
                }
            }
        }
        points
    }
}

/// `per` values a decade from 10^`from` to 10^`to`, rounded as people round.
fn decades(from: i32, to: i32, within: &[f64]) -> Vec<f64> {
    let mut values: Vec<f64> = (from..to)
        .flat_map(|d| within.iter().map(move |w| format!("{w}e{d}")))
        .chain([format!("1e{to}")])
        .filter_map(|text| text.parse().ok())
        .collect();
    values.sort_by(f64::total_cmp);
    values
}

fn bar(quick: bool) -> Result<Subject> {
    let few = [METHODS[1], METHODS[2], METHODS[4]];
    let mut stiffnesses = decades(2, 6, &[1.0, 3.0]);
    stiffnesses.extend([3e6]);
    Ok(Subject {
        name: "bar".to_owned(),
        mesh: generate::paper_bar()?,
        // Damped along the springs, so that the modes decouple.
        material: Material {
            stiffness: Stiffness::Uniform(1.0),
            ..Material::from_young(1.0)
        },
        held: 1e-3,
        axis: "spring constant κ (N/m)",
        stiffnesses: if quick { vec![3e3, 3e4] } else { stiffnesses },
        steps: match quick {
            true => vec![1e-4, 1e-3, 1e-2, 5e-2],
            false => decades(-5, 0, &[1.0, 2.0, 5.0]),
        },
        dampings: if quick { vec![0.0] } else { vec![0.0, DAMPING] },
        methods: if quick {
            few.to_vec()
        } else {
            METHODS.to_vec()
        },
    })
}

/// Returns a body with slivers; `unit` is its length unit in metres.
fn slivered(name: String, mesh: TetMesh, unit: f64, quick: bool) -> Subject {
    let (low, high) = mesh.bounds();
    Subject {
        name,
        held: low.x + 0.05 * (high.x - low.x),
        mesh,
        material: Material {
            length_unit: unit,
            density: 1060.0,
            ..Material::from_young(1.0)
        },
        axis: "Young's modulus (Pa)",
        stiffnesses: match quick {
            true => vec![1e4],
            false => decades(3, 7, &[1.0]),
        },
        steps: match quick {
            true => vec![1e-4, 1e-3, 1e-2],
            false => decades(-5, 0, &[1.0, 3.0]),
        },
        dampings: if quick { vec![0.0] } else { vec![0.0, DAMPING] },
        methods: match quick {
            true => vec![METHODS[2], METHODS[4]],
            false => METHODS[..5].to_vec(),
        },
    }
}

/// Returns the second body: the named one, or a generated one with slivers.
fn second(named: Option<&Path>, quick: bool) -> Result<Subject> {
    let Some(path) = named else {
        return Ok(slivered(
            "hollow".to_owned(),
            bodies::hollow()?,
            0.01,
            quick,
        ));
    };
    let scene = bodies::named(path)?;
    let mesh = scene.mesh_of_one()?;
    let unit = scene.mesh.unit.as_ref().map(|u| u.metres()).transpose()?;
    let unit = unit.or(mesh.length_unit).unwrap_or(1.0);
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(slivered(name.into_owned(), mesh, unit, quick))
}

pub fn run(run: &Run, named: Option<&Path>) -> Result<()> {
    // Read first, so that an unreadable file is reported before hours of work.
    let second = match (run.quick, named) {
        (true, None) => None,
        _ => Some(second(named, run.quick)?),
    };
    let bar = bar(run.quick)?;
    let mut text = finding_of_bar(&measure(run, &bar)?);
    let mut charts = draw(run, &bar)?;
    if let Some(second) = second {
        let rows = measure(run, &second)?;
        text += &finding_of_slivers(&second, &rows);
        charts.extend(draw(run, &second)?);
    }
    let charts: Vec<&str> = charts.iter().map(String::as_str).collect();
    run.write_findings(
        "stability",
        "Stability over step size and stiffness",
        &text,
        &charts,
    )
}

fn measure(run: &Run, subject: &Subject) -> Result<Vec<Row>> {
    let mut known: Option<([f64; 2], Trial)> = None;
    run.measure(
        "stability",
        &SETTINGS,
        &RESULTS,
        &subject.points(),
        |point| {
            let [damping, stiffness, step] = [2, 3, 4].map(|i| point[i].number());
            let trial = match known.take() {
                Some((of, trial)) if of == [damping, stiffness] => trial,
                _ => subject.trial(run.gpu, stiffness, damping)?,
            };
            let method = subject
                .methods
                .iter()
                .find(|m| m.name == point[1].text())
                .copied()
                .unwrap_or(METHODS[0]);
            let outcome = trial.run(run.gpu, method, step)?;
            let limit = trial.limit(method.kind).unwrap_or(f64::INFINITY);
            known = Some(([damping, stiffness], trial));
            Ok(vec![
                STATES[outcome.state].into(),
                (100.0 * outcome.error).into(),
                (outcome.steps as f64).into(),
                limit.into(),
            ])
        },
    )
}

/// Measures a body and draws its maps; returns their names.
fn draw(run: &Run, subject: &Subject) -> Result<Vec<String>> {
    let mut charts = Vec::new();
    let rows = measure(run, subject)?;
    for method in &subject.methods {
        for damping in &subject.dampings {
            let damped = if *damping > 0.0 { "-damped" } else { "" };
            let state = |stiffness: f64, step: f64| {
                let row = at(&rows, method.name, *damping, stiffness, step);
                row.and_then(|r| STATES.iter().position(|s| *s == r.text("state")))
            };
            let cells = subject.stiffnesses.iter().flat_map(|k| {
                let of = subject.steps.iter().map(|h| state(*k, *h));
                of.map(|s| s.unwrap_or(usize::MAX)).collect::<Vec<_>>()
            });
            let kind = match damping {
                0.0 => "undamped".to_owned(),
                _ => format!("damped by {damping} s·κ"),
            };
            let map = StateMap {
                title: format!("{}, {}, {kind}", subject.name, method.name),
                x: Axis::log("step h (s)"),
                y: Axis::log(subject.axis),
                xs: subject.steps.clone(),
                ys: subject.stiffnesses.clone(),
                states: STATES.map(str::to_owned).to_vec(),
                cells: cells.collect(),
                curves: limits(subject, *method, *damping)?,
            };
            let name = format!("stability-{}-{}{damped}", subject.name, method.name);
            map.save(run.dir, &name)?;
            charts.push(name);
        }
    }
    Ok(charts)
}

/// Returns the largest stable step by theory, over the stiffnesses of the map and beyond.
fn limits(subject: &Subject, method: Method, damping: f64) -> Result<Vec<Series>> {
    let [first, last] = [0, subject.stiffnesses.len() - 1].map(|i| subject.stiffnesses[i]);
    let mut points = Vec::new();
    for i in 0..=40 {
        let share = -0.5 + 2.0 * f64::from(i) / 40.0;
        let stiffness = first * (last / first).powf(share);
        let material = subject.material(stiffness, damping);
        let model = crate::physics::DiscreteModel::new(&subject.mesh, &material)?;
        let pinned: Vec<bool> = subject
            .mesh
            .nodes
            .iter()
            .map(|p| p.x <= subject.held)
            .collect();
        match crate::physics::largest_stable_step(&model, &pinned, method.kind) {
            Some(h) if h > 0.0 => points.push([h, stiffness]),
            _ => {}
        }
    }
    Ok(match points.is_empty() {
        true => Vec::new(),
        false => vec![Series::new("limit by theory", SeriesStyle::Dashed, points)],
    })
}

fn at<'a>(
    rows: &'a [Row],
    solver: &str,
    damping: f64,
    stiffness: f64,
    step: f64,
) -> Option<&'a Row> {
    rows.iter().find(|r| {
        r.text("solver") == solver
            && r.number("damping_time_s") == damping
            && r.number("stiffness") == stiffness
            && r.number("step_s") == step
    })
}

/// Describes a cell: its state, and its error if there is one.
fn describe_cell(row: Option<&Row>) -> String {
    match row {
        None => "not measured".into(),
        Some(r) if r.number("error_percent").is_finite() => {
            format!(
                "{} (error {:.1} %)",
                r.text("state"),
                r.number("error_percent")
            )
        }
        Some(r) => format!("{} at step {}", r.text("state"), r.number("steps") + 1.0),
    }
}

/// Describes the agreement of the explicit solvers with theory: stable cells below the limit,
/// failed cells above it, and how far undamped explicit Euler, which has no limit, gets.
fn agreement(rows: &[Row]) -> String {
    let (mut below, mut above, mut never) = ([0, 0], [0, 0], [0, 0]);
    for row in rows {
        let (limit, step) = (row.number("limit_s"), row.number("step_s"));
        if !limit.is_finite() {
            continue;
        }
        let failed = usize::from(row.text("state") == "diverged");
        let (of, expected) = match (limit == 0.0, step <= limit) {
            (true, _) => (&mut never, failed),
            (_, true) => (&mut below, 1 - failed),
            _ => (&mut above, failed),
        };
        of[0] += 1;
        of[1] += expected;
    }
    let mut text = format!(
        "Below the theoretical limit, {} of {} cells of the explicit solvers are stable; above it, {} of {} failed and were stopped.",
        below[1], below[0], above[1], above[0]
    );
    if never[0] > 0 {
        text += &format!(
            " Undamped explicit Euler has no stable step: {} of its {} cells failed; in the others, 500 steps are too few to show the divergence.",
            never[1], never[0]
        );
    }
    text
}

fn implicit(rows: &[Row]) -> String {
    let cells: Vec<&Row> = rows
        .iter()
        .filter(|r| r.text("solver") == "implicit")
        .collect();
    let count = |state: &str| cells.iter().filter(|r| r.text("state") == state).count();
    format!(
        "Of {} cells of implicit Euler, {} diverged, conjugate gradients did not converge in {}, and {} are stable with an error above {} %.",
        cells.len(),
        count("diverged"),
        count("CG not converged"),
        count("inaccurate"),
        100.0 * ACCURATE
    )
}

fn finding_of_bar(rows: &[Row]) -> String {
    let cell = |solver: &str, damping, k, h| describe_cell(at(rows, solver, damping, k, h));
    let mut text = format!(
        "The paper's bar (80 tets, clamped at one end, released under gravity), at most 500 steps per cell, compared with float64 over about two oscillations. {} {}\n\nThe settings of the paper: Verlet at κ = 3,000 N/m and h = 0.001 s: {}; at 30,000 N/m: {}; at 3,000 N/m and h = 0.01 s: {}. Implicit Euler at κ = 30,000 N/m and h = 0.01 s: {}; at h = 0.05 s, as suggested by the paper: {}",
        agreement(rows),
        implicit(rows),
        cell("verlet", 0.0, 3e3, 1e-3),
        cell("verlet", 0.0, 3e4, 1e-3),
        cell("verlet", 0.0, 3e3, 1e-2),
        cell("implicit", 0.0, 3e4, 1e-2),
        cell("implicit", 0.0, 3e4, 5e-2),
    );
    if at(rows, "explicit", DAMPING, 3e3, 1e-3).is_some() {
        text += &format!(
            "; at κ = 3,000,000 N/m and h = 0.01 s: {}. Explicit Euler at κ = 3,000 N/m and h = 0.001 s is {} undamped, and {} damped by {DAMPING} s·κ",
            cell("implicit", 0.0, 3e6, 1e-2),
            cell("explicit", 0.0, 3e3, 1e-3),
            cell("explicit", DAMPING, 3e3, 1e-3),
        );
    }
    text + "."
}

fn finding_of_slivers(body: &Subject, rows: &[Row]) -> String {
    let quality = QualityReport::new(&body.mesh);
    format!(
        "\n\nThe body \"{}\" ({} tets, of which {} are slivers; minimum dihedral angle {:.1}°). {} {} Verlet at 10 kPa and h = 0.001 s is {}, implicit Euler at h = 0.01 s {}.",
        body.name,
        body.mesh.tets.len(),
        quality.slivers,
        quality.min_dihedral,
        agreement(rows),
        implicit(rows),
        describe_cell(at(rows, "verlet", 0.0, 1e4, 1e-3)),
        describe_cell(at(rows, "implicit", 0.0, 1e4, 1e-2)),
    )
}
