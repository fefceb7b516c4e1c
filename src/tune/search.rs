//! Search for the cheapest candidate within a tolerance.

use crate::{Error, Result};
use std::collections::BTreeMap;
use std::fmt;
use std::ops::ControlFlow;

/// Candidates with a measurable cost and an error relative to a reference.
pub trait Candidates {
    /// Type of a candidate.
    type Point: Clone + fmt::Display;

    /// Returns all candidates.
    fn points(&self) -> Vec<Self::Point>;

    /// Measures the cost of a candidate by a short trial.
    ///
    /// # Errors
    /// An error that aborts the search; a candidate that fails costs ∞.
    fn cost(&mut self, point: &Self::Point) -> Result<f64>;

    /// Computes the error of a candidate by a full trial, which may end as soon as the error
    /// certainly exceeds `enough`.
    ///
    /// # Errors
    /// An error that aborts the search; a candidate that fails has the error ∞.
    fn error(&mut self, point: &Self::Point, enough: f64) -> Result<f64>;
}

/// Result of a search.
#[derive(Clone, Debug)]
pub struct SearchResult<P> {
    /// The cheapest candidate within the tolerance; if there is none, the most accurate one.
    pub point: P,
    /// Its cost.
    pub cost: f64,
    /// Its error.
    pub error: f64,
    /// Whether the error is within the tolerance.
    pub met: bool,
    /// Number of candidates, and of those compared with the reference.
    pub tried: [usize; 2],
    /// Cost and error of each compared candidate; some errors are only lower bounds.
    pub pareto_front: Vec<(f64, f64)>,
}

impl<P: Clone> SearchResult<P> {
    /// Returns the cheapest candidate of `trial` with an error within `tolerance`.
    ///
    /// Times all candidates, then tries them in order of cost: the first one within the tolerance is
    /// the cheapest. The error need not decrease monotonically as candidates get finer, because the
    /// errors of the time step and of the cage may cancel.
    ///
    /// # Errors
    /// As [`Candidates::cost`] and [`Candidates::error`]; [`Error::Cancelled`] if `progress` breaks.
    pub fn cheapest<T: Candidates<Point = P>>(
        trial: &mut T,
        tolerance: f64,
        progress: &dyn Fn(f64) -> ControlFlow<()>,
    ) -> Result<SearchResult<P>> {
        let points = trial.points();
        let count = points.len();
        let mut costs = Vec::with_capacity(count);
        for (i, point) in points.iter().enumerate() {
            report_progress(progress, 0.5 * i as f64 / count as f64)?;
            costs.push(trial.cost(point)?);
        }
        let mut order: Vec<usize> = (0..count).filter(|i| costs[*i].is_finite()).collect();
        order.sort_by(|a, b| costs[*a].total_cmp(&costs[*b]));
        let mut errors: BTreeMap<usize, f64> = BTreeMap::new();
        let mut met = None;
        for (n, i) in order.iter().enumerate() {
            report_progress(progress, 0.5 + 0.5 * n as f64 / order.len() as f64)?;
            let error = trial.error(&points[*i], tolerance)?;
            errors.insert(*i, error);
            if error <= tolerance {
                met = Some(*i);
                break;
            }
        }
        let least = errors.iter().min_by(|a, b| a.1.total_cmp(b.1));
        let chosen = met
            .or_else(|| least.map(|(i, _)| *i))
            .ok_or_else(|| Error::Input("every candidate of the search failed to run".into()))?;
        Ok(SearchResult {
            point: points[chosen].clone(),
            cost: costs[chosen],
            error: errors[&chosen],
            met: met.is_some(),
            tried: [count, errors.len()],
            pareto_front: errors.iter().map(|(i, e)| (costs[*i], *e)).collect(),
        })
    }
}

fn report_progress(progress: &dyn Fn(f64) -> ControlFlow<()>, share: f64) -> Result<()> {
    match progress(share) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(Error::Cancelled),
    }
}

impl<P: fmt::Display> SearchResult<P> {
    /// Returns the result in one sentence.
    pub fn summary(&self, what: &str, cost: &str, tolerance: f64) -> String {
        let [there, tried] = self.tried;
        let (own, wanted) = (100.0 * self.error, 100.0 * tolerance);
        let chosen = format!("{what}: {}, {:.2} {cost}", self.point, self.cost);
        match self.met {
            true => format!("{chosen}, error {own:.2} % ({tried} of {there} candidates compared)"),
            false => format!(
                "{chosen}; its error of {own:.2} % is the smallest found ({tried} of {there} candidates compared), above the tolerance of {wanted} %: increase the tolerance, or change the mesh, the time step or the image size of the reference"
            ),
        }
    }
}
