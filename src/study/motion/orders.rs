//! How fast the schemes come to the truth as the step shrinks, in float64.

use crate::mesh::generate;
use crate::physics::plain::springs::Particles;
use crate::physics::plain::truth::{State, TwinScheme, distance, fitted_order, motion, truth};
use crate::physics::{Material, SolverKind, SpringNetwork};
use crate::study::{Axis, Chart, Look, Row, Run, Series};
use crate::{Error, Result};
use glam::DVec3;

/// Seconds that the bar swings.
const DURATION: f64 = 0.02;
/// Spans between two comparisons.
const STOPS: u32 = 4;
/// Damping times, s.
const DAMPED: [(&str, f64); 2] = [("undamped", 0.0), ("damped", 5e-4)];

/// Measures, draws two charts and returns what was found.
pub fn run(run: &Run) -> Result<(String, Vec<String>)> {
    let mut points = Vec::new();
    for (name, _) in DAMPED {
        for kind in SolverKind::ALL {
            for steps in ladder(kind, run.quick) {
                points.push(vec![name.into(), kind.name().into(), h(steps).into()]);
            }
        }
    }
    let mut known: Option<(String, Particles, Vec<State>)> = None;
    let settings = ["motion", "solver", "h_s"];
    let rows = run.measure("motion_orders", &settings, &["error"], &points, |point| {
        let name = point[0].text();
        if known.as_ref().is_none_or(|k| k.0 != name) {
            let time = DAMPED.iter().find(|d| d.0 == name).map_or(0.0, |d| d.1);
            let p = bar(time)?;
            let states = exact(&p)?;
            known = Some((name.to_owned(), p, states));
        }
        let error = known.as_ref().map_or(f64::NAN, |(_, p, states)| {
            let steps = (h(1) / point[2].number()).round() as u32;
            error(p, point[1].text(), steps, states)
        });
        Ok(vec![super::rounded(error)])
    })?;
    let mut text =
        String::from("| order of convergence | undamped | damped |\n| --- | --- | --- |\n");
    for kind in SolverKind::ALL {
        let orders = DAMPED.map(|(name, _)| fitted_order(&places(&rows, name, kind)));
        text += &format!("| {kind} | {:.2} | {:.2} |\n", orders[0], orders[1]);
    }
    let mut charts = Vec::new();
    for (name, _) in DAMPED {
        let series = SolverKind::ALL.map(|kind| {
            let points = places(&rows, name, kind);
            let order = fitted_order(&points);
            Series::new(format!("{kind}: order {order:.2}"), Look::LineMarks, points)
        });
        let chart = format!("motion_orders_{name}");
        Chart {
            title: format!("Order of convergence, {name}"),
            x: Axis::log("step h (s)"),
            y: Axis::log("relative L2 error of the float64 twin"),
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

/// Steps between two stops.
fn ladder(kind: SolverKind, quick: bool) -> Vec<u32> {
    // What an undamped explicit step adds to the fastest modes fades only with many steps.
    let first = match kind {
        SolverKind::Explicit => 512,
        _ => 32,
    };
    let count = if quick { 3 } else { 5 };
    (0..count).map(|k| first << k).collect()
}

/// Errors over steps.
fn places(rows: &[Row], name: &str, kind: SolverKind) -> Vec<[f64; 2]> {
    let rows = rows.iter();
    rows.filter(|r| r.text("motion") == name && r.text("solver") == kind.name())
        .map(|r| [r.number("h_s"), r.number("error")])
        .collect()
}

/// The paper's bar, held at one end and given a turn.
fn bar(damping_time: f64) -> Result<Particles> {
    let mesh = generate::paper_bar()?;
    let size = generate::PAPER_BAR_SIZE;
    let material = Material {
        damping_time,
        ..Material::paper(3_000.0, 0.0)
    };
    let mut p = Particles::new(SpringNetwork::new(&mesh, &material)?);
    p.gravity = DVec3::new(0.0, 0.0, -9.81);
    for (i, x) in mesh.nodes.iter().enumerate() {
        let from_axis = *x - 0.5 * size;
        p.pinned[i] = x.x < 1e-6;
        p.v[i] = 20.0 * x.x / size.x * DVec3::X.cross(from_axis);
    }
    Ok(p)
}

fn exact(p: &Particles) -> Result<Vec<State>> {
    let scheme = TwinScheme::converged(SolverKind::VelocityVerlet);
    let run = |steps| motion(p, scheme, DURATION, STOPS, steps);
    truth(64, 1 << 12, 1e-9, way(p), run)
        .map(|t| t.states)
        .ok_or_else(|| Error::Input("the bar flies apart in float64".into()))
}

/// About how far the bar moves, over all stops and nodes, m.
fn way(p: &Particles) -> f64 {
    let run = motion(
        p,
        TwinScheme::converged(SolverKind::Verlet),
        DURATION,
        STOPS,
        64,
    );
    let rest = State {
        x: p.network.rest.clone(),
        v: Vec::new(),
    };
    run.map_or(1.0, |states| distance(&states, &vec![rest; states.len()]))
}

fn error(p: &Particles, solver: &str, steps: u32, truth: &[State]) -> f64 {
    let Ok(kind) = solver.parse::<SolverKind>() else {
        return f64::NAN;
    };
    let found = motion(p, TwinScheme::converged(kind), DURATION, STOPS, steps);
    found.map_or(f64::NAN, |found| distance(&found, truth) / way(p))
}
