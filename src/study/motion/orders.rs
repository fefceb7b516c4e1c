//! Orders of convergence of the time integrators, in float64.

use crate::generate;
use crate::gpu::Gpu;
use crate::physics::{CpuTets, Material, Precision, Simulator, SolverKind};
use crate::study::reference_motion::{MotionState, ReferenceMotion};
use crate::study::{Axis, Chart, Row, Run, Series, SeriesStyle};
use crate::{Error, Result};
use glam::DVec3;

/// Duration of the motion, s.
const DURATION: f64 = 0.02;
/// Number of intervals between comparisons.
const STOPS: u32 = 4;
/// Damping times, s.
const DAMPED: [(&str, f64); 2] = [("undamped", 0.0), ("damped", 5e-4)];

/// Measures, draws two charts and returns the findings.
pub fn run(run: &Run) -> Result<(String, Vec<String>)> {
    let mut points = Vec::new();
    for (name, _) in DAMPED {
        for kind in SolverKind::ALL {
            for steps in ladder(kind, run.quick) {
                points.push(vec![name.into(), kind.name().into(), h(steps).into()]);
            }
        }
    }
    let mut known: Option<(String, Bar)> = None;
    let settings = ["motion", "solver", "h_s"];
    let rows = run.measure("motion_orders", &settings, &["error"], &points, |point| {
        let name = point[0].text();
        if known.as_ref().is_none_or(|k| k.0 != name) {
            let time = DAMPED.iter().find(|d| d.0 == name).map_or(0.0, |d| d.1);
            known = Some((name.to_owned(), Bar::new(run.gpu, time)?));
        }
        let steps = (h(1) / point[2].number()).round() as u32;
        let error = match &mut known {
            Some((_, bar)) => bar.error(point[1].text(), steps)?,
            None => f64::NAN,
        };
        Ok(vec![super::rounded(error)])
    })?;
    let mut text =
        String::from("| order of convergence | undamped | damped |\n| --- | --- | --- |\n");
    for kind in SolverKind::ALL {
        let orders =
            DAMPED.map(|(name, _)| ReferenceMotion::fitted_order(&places(&rows, name, kind)));
        text += &format!("| {kind} | {:.2} | {:.2} |\n", orders[0], orders[1]);
    }
    let mut charts = Vec::new();
    for (name, _) in DAMPED {
        let series = SolverKind::ALL.map(|kind| {
            let points = places(&rows, name, kind);
            let order = ReferenceMotion::fitted_order(&points);
            Series::new(
                format!("{kind}: order {order:.2}"),
                SeriesStyle::LineMarks,
                points,
            )
        });
        let chart = format!("motion_orders_{name}");
        Chart {
            title: format!("Order of convergence, {name}"),
            x: Axis::log("step h (s)"),
            y: Axis::log("relative L2 error in float64"),
            series: series.to_vec(),
        }
        .save(run.dir, &chart)?;
        charts.push(chart);
    }
    Ok((text, charts))
}

fn h(steps: u32) -> f64 {
    DURATION / f64::from(STOPS) / f64::from(steps)
}

/// Returns the numbers of steps between two stops.
fn ladder(kind: SolverKind, quick: bool) -> Vec<u32> {
    // The error of undamped explicit steps in the fastest modes vanishes only with many steps.
    let first = match kind {
        SolverKind::Explicit => 512,
        _ => 32,
    };
    let count = if quick { 3 } else { 5 };
    (0..count).map(|k| first << k).collect()
}

/// Returns the points (step, error).
fn places(rows: &[Row], name: &str, kind: SolverKind) -> Vec<[f64; 2]> {
    let rows = rows.iter();
    rows.filter(|r| r.text("motion") == name && r.text("solver") == kind.name())
        .map(|r| [r.number("h_s"), r.number("error")])
        .collect()
}

/// The paper's bar in float64, with its reference motion.
struct Bar {
    simulator: CpuTets,
    start: MotionState,
    truth: Vec<MotionState>,
    /// Norm of the displacement over all stops and nodes, m.
    way: f64,
}

impl Bar {
    /// Creates the bar, clamped at one end and twisted.
    fn new(gpu: &Gpu, damping_time: f64) -> Result<Bar> {
        let mesh = generate::paper_bar()?;
        let size = generate::PAPER_BAR_SIZE;
        let material = Material {
            damping_time,
            ..Material::uniform_springs(3_000.0, 0.0)
        };
        let (kind, settings) = ReferenceMotion::converged_scheme(SolverKind::VelocityVerlet);
        let mut simulator = CpuTets::new(
            gpu,
            mesh.clone(),
            &material,
            kind,
            settings,
            Precision::Double,
        )?;
        let nodes = (0u32..).zip(&mesh.nodes);
        let held: Vec<u32> = nodes.filter(|n| n.1.x < 1e-6).map(|n| n.0).collect();
        simulator.pin_nodes(&held)?;
        let gravity = DVec3::new(0.0, 0.0, -9.81);
        simulator.loads_mut().set_gravity(gravity);
        let mut start = MotionState::rest(&simulator);
        for (v, x) in start.v.iter_mut().zip(&mesh.nodes) {
            *v = 20.0 * x.x / size.x * DVec3::X.cross(*x - 0.5 * size);
        }
        let mut bar = Bar {
            simulator,
            start,
            truth: Vec::new(),
            way: 1.0,
        };
        let rest = MotionState::rest(&bar.simulator);
        if let Some(states) = bar.motion(SolverKind::Verlet, 64)? {
            bar.way = MotionState::distance(&states, &vec![rest; states.len()]);
        }
        let way = bar.way;
        let run = |steps| bar.motion(SolverKind::VelocityVerlet, steps);
        let found = ReferenceMotion::new(64, 1 << 12, 1e-9, way, run)?;
        let found = found.ok_or_else(|| {
            Error::Input("the reference motion of the bar diverges in float64".into())
        })?;
        bar.truth = found.states;
        Ok(bar)
    }

    fn motion(&mut self, kind: SolverKind, steps: u32) -> Result<Option<Vec<MotionState>>> {
        let steps = [STOPS, steps];
        ReferenceMotion::simulate(
            &mut self.simulator,
            &self.start,
            ReferenceMotion::converged_scheme(kind),
            DURATION,
            steps,
        )
    }

    fn error(&mut self, solver: &str, steps: u32) -> Result<f64> {
        let found = self.motion(solver.parse()?, steps)?;
        Ok(found.map_or(f64::NAN, |found| {
            MotionState::distance(&found, &self.truth) / self.way
        }))
    }
}
