//! Where to look for a lump first: the ball whose stiffness, to first order, explains most of what a body
//! without one does not.

use super::forward::MeasuredBody;
use super::least_squares::Start;
use super::lump::Lump;
use super::unknown::Kind;
use crate::{ProgressFn, Result};
use nalgebra::{DMatrix, DVector};

/// Diameters of the balls, relative to the largest extent of the body.
const DIAMETERS: [f64; 3] = [0.08, 0.13, 0.2];
/// Largest number of middles.
const MIDDLES: usize = 2000;
/// Bounds of the relative change of stiffness at the start.
const CHANGES: [f64; 2] = [-0.5, 2.0];

/// Returns a start with the lump at the best ball; `None` if no lump is among the unknowns, or if its place
/// was given.
///
/// # Errors
/// As a press.
pub(super) fn start_at_best_ball(
    body: &MeasuredBody,
    progress: ProgressFn,
) -> Result<Option<Start>> {
    let is_place = |kind: &Kind| matches!(kind, Kind::LumpPosition(_) | Kind::LumpDiameter);
    let unknowns = body.unknowns();
    if !unknowns
        .iter()
        .any(|unknown| is_place(&unknown.kind) && !unknown.is_given)
    {
        return Ok(None);
    }
    let mut values: Vec<f64> = unknowns.iter().map(|unknown| unknown.first).collect();
    for (value, unknown) in values.iter_mut().zip(unknowns) {
        if unknown.kind == Kind::LumpContrast {
            *value = 1.0;
        }
    }
    let (prediction, by_element) = body.predict_by_elements(&values, progress)?;
    let sigma = body.standard_deviations();
    let rows = sigma.len();
    let residuals = DVector::from_fn(rows, |i, _| {
        (prediction.numbers[i] - body.observations()[i].value) / sigma[i]
    });
    // What the moduli explain is left out.
    let tissues: Vec<usize> = (0..unknowns.len())
        .filter(|k| matches!(unknowns[*k].kind, Kind::Young(_) | Kind::Poisson(_)))
        .collect();
    let columns = DMatrix::from_fn(rows, tissues.len(), |i, k| {
        prediction.slopes[i][tissues[k]] / sigma[i]
    });
    let columns = columns.qr().q();
    let residuals = without(&columns, residuals);
    let search = Search {
        body,
        by_element: &by_element,
        explained: &columns,
        residuals,
    };
    let Some(ball) = search.best_ball() else {
        return Ok(None);
    };
    for (value, unknown) in values.iter_mut().zip(unknowns) {
        if unknown.is_given {
            *value = unknown.first;
            continue;
        }
        match unknown.kind {
            Kind::LumpPosition(k) => *value = ball.middle[k],
            Kind::LumpDiameter => *value = ball.diameter,
            Kind::LumpContrast => *value = ball.contrast,
            _ => {}
        }
    }
    Ok(Some(Start::at(&values, unknowns)))
}

/// Returns a vector without its part in the space of orthonormal columns.
fn without(columns: &DMatrix<f64>, x: DVector<f64>) -> DVector<f64> {
    let explained = columns * (columns.transpose() * &x);
    x - explained
}

/// What a ball has to explain.
struct Search<'a, 'b> {
    body: &'a MeasuredBody<'b>,
    /// Of each number the derivatives by the logarithm of the stiffness of each element.
    by_element: &'a [Vec<f64>],
    /// An orthonormal basis of what the moduli explain.
    explained: &'a DMatrix<f64>,
    /// Residuals without that part.
    residuals: DVector<f64>,
}

impl Search<'_, '_> {
    fn best_ball(&self) -> Option<Lump> {
        let (low, high) = self.body.bounds();
        let extent = (high - low).max_element();
        let elements = self.body.lump_elements();
        let sigma = self.body.standard_deviations();
        let mut best: Option<(f64, Lump)> = None;
        for diameter in DIAMETERS.map(|share| share * extent) {
            for middle in elements.spread_middles(MIDDLES) {
                let mut ball = Lump {
                    middle,
                    diameter,
                    contrast: 1.0,
                };
                let shares = elements.shares(&ball);
                let column = DVector::from_fn(sigma.len(), |i, _| {
                    let terms = shares.iter();
                    let terms = terms.map(|(e, share)| share * self.by_element[i][*e]);
                    terms.sum::<f64>() / sigma[i]
                });
                let column = without(self.explained, column);
                let length = column.norm_squared();
                if length <= 0.0 {
                    continue;
                }
                // A linear model holds for moderate contrasts only.
                let along = -column.dot(&self.residuals);
                let change = (along / length).clamp(CHANGES[0], CHANGES[1]);
                let explained = change * (2.0 * along - change * length);
                if best.as_ref().is_none_or(|(most, _)| explained > *most) {
                    ball.contrast = 1.0 + change;
                    best = Some((explained, ball));
                }
            }
        }
        best.map(|(_, ball)| ball)
    }
}
