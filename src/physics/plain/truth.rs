//! Motions in float64, and the motion that they tend to as the step goes to nothing: what every
//! solver's error is measured against.

use super::springs::Particles;
use super::steppers::{self, VelocityVerlet, Verlet};
use crate::physics::SolverKind;
use crate::physics::grid::plain::GridTwin;
use glam::DVec3;

/// A body farther than this from where it began, in its own sizes, has flown apart.
const FARTHEST: f64 = 1e4;

/// Where a body is, and how it moves.
#[derive(Clone, Debug)]
pub struct State {
    /// Positions, m.
    pub x: Vec<DVec3>,
    /// Velocities, m/s.
    pub v: Vec<DVec3>,
}

/// A solver of `physics` as its float64 twin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwinScheme {
    /// Which.
    pub kind: SolverKind,
    /// Where conjugate gradients stop: the relative residual.
    pub tolerance: f64,
    /// The most iterations a step.
    pub iterations: u32,
}

impl TwinScheme {
    /// The solver, its linear systems solved to the last digits.
    pub fn converged(kind: SolverKind) -> TwinScheme {
        TwinScheme {
            kind,
            tolerance: 1e-12,
            iterations: u32::MAX,
        }
    }
}

/// The states of `start` after each of `stops` equal spans of `duration` seconds in all, each span
/// in `steps` steps; `None` where the body flies apart.
pub fn motion(
    start: &Particles,
    scheme: TwinScheme,
    duration: f64,
    stops: u32,
    steps: u32,
) -> Option<Vec<State>> {
    let h = duration / f64::from(stops) / f64::from(steps);
    let limit = FARTHEST * reach(&start.network.rest);
    let mut p = start.clone();
    let mut verlet = Verlet::default();
    let mut velocity_verlet = VelocityVerlet::default();
    let mut states = Vec::new();
    for _ in 0..stops {
        for _ in 0..steps {
            match scheme.kind {
                SolverKind::Explicit => steppers::explicit_euler(&mut p, h),
                SolverKind::Symplectic => steppers::symplectic_euler(&mut p, h),
                SolverKind::Verlet => verlet.step(&mut p, h),
                SolverKind::VelocityVerlet => velocity_verlet.step(&mut p, h),
                SolverKind::Implicit => {
                    let most = scheme.iterations.min(20 * p.x.len() as u32);
                    steppers::implicit_euler_within(&mut p, h, scheme.tolerance, most);
                }
            }
            if !p.x[0].is_finite() {
                return None;
            }
        }
        states.push(settled(&p.x, p.v.clone(), limit)?);
    }
    Some(states)
}

/// The same of a grid body that starts at rest.
pub fn grid_motion(start: &GridTwin, duration: f64, stops: u32, steps: u32) -> Option<Vec<State>> {
    let h = duration / f64::from(stops) / f64::from(steps);
    let limit = FARTHEST * reach(&start.x);
    let mut p = start.clone();
    let mut states = Vec::new();
    for stop in 0..stops {
        for step in 0..steps {
            if stop == 0 && step == 0 {
                p.first_step(h);
            } else {
                p.step(h);
            }
        }
        let lags = p.x.iter().zip(&p.previous);
        let v = lags.map(|(x, before)| (*x - *before) / h).collect();
        states.push(settled(&p.x, v, limit)?);
    }
    Some(states)
}

fn reach(x: &[DVec3]) -> f64 {
    let (low, high) = crate::mesh::bounds(x);
    (high - low).max_element()
}

fn settled(x: &[DVec3], v: Vec<DVec3>, limit: f64) -> Option<State> {
    let sound = |x: &DVec3| x.is_finite() && x.abs().max_element() < limit;
    x.iter().all(sound).then(|| State { x: x.to_vec(), v })
}

/// √ΣΣ|x − y|² over the nodes of all states, m.
pub fn distance(a: &[State], b: &[State]) -> f64 {
    let squares = a.iter().zip(b).flat_map(|(a, b)| {
        let nodes = a.x.iter().zip(&b.x);
        nodes.map(|(x, y)| x.distance_squared(*y))
    });
    squares.sum::<f64>().sqrt()
}

/// A motion that no smaller step would change by anything that matters.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Its states: those of the two smallest steps, extrapolated.
    pub states: Vec<State>,
    /// What halving the step did, the largest step first.
    pub halvings: Vec<Halving>,
}

/// What halving a step changed, relative to the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Halving {
    /// Steps between two stops, before it was halved.
    pub steps: u32,
    /// |x(h) − x(h/2)|.
    pub change: f64,
    /// |X(2h) − X(h)| of what Richardson extrapolates, X(h) = x(h/2) + (x(h/2) − x(h))/3; not a
    /// number at first.
    pub extrapolated: f64,
}

/// The motion of a scheme of second order, `run` with a number of steps between two stops, in the
/// limit of small steps: from `steps` on the step is halved until what Richardson extrapolates
/// changes by less than `tolerance` of `scale` (m), or until `most` steps. `None` where no two
/// steps gave a motion.
pub fn truth(
    steps: u32,
    most: u32,
    tolerance: f64,
    scale: f64,
    mut run: impl FnMut(u32) -> Option<Vec<State>>,
) -> Option<Truth> {
    let mut steps = steps.max(1);
    let mut coarse = run(steps);
    let mut truth: Option<Truth> = None;
    while steps <= most / 2 {
        let fine = run(2 * steps);
        if let (Some(a), Some(b)) = (&coarse, &fine) {
            let states = extrapolate(a, b);
            let known = truth.take();
            let extrapolated = known
                .as_ref()
                .map_or(f64::NAN, |t| distance(&t.states, &states) / scale);
            let mut halvings = known.map_or(Vec::new(), |t| t.halvings);
            halvings.push(Halving {
                steps,
                change: distance(a, b) / scale,
                extrapolated,
            });
            truth = Some(Truth { states, halvings });
            if extrapolated < tolerance {
                break;
            }
        }
        coarse = fine;
        steps *= 2;
    }
    truth
}

fn extrapolate(coarse: &[State], fine: &[State]) -> Vec<State> {
    let better = |a: &[DVec3], b: &[DVec3]| -> Vec<DVec3> {
        let pairs = a.iter().zip(b);
        pairs.map(|(a, b)| *b + (*b - *a) / 3.0).collect()
    };
    let states = coarse.iter().zip(fine);
    states
        .map(|(a, b)| State {
            x: better(&a.x, &b.x),
            v: better(&a.v, &b.v),
        })
        .collect()
}

/// The exponent p of y ~ xᵖ: the slope of the straight line through the points' logarithms, by
/// least squares. Points that are not positive have none and are left out; not a number for fewer
/// than two.
pub fn fitted_order(points: &[[f64; 2]]) -> f64 {
    let logs: Vec<[f64; 2]> = points
        .iter()
        .map(|p| p.map(f64::ln))
        .filter(|p| p.iter().all(|c| c.is_finite()))
        .collect();
    let mean = |k: usize| logs.iter().map(|p| p[k]).sum::<f64>() / logs.len() as f64;
    let (x, y) = (mean(0), mean(1));
    let up: f64 = logs.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
    let along: f64 = logs.iter().map(|p| (p[0] - x).powi(2)).sum();
    up / along
}
