//! Laplace's approximation: intervals, correlations and combinations that the data do not determine.

use super::forward::MeasuredBody;
use super::least_squares::Solution;
use super::unknown::ScaledUnknown;
use crate::mesh::Field;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal, StudentsT};
use std::ops::Range;

/// Probability of an interval.
pub(super) const PROBABILITY: f64 = 0.9;
/// Misfits less likely than this are not explained by the stated noise.
const UNLIKELY: f64 = 0.01;
/// Standard deviations of θ beyond which a combination of unknowns is not determined: a factor of 2, or
/// 0.7 large changes.
const UNDETERMINED: f64 = std::f64::consts::LN_2;
/// Variances of θ are at most that of a uniform factor of e¹⁰.
const MAX_VARIANCE: f64 = 100.0;

/// What the data say about the unknowns at the optimum.
#[derive(Clone, Debug)]
pub(super) struct Uncertainty {
    /// Covariance of θ.
    pub covariance: DMatrix<f64>,
    /// Multiple of standard deviations that an interval takes to each side.
    pub quantile: f64,
    /// How far the noise lets each θ be below and above its optimum.
    pub reach: Vec<[f64; 2]>,
    /// Whether that is known by profile likelihood.
    pub is_profiled: Vec<bool>,
    /// Standard deviations of the data over those for which residuals were calculated.
    pub noise_factor: f64,
    /// Whether the residuals are larger than the stated noise explains.
    pub is_misfit: bool,
    /// Largest change of each θ by the discretisation error, by what was left of the search, and by the last
    /// correction of forces.
    pub shift: DVector<f64>,
    /// How far an error of the scene could have moved each θ, if what the unknowns have absorbed of it is as
    /// large as what the residuals show (a standard deviation, in their norm). 0 if the scene explains the data.
    pub model_error: DVector<f64>,
    /// Combinations that the data do not determine: weights by unknown, the largest 1.
    pub undetermined: Vec<Vec<f64>>,
}

impl Uncertainty {
    /// Calculates the uncertainty of an optimum, whose numbers have the discretisation errors
    /// `relative` (of each experiment).
    pub fn new(
        body: &MeasuredBody,
        best: &Solution,
        noise: Option<f64>,
        relative: &[f64],
    ) -> Uncertainty {
        let columns = best.jacobian.ncols();
        let information = best.jacobian.transpose() * &best.jacobian;
        let freedom = (best.data as f64 - determined(best, &information)).max(0.0);
        let squares = best.misfit_squares();
        let reduced = if freedom > 0.0 {
            (squares / freedom).sqrt()
        } else {
            1.0
        };
        let quantile_of = 0.5 + 0.5 * PROBABILITY;
        let normal = Normal::standard().inverse_cdf(quantile_of);
        let (noise_factor, quantile, is_misfit) = match noise {
            None => {
                let student = StudentsT::new(0.0, 1.0, freedom.max(1.0));
                let quantile = student.map_or(normal, |t| t.inverse_cdf(quantile_of));
                (reduced, quantile, false)
            }
            Some(_) => {
                let chance = ChiSquared::new(freedom.max(1.0)).map_or(1.0, |c| c.sf(squares));
                let is_misfit = freedom > 0.0 && chance < UNLIKELY;
                (if is_misfit { reduced } else { 1.0 }, normal, is_misfit)
            }
        };
        let scale = noise_factor.max(f64::MIN_POSITIVE).powi(2);
        let own = SymmetricEigen::new(information.clone());
        let (covariance, variance) = covariance_of(&own, scale);
        // Of a stiffness that varies a sentence tells where the data are silent.
        let undetermined = (0..columns)
            .filter(|k| body.grid.is_none() && variance[*k].sqrt() > UNDETERMINED)
            .map(|k| {
                let direction = own.eigenvectors.column(k);
                let largest = direction[direction.iamax()];
                direction.iter().map(|x| x / largest).collect()
            })
            .collect();
        let reach = (0..columns).map(|k| [quantile * covariance[(k, k)].max(0.0).sqrt(); 2]);
        Uncertainty {
            shift: shift(body, best, (&own, relative)),
            model_error: match is_misfit {
                true => {
                    let excess = (squares - freedom).max(0.0);
                    quantile * covariance_of(&own, excess).0.diagonal().map(f64::sqrt)
                }
                false => DVector::zeros(columns),
            },
            reach: reach.collect(),
            is_profiled: vec![false; columns],
            covariance,
            quantile,
            noise_factor,
            is_misfit,
            undetermined,
        }
    }

    /// Adds a change of each θ of unknown sign.
    pub fn add_shift(&mut self, change: &DVector<f64>) {
        self.shift
            .zip_apply(change, |own, more| *own = own.hypot(more));
    }

    /// Returns the interval of unknown `k`. The sign of the discretisation error is unknown, so that it
    /// adds to the noise by its square, as does what the scene does not explain (JCGM 100:2008, "Guide to the
    /// expression of uncertainty in measurement", §5.1).
    pub fn interval(&self, k: usize, unknown: &ScaledUnknown, theta: f64) -> [f64; 2] {
        let systematic = self.shift[k].hypot(self.model_error[k]);
        let [below, above] = self.reach[k].map(|reach| reach.hypot(systematic));
        [unknown.value(theta - below), unknown.value(theta + above)]
    }

    /// Returns the field of the standard deviations of the logarithms of a stiffness that varies.
    pub fn spread_of_stiffness(&self, body: &MeasuredBody) -> Option<Field> {
        let first = body.grid_nodes.start;
        let (_, pieces) = body.lump_elements().own_factors();
        let covariance = |a: usize, b: usize| self.covariance[(first + a, first + b)];
        let grid = body.grid.as_ref();
        grid.map(|grid| grid.spread(pieces, &covariance))
    }

    /// Returns the correlations of the unknowns but those in `without`.
    pub fn correlations(&self, without: &Range<usize>) -> Vec<Vec<f64>> {
        let kept = (0..self.covariance.nrows()).filter(|k| !without.contains(k));
        let kept: Vec<usize> = kept.collect();
        let of = |i: usize, k: usize| {
            let both = self.covariance[(i, i)] * self.covariance[(k, k)];
            if both > 0.0 {
                self.covariance[(i, k)] / both.sqrt()
            } else {
                0.0
            }
        };
        kept.iter()
            .map(|i| kept.iter().map(|k| of(*i, *k)).collect())
            .collect()
    }
}

/// Returns the covariance of θ by the eigenvectors of the information JᵀJ for a variance of 1, and its
/// eigenvalues, for a variance of `scale`.
fn covariance_of(
    own: &SymmetricEigen<f64, nalgebra::Dyn>,
    scale: f64,
) -> (DMatrix<f64>, DVector<f64>) {
    let variance = own
        .eigenvalues
        .map(|x| (scale / x.max(0.0)).min(MAX_VARIANCE));
    let all = &own.eigenvectors * DMatrix::from_diagonal(&variance) * own.eigenvectors.transpose();
    (all, variance)
}

/// Returns how far the noise, of this standard deviation, lets each θ be to either side, by the information
/// JᵀJ for a deviation of 1.
#[cfg(feature = "study")]
pub(super) fn reach_of_noise(information: DMatrix<f64>, noise: f64) -> Vec<f64> {
    let (all, _) = covariance_of(&SymmetricEigen::new(information), noise * noise);
    let quantile = Normal::standard().inverse_cdf(0.5 + 0.5 * PROBABILITY);
    all.diagonal()
        .iter()
        .map(|x| quantile * x.max(0.0).sqrt())
        .collect()
}

/// Returns the number of unknowns that the data determine: all without prior knowledge, otherwise the trace of
/// (JᵀJ)⁻¹ times the part of JᵀJ by the data.
fn determined(best: &Solution, information: &DMatrix<f64>) -> f64 {
    let columns = best.jacobian.ncols();
    if best.data == best.residuals.len() {
        return columns as f64;
    }
    let own = best.jacobian.rows(0, best.data);
    let by_data = own.transpose() * own;
    let solved = information.clone().cholesky();
    solved.map_or(columns as f64, |factor| factor.solve(&by_data).trace())
}

/// Returns by how much each θ changes if all numbers of an experiment are off by its relative error: the
/// sum over the experiments.
fn shift(
    body: &MeasuredBody,
    best: &Solution,
    (own, relative): (&SymmetricEigen<f64, nalgebra::Dyn>, &[f64]),
) -> DVector<f64> {
    let sigma = body.standard_deviations();
    let largest = own.eigenvalues.amax();
    let inverse = own
        .eigenvalues
        .map(|x| if x > 1e-12 * largest { 1.0 / x } else { 0.0 });
    let inverse =
        &own.eigenvectors * DMatrix::from_diagonal(&inverse) * own.eigenvectors.transpose();
    let mut total = DVector::zeros(best.theta.len());
    let mut row = 0;
    for (experiment, error) in body.experiments.iter().zip(relative) {
        let count = experiment.observed().len();
        let mut off = DVector::zeros(best.residuals.len());
        for i in row..row + count {
            off[i] = error * best.predicted[i] / sigma[i];
        }
        row += count;
        total += (&inverse * best.jacobian.transpose() * off).abs();
    }
    total
}
