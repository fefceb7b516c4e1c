//! `--within`: a body is solved on finer and finer meshes until a number is within a share of itself.
//!
//! The first mesh is that of the scene. The order of its elements is raised first, if it can be; then
//! the elements that carry most of the error are divided. The spaces of these rounds contain each
//! other, so that the last change of the number, and how fast the error in energy decreases, tell how
//! far the number is from its limit (`docs/validation/refinement.md`).

use crate::mesh::{ElementOrder, FinerSpace, TetMesh};
use crate::progress::ProgressScope;
use crate::scene::AccuracyEntry;
use crate::{Error, ProgressFn, Result};
use glam::DVec3;
use serde::Serialize;
use web_time::Instant;

/// Share of the error in energy that the divided elements carry: the largest, far from the goal, and the
/// smallest.
const MOST_DIVIDED: f64 = 0.8;
const LEAST_DIVIDED: f64 = 0.3;
/// Part of the error of divided elements that is left, and of the wanted error at which a division aims.
const LEFT_BY_DIVISION: f64 = 0.1;
const AIM: f64 = 0.9;
/// Safety factor of the error of a number.
const SAFETY: f64 = 2.0;
/// Smallest and largest ratio of the errors of two rounds that is relied on.
const DECREASE: [f64; 2] = [0.2, 0.9];
/// Largest number of rounds.
const MAX_ROUNDS: usize = 12;
/// Largest number of meshes one after the other that lack a solution: they are divided again, at the
/// last state that they have.
const MAX_STOPPED: usize = 2;

/// How exact a number has to be.
#[derive(Clone, Copy, Debug)]
struct Goal {
    /// Largest error, relative to the number.
    share: f64,
    max_elements: usize,
}

impl Goal {
    fn new(wanted: &AccuracyEntry) -> Result<Goal> {
        let share = wanted.within.ok_or_else(|| {
            Error::Input("a refined body needs the largest error of its number; set it ([accuracy] within = \"2%\", --within 2%)".into())
        })?;
        Ok(Goal {
            share,
            max_elements: wanted.max_tets.unwrap_or(AccuracyEntry::MAX_TETS),
        })
    }
}

/// One mesh on the way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Round {
    /// Order of its elements.
    pub order: u32,
    /// Number of its elements.
    pub elements: usize,
    /// Number of its nodes.
    pub nodes: usize,
    /// The number, in its unit.
    pub value: f64,
    /// Its error; `None` in the first round.
    pub error: Option<f64>,
    /// Computing time of the round, s.
    pub seconds: f64,
}

impl Round {
    /// The error relative to the number.
    pub fn share(&self) -> Option<f64> {
        self.error.map(|error| error / self.value.abs())
    }
}

/// The solution on one mesh.
pub(crate) struct Solution {
    /// The number.
    pub value: f64,
    /// Node positions, in file units.
    pub positions: Vec<DVec3>,
    /// For each element its part of the error in energy, J.
    pub errors: Vec<f64>,
    /// Why this is a state on the way to the solution only, because a coarse mesh has no solution.
    pub stopped: Option<String>,
}

/// What is solved on finer and finer meshes.
pub(crate) trait Refinable {
    /// Solves on `mesh`, from the positions of the solution before.
    ///
    /// # Errors
    /// Those of a simulation.
    fn solve(&mut self, mesh: &TetMesh, start: Option<&[DVec3]>) -> Result<Solution>;

    /// Whether bodies of `mesh`, which is of order 1, may have order 2.
    fn may_raise_order(&self, mesh: &TetMesh) -> bool;

    /// Called after each round, with its mesh.
    fn after(&mut self, round: &Round, mesh: &TetMesh) -> Result<()>;
}

/// The last mesh.
pub(crate) struct Refined {
    pub mesh: TetMesh,
    pub solution: Solution,
    pub rounds: Vec<Round>,
    /// Why the number is not as exact as wanted, and what it would take.
    pub missed: Option<String>,
}

/// Solves `body` on `mesh` and on finer ones until its number is within the error that is wanted, or
/// cannot be.
///
/// # Errors
/// Those of [`Refinable`]; [`Error::Cancelled`].
pub(crate) fn refine(
    body: &mut dyn Refinable,
    mesh: TetMesh,
    wanted: &AccuracyEntry,
    progress: ProgressFn,
) -> Result<Refined> {
    let goal = Goal::new(wanted)?;
    let report = |rounds: usize| {
        let share = rounds as f64 / (rounds + 2) as f64;
        ProgressScope::begin(progress, "refining the mesh", share).map(drop)
    };
    report(0)?;
    let start = Instant::now();
    let solution = body.solve(&mesh, None)?;
    if let Some(why) = solution.stopped {
        return Err(Error::Input(why));
    }
    let first = round_of(&mesh, &solution, None, start);
    body.after(&first, &mesh)?;
    let mut best = Refined {
        mesh,
        solution,
        rounds: vec![first],
        missed: None,
    };
    // The states on finer meshes since, which lack a solution.
    let mut stopped = Vec::<(TetMesh, Solution)>::new();
    let mut start = Instant::now();
    while best.rounds.len() < MAX_ROUNDS {
        report(best.rounds.len())?;
        let (mesh, solution) = stopped
            .last()
            .map_or((&best.mesh, &best.solution), |(mesh, state)| (mesh, state));
        let share = divided_share(best.rounds.last().and_then(Round::share), goal);
        let Some(space) = next_space(body, mesh, (&solution.errors, share))? else {
            best.missed = Some("no element carries an error that could be divided".into());
            return Ok(best);
        };
        let elements = space.mesh.element_count();
        if elements > goal.max_elements {
            best.missed = Some(what_it_takes(&best.rounds, goal, elements));
            return Ok(best);
        }
        let from = space.interpolate(&solution.positions);
        let no_solution =
            |why: &str| format!("a mesh of {elements} elements has no such equilibrium: {why}");
        let solution = match body.solve(&space.mesh, Some(&from)) {
            Ok(solution) => solution,
            Err(Error::Solver { what, .. } | Error::Input(what)) => {
                best.missed = Some(no_solution(&what));
                return Ok(best);
            }
            Err(other) => return Err(other),
        };
        if let Some(why) = &solution.stopped {
            if stopped.len() == MAX_STOPPED {
                best.missed = Some(no_solution(why));
                return Ok(best);
            }
            stopped.push((space.mesh, solution));
            continue;
        }
        let last_error = best.rounds.last().and_then(|round| round.error);
        let error = error_left(&best.solution, &solution, last_error);
        let round = round_of(&space.mesh, &solution, Some(error), start);
        body.after(&round, &space.mesh)?;
        let reached = round.share().is_some_and(|share| share <= goal.share);
        best.rounds.push(round);
        (best.mesh, best.solution) = (space.mesh, solution);
        if reached {
            return Ok(best);
        }
        stopped.clear();
        start = Instant::now();
    }
    best.missed = Some(what_it_takes(&best.rounds, goal, usize::MAX));
    Ok(best)
}

fn round_of(mesh: &TetMesh, solution: &Solution, error: Option<f64>, start: Instant) -> Round {
    Round {
        order: mesh.order.number(),
        elements: mesh.element_count(),
        nodes: mesh.nodes.len(),
        value: solution.value,
        error,
        seconds: start.elapsed().as_secs_f64(),
    }
}

/// Returns the error of the number of `now`, after the round of `before`: its change times q/(1 − q), the
/// rest of a geometric series, if each round multiplies the error by the q by which this one has
/// multiplied the error in energy; times a safety factor. At least half of what q leaves of
/// `last_error`, because a change can be small by chance.
fn error_left(before: &Solution, now: &Solution, last_error: Option<f64>) -> f64 {
    let energy = |solution: &Solution| solution.errors.iter().sum::<f64>();
    let [least, most] = DECREASE;
    let decrease = match energy(before) > 0.0 {
        true => (energy(now) / energy(before)).clamp(least, most),
        false => least,
    };
    let series = decrease / (1.0 - decrease) * (now.value - before.value).abs();
    let left = decrease * last_error.unwrap_or_default();
    (SAFETY * series).max(left / SAFETY)
}

/// Returns the share of the error in energy to divide, after a round whose number has the relative error
/// `now`.
fn divided_share(now: Option<f64>, goal: Goal) -> f64 {
    let wanted = now.map_or(0.0, |now| AIM * goal.share / now);
    ((1.0 - wanted) / (1.0 - LEFT_BY_DIVISION)).clamp(LEAST_DIVIDED, MOST_DIVIDED)
}

/// Returns the space after that of `mesh`, whose solution has these `errors`, of which a `share` is
/// divided; `None` if there is nothing to divide.
fn next_space(
    body: &dyn Refinable,
    mesh: &TetMesh,
    (errors, share): (&[f64], f64),
) -> Result<Option<FinerSpace>> {
    if mesh.order == ElementOrder::Linear && body.may_raise_order(mesh) {
        return FinerSpace::new(mesh).map(Some);
    }
    let chosen = largest(errors, share);
    match chosen.contains(&true) {
        true => FinerSpace::locally(mesh, &chosen).map(Some),
        false => Ok(None),
    }
}

/// Returns which are the fewest elements that carry `share` of all errors (Dörfler 1996, "A convergent
/// adaptive algorithm for Poisson's equation").
fn largest(errors: &[f64], share: f64) -> Vec<bool> {
    let mut order: Vec<usize> = (0..errors.len()).collect();
    order.sort_by(|a, b| errors[*b].total_cmp(&errors[*a]));
    let mut left = share * errors.iter().sum::<f64>();
    let mut chosen = vec![false; errors.len()];
    for e in order {
        if left <= 0.0 || errors[e] <= 0.0 {
            break;
        }
        chosen[e] = true;
        left -= errors[e];
    }
    chosen
}

/// Says why the goal was missed and how many elements it would take, by the decrease of the last
/// rounds.
fn what_it_takes(rounds: &[Round], goal: Goal, next: usize) -> String {
    let [.., before, last] = rounds else {
        return format!(
            "the next mesh has {next} elements, more than the {} allowed (--max-tets)",
            goal.max_elements
        );
    };
    let shares = before.share().zip(last.share());
    let rate = shares.map(|(a, b)| {
        let growth = (last.elements as f64 / before.elements as f64).ln();
        ((a / b).ln() / growth, b)
    });
    let limit = match next {
        usize::MAX => format!("{MAX_ROUNDS} rounds did not suffice"),
        _ => format!(
            "the next mesh has {next} elements, more than the {} allowed (--max-tets)",
            goal.max_elements
        ),
    };
    match rate.filter(|(rate, _)| *rate > 0.0) {
        Some((rate, share)) => {
            let wanted = last.elements as f64 * (share / goal.share).powf(1.0 / rate);
            let digits = 10f64.powf(wanted.log10().floor() - 1.0);
            format!(
                "{limit}; by the last rounds some {} elements would suffice",
                (wanted / digits).ceil() * digits
            )
        }
        None => limit,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solution(value: f64, energy: f64) -> Solution {
        Solution {
            value,
            positions: Vec::new(),
            errors: vec![0.25 * energy, 0.75 * energy],
            stopped: None,
        }
    }

    /// A number whose error is halved by each round is as far off as its last change.
    #[test]
    fn error_left_is_rest_of_series() {
        let [before, now] = [solution(1.2, 4.0), solution(1.1, 2.0)];
        assert!((error_left(&before, &now, None) - 0.2).abs() < 1e-12);
        // A change that is small by chance.
        let same = solution(1.2, 2.0);
        assert_eq!(error_left(&before, &same, None), 0.0);
        assert!((error_left(&before, &same, Some(0.4)) - 0.1).abs() < 1e-12);
        // An error in energy that grows is not relied on.
        let worse = solution(1.1, 8.0);
        assert!((error_left(&before, &worse, None) - 1.8).abs() < 1e-12);
    }

    /// Near the goal fewer elements are divided.
    #[test]
    fn divided_share_follows_what_is_wanted() {
        let goal = Goal {
            share: 0.02,
            max_elements: 1000,
        };
        assert_eq!(divided_share(None, goal), MOST_DIVIDED);
        assert_eq!(divided_share(Some(0.5), goal), MOST_DIVIDED);
        let near = divided_share(Some(0.03), goal);
        assert!((near - (1.0 - 0.018 / 0.03) / 0.9).abs() < 1e-12, "{near}");
        assert_eq!(divided_share(Some(0.0201), goal), LEAST_DIVIDED);
    }

    #[test]
    fn largest_errors_are_chosen() {
        let errors = [0.5, 4.0, 0.0, 3.5, 2.0];
        assert_eq!(largest(&errors, 0.7), [false, true, false, true, false]);
        assert_eq!(largest(&errors, 0.8), [false, true, false, true, true]);
        assert_eq!(largest(&[0.0; 3], 0.8), [false; 3]);
    }
}
