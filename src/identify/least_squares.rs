//! Weighted least squares by Levenberg and Marquardt's method, within bounds (Moré 1978, "The
//! Levenberg–Marquardt algorithm: implementation and theory").

use super::IdentifyStep;
use super::forward::{MeasuredBody, Prediction};
use super::unknown::{Kind, ScaledUnknown};
use crate::{Error, ProgressFn, Result};
use nalgebra::{DMatrix, DVector};
use std::cmp::Ordering;

/// Largest number of steps.
const MAX_STEPS: u32 = 40;
/// Largest number of values that are tried in a step.
const MAX_TRIALS: u32 = 8;
/// Relative decrease of the sum of squares, and change of θ, below which the search ends.
const ENOUGH: f64 = 1e-5;
const SMALL_STEP: f64 = 1e-4;
/// Distance of the optimum, in standard deviations that the residuals give θ, within which the search ends.
const CLOSE: f64 = 0.03;
/// Relative error of predicted numbers: steps end at contact forces within it.
const PREDICTION_ERROR: f64 = 1e-3;
/// Longest step of θ, for values and their logarithms, and largest factor of a value.
const LONGEST_STEP: f64 = 1.0;
const LONGEST_LOGARITHM: f64 = 4.0;
const LARGEST_FACTOR: f64 = 5.0;
/// Smallest part of a contrast's distance from 1 that a step leaves.
const NEAREST_CONTRAST: f64 = 0.25;
/// Damping of the first step, and its factors after a success and a failure.
const FIRST_DAMPING: f64 = 1e-3;
/// Damping that only keeps the normal equations regular.
const NO_DAMPING: f64 = 1e-9;
const LESS: f64 = 0.2;
const MORE: f64 = 6.0;
/// θ of two starts that count as the same.
const SAME: f64 = 0.2;

/// Receives the number of a step, the root mean square of the residuals and the values.
pub(super) type OnStep<'a> = &'a mut dyn FnMut(u32, f64, &[f64]) -> Result<()>;

/// The body, and how to stop.
#[derive(Clone, Copy)]
pub(super) struct Model<'a, 'b> {
    pub body: &'a MeasuredBody<'b>,
    pub progress: ProgressFn<'a>,
    /// Factors of the predicted numbers, or none.
    pub ratios: &'a [f64],
    /// An unknown that keeps its value.
    pub held: Option<usize>,
}

/// Values at the start.
#[derive(Clone)]
pub(super) struct Start {
    pub theta: DVector<f64>,
}

impl Start {
    /// Returns a start from values.
    pub fn at(values: &[f64], unknowns: &[ScaledUnknown]) -> Start {
        let theta = unknowns.iter().zip(values);
        let theta = theta.map(|(unknown, value)| {
            let [low, high] = unknown.bounds;
            unknown.theta(value.clamp(low, high))
        });
        Start {
            theta: DVector::from_iterator(values.len(), theta),
        }
    }

    /// Returns its values.
    pub fn values(&self, unknowns: &[ScaledUnknown]) -> Vec<f64> {
        let all = unknowns.iter().zip(&self.theta);
        all.map(|(unknown, theta)| unknown.value(*theta)).collect()
    }

    /// Returns a start where an earlier search was.
    pub fn from_step(step: &IdentifyStep, unknowns: &[ScaledUnknown]) -> Start {
        let value = |unknown: &ScaledUnknown| step.value(&unknown.name).unwrap_or(unknown.first);
        let values: Vec<f64> = unknowns.iter().map(value).collect();
        Start::at(&values, unknowns)
    }

    /// Returns start `n`: the first values, then others, spread within the bounds around them.
    pub fn number(n: u32, unknowns: &[ScaledUnknown]) -> Start {
        // Low-discrepancy points (Roberts's R sequence: powers of the positive root of x^(d+1) = x + 1).
        let dimensions = unknowns.len() as i32;
        let mut root = 2.0f64;
        for _ in 0..50 {
            root = (1.0 + root).powf(1.0 / f64::from(dimensions + 1));
        }
        let theta = unknowns.iter().enumerate().map(|(k, unknown)| {
            let first = unknown.theta(unknown.first);
            if n == 0 {
                return first;
            }
            let along = (0.5 + f64::from(n) * root.powi(-(k as i32 + 1))).fract();
            let [low, high] = unknown.bounds.map(|v| unknown.theta(v));
            let (low, high) = (low.max(first - 2.0), high.min(first + 2.0));
            low + along * (high - low)
        });
        Start {
            theta: DVector::from_iterator(unknowns.len(), theta),
        }
    }
}

/// An optimum.
#[derive(Clone, Debug)]
pub(super) struct Solution {
    pub theta: DVector<f64>,
    pub values: Vec<f64>,
    /// Residuals of the data over their standard deviations, at a noise of 1, then those of what is known before
    /// them, and their derivatives by θ.
    pub residuals: DVector<f64>,
    pub jacobian: DMatrix<f64>,
    /// Number of data.
    pub data: usize,
    /// Predicted numbers.
    pub predicted: Vec<f64>,
    /// Which unknowns are at a bound.
    pub at_bound: Vec<bool>,
    /// Whether the search ended by its own rule.
    pub converged: bool,
}

impl Solution {
    pub fn sum_of_squares(&self) -> f64 {
        self.residuals.norm_squared()
    }

    /// Returns by how much a change of θ is expected to decrease the sum of squares.
    fn expected_decrease(&self, change: &DVector<f64>) -> f64 {
        let moved = &self.jacobian * change;
        -2.0 * moved.dot(&self.residuals) - moved.norm_squared()
    }

    /// Returns the variance of the residuals.
    fn variance(&self) -> f64 {
        let freedom = self.residuals.len().saturating_sub(self.theta.len()).max(1);
        self.sum_of_squares() / freedom as f64
    }

    /// Sum of the squares of the data.
    pub fn misfit_squares(&self) -> f64 {
        self.residuals.rows(0, self.data).norm_squared()
    }

    /// Root mean square of the residuals of the data.
    pub fn misfit(&self) -> f64 {
        (self.misfit_squares() / self.data.max(1) as f64).sqrt()
    }
}

/// Finds the values of the least sum of squares from a start. Calls `each` with the number of the step, the
/// root mean square of the residuals and the values.
///
/// # Errors
/// Those of the predictions at the start, and of `each`.
pub(super) fn minimise(model: &Model, start: &Start, each: OnStep<'_>) -> Result<Solution> {
    let mut now = model.at(&start.theta)?;
    each(0, now.misfit(), &now.values)?;
    let mut damping = FIRST_DAMPING;
    for step in 1..=MAX_STEPS {
        let expected = now.expected_decrease(&model.left(&now));
        if expected < CLOSE.powi(2) * now.variance() {
            now.converged = true;
            return Ok(now);
        }
        let mut next = None;
        for _ in 0..MAX_TRIALS {
            let change = model.change(&now, damping);
            if change.amax() < SMALL_STEP {
                break;
            }
            let tried = match model.at(&model.moved(&now, &change)) {
                Ok(tried) => Some(tried),
                // No equilibrium at these values.
                Err(Error::Solver { .. } | Error::Input(_)) => None,
                Err(other) => return Err(other),
            };
            match tried.filter(|tried| tried.sum_of_squares() < now.sum_of_squares()) {
                Some(better) => {
                    damping *= LESS;
                    next = Some(better);
                    break;
                }
                None if expected < model.error_of_squares(&now) => break,
                None => damping *= MORE,
            }
        }
        let Some(next) = next else {
            now.converged = true;
            return Ok(now);
        };
        let decrease = 1.0 - next.sum_of_squares() / now.sum_of_squares();
        now = next;
        each(step, now.misfit(), &now.values)?;
        if decrease < ENOUGH {
            now.converged = true;
            return Ok(now);
        }
    }
    Ok(now)
}

/// Returns the optima among sorted solutions that differ from the first, with sums of squares up to four
/// times as large.
pub(super) fn distinct(sorted: &[Solution]) -> Vec<Solution> {
    let Some(best) = sorted.first() else {
        return Vec::new();
    };
    let most = 4.0 * best.sum_of_squares() + best.data as f64 * 1e-6;
    let mut kept: Vec<Solution> = Vec::new();
    for other in &sorted[1..] {
        let is_new = |one: &Solution| (&one.theta - &other.theta).amax() > SAME;
        if other.sum_of_squares() <= most && is_new(best) && kept.iter().all(is_new) {
            kept.push(other.clone());
        }
    }
    kept
}

impl<'a, 'b> Model<'a, 'b> {
    /// Creates a model without corrections in which no unknown is held.
    pub fn new(body: &'a MeasuredBody<'b>, progress: ProgressFn<'a>) -> Model<'a, 'b> {
        Model {
            body,
            progress,
            ratios: &[],
            held: None,
        }
    }

    /// Returns residuals and derivatives at θ, which is moved into the bounds.
    ///
    /// # Errors
    /// Those of the predictions.
    pub fn at(&self, theta: &DVector<f64>) -> Result<Solution> {
        let unknowns = self.body.unknowns();
        let values: Vec<f64> = unknowns
            .iter()
            .zip(theta)
            .map(|(unknown, theta)| unknown.value(*theta))
            .collect();
        let mut prediction = self.body.predict(&values, self.progress)?;
        prediction.multiply_by(self.ratios);
        let Prediction { numbers, slopes } = prediction;
        let sigma = self.body.standard_deviations();
        let observations = self.body.observations();
        let data = numbers.len();
        let theta: Vec<f64> = unknowns
            .iter()
            .zip(&values)
            .map(|(unknown, value)| unknown.theta(*value))
            .collect();
        let prior = self.body.prior(&theta);
        let residuals = DVector::from_fn(data + prior.len(), |i, _| {
            match prior.get(i.wrapping_sub(data)) {
                Some((residual, _)) => *residual,
                None => (numbers[i] - observations[i].value) / sigma[i],
            }
        });
        let mut jacobian = DMatrix::zeros(residuals.len(), unknowns.len());
        for (i, row) in slopes.iter().enumerate() {
            for (k, slope) in row.iter().enumerate() {
                jacobian[(i, k)] = slope * unknowns[k].slope(values[k]) / sigma[i];
            }
        }
        for (i, (_, slopes)) in prior.iter().enumerate() {
            slopes
                .iter()
                .for_each(|(k, slope)| jacobian[(data + i, *k)] += slope);
        }
        let at_bound = unknowns.iter().zip(&values).map(|(unknown, value)| {
            let [low, high] = unknown.bounds;
            let near = 1e-6 * (high - low);
            *value <= low + near.min(1e-6 * low.abs()) || *value >= high - near
        });
        Ok(Solution {
            theta: DVector::from_vec(theta),
            data,
            at_bound: at_bound.collect(),
            residuals,
            jacobian,
            values,
            predicted: numbers,
            converged: false,
        })
    }

    /// Returns how far θ is from the optimum, as far as the derivatives tell.
    pub fn left(&self, now: &Solution) -> DVector<f64> {
        self.change(now, NO_DAMPING)
    }

    /// Returns the error of the sum of squares by that of the predicted numbers, which hides smaller decreases.
    fn error_of_squares(&self, now: &Solution) -> f64 {
        let numbers = now.predicted.iter().zip(self.body.standard_deviations());
        let terms = numbers.zip(&now.residuals);
        let terms = terms.map(|((number, sigma), residual)| residual * number / sigma);
        2.0 * PREDICTION_ERROR * DVector::from_iterator(now.data, terms).norm()
    }

    /// Returns θ after a change. Forces are proportional to moduli, so the change is one of the value, not
    /// of its logarithm: with one modulus a step ends at the optimum.
    pub(super) fn moved(&self, now: &Solution, change: &DVector<f64>) -> DVector<f64> {
        let unknowns = self.body.unknowns().iter().enumerate();
        let moved = unknowns.map(|(k, unknown)| {
            let (value, theta) = (now.values[k], now.theta[k]);
            let most = LARGEST_FACTOR.ln();
            match unknown.kind {
                Kind::LumpDiameter => theta + change[k].clamp(-most, most),
                Kind::LumpContrast => {
                    // At a contrast of 1 a lump has no place, and no derivatives by it.
                    let nearest = unknown.theta(1.0 + NEAREST_CONTRAST * (value - 1.0));
                    let next = theta + change[k].clamp(-most, most);
                    match value.total_cmp(&1.0) {
                        Ordering::Greater => next.max(nearest),
                        Ordering::Less => next.min(nearest),
                        Ordering::Equal => next,
                    }
                }
                _ if unknown.is_logarithmic() => {
                    let next = value * (1.0 + change[k]);
                    unknown.theta(next.clamp(value / LARGEST_FACTOR, value * LARGEST_FACTOR))
                }
                _ => theta + change[k],
            }
        });
        DVector::from_iterator(change.len(), moved)
    }

    /// Returns the change of θ by the damped normal equations; unknowns that would leave their bounds
    /// stay.
    fn change(&self, now: &Solution, damping: f64) -> DVector<f64> {
        let count = now.theta.len();
        let gradient = now.jacobian.transpose() * &now.residuals;
        let normal = now.jacobian.transpose() * &now.jacobian;
        let largest = normal.diagonal().amax();
        let mut held: Vec<bool> = (0..count).map(|k| self.held == Some(k)).collect();
        loop {
            let free: Vec<usize> = (0..count).filter(|k| !held[*k]).collect();
            let mut change = DVector::zeros(count);
            if free.is_empty() {
                return change;
            }
            let mut matrix = normal.select_rows(&free).select_columns(&free);
            for (row, k) in free.iter().enumerate() {
                matrix[(row, row)] +=
                    damping * normal[(*k, *k)].max(1e-9 * largest) + f64::MIN_POSITIVE;
            }
            let right = DVector::from_iterator(free.len(), free.iter().map(|k| -gradient[*k]));
            let Some(solved) = matrix.cholesky().map(|factor| factor.solve(&right)) else {
                return change;
            };
            for (k, x) in free.iter().zip(&solved) {
                change[*k] = *x;
            }
            let lengths = self.body.unknowns().iter().zip(&change);
            let lengths = lengths.map(|(unknown, x)| match unknown.is_logarithmic() {
                true => x.abs() / LONGEST_LOGARITHM,
                false => x.abs() / LONGEST_STEP,
            });
            change /= lengths.fold(1.0, f64::max);
            let leaves = |k: &usize| {
                let unknown = &self.body.unknowns()[*k];
                let [low, high] = unknown.bounds.map(|v| unknown.theta(v));
                (now.theta[*k] <= low + 1e-9 && change[*k] < 0.0)
                    || (now.theta[*k] >= high - 1e-9 && change[*k] > 0.0)
            };
            let leaving: Vec<usize> = free.iter().copied().filter(leaves).collect();
            if leaving.is_empty() {
                return change;
            }
            leaving.into_iter().for_each(|k| held[k] = true);
        }
    }
}
