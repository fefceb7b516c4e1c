//! Where to look for a lump first: of each diameter the ball whose stiffness, to first order, explains most of
//! what a body without one does not. To first order a small stiff ball and a larger, softer one act alike, so
//! that each is a start.

use super::forward::MeasuredBody;
use super::least_squares::{Model, Start};
use super::lump::Lump;
use super::unknown::{Kind, ScaledUnknown};
use crate::Result;
use nalgebra::{DMatrix, DVector};

/// Diameters of the balls, relative to the largest extent of the body.
const DIAMETERS: [f64; 4] = [0.05, 0.08, 0.13, 0.2];
/// Largest number of middles.
const MIDDLES: usize = 2000;
/// Bounds of the relative change of stiffness at the start.
const CHANGES: [f64; 2] = [-0.5, 2.0];

/// Returns the first values of a body without a lump; `None` if no lump is among the unknowns, or if its place was
/// given.
pub(super) fn values_without_lump(unknowns: &[ScaledUnknown]) -> Option<Vec<f64>> {
    let is_place = |kind: &Kind| matches!(kind, Kind::LumpPosition(_) | Kind::LumpDiameter);
    let mut places = unknowns.iter();
    if !places.any(|unknown| is_place(&unknown.kind) && !unknown.is_given) {
        return None;
    }
    let values = unknowns.iter().map(|unknown| match unknown.kind {
        Kind::LumpContrast => 1.0,
        _ => unknown.first,
    });
    Some(values.collect())
}

/// Returns a start for each diameter, the ball that explains most first, from the first values of a body without
/// a lump.
///
/// # Errors
/// As a press.
pub(super) fn starts_at_best_balls(model: &Model, values: Vec<f64>) -> Result<Vec<Start>> {
    let body = model.body;
    let unknowns = body.unknowns();
    let (prediction, by_element) =
        body.predict_by_elements(&values, (model.ratios, model.progress))?;
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
    let explained = columns.clone().qr().q();
    let search = Search {
        body,
        by_element: &by_element,
        residuals: without(&explained, residuals.clone()),
        explained: &explained,
    };
    let svd = (!tissues.is_empty()).then(|| columns.svd(true, true));
    let start = |ball: Lump| {
        let mut values = values.clone();
        // The moduli with that ball: far from them its derivatives are those of another body.
        if let Some(svd) = &svd {
            let left = &residuals + (ball.contrast - 1.0) * search.column(&ball);
            let changes = svd.solve(&-left, 1e-9 * svd.singular_values.max());
            for (k, change) in tissues.iter().zip(changes.iter().flatten()) {
                values[*k] += change;
            }
        }
        for (value, unknown) in values.iter_mut().zip(unknowns) {
            match unknown.kind {
                _ if unknown.is_given => *value = unknown.first,
                Kind::LumpPosition(k) => *value = ball.middle[k],
                Kind::LumpDiameter => *value = ball.diameter,
                Kind::LumpContrast => *value = ball.contrast,
                _ => {}
            }
        }
        Start::at(&values, unknowns)
    };
    Ok(search.best_balls().into_iter().map(start).collect())
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
    /// Returns the best ball of each diameter, the one that explains most first.
    fn best_balls(&self) -> Vec<Lump> {
        let (low, high) = self.body.bounds();
        let extent = (high - low).max_element();
        let elements = self.body.lump_elements();
        let mut found: Vec<(f64, Lump)> = Vec::new();
        for diameter in DIAMETERS.map(|share| share * extent) {
            let mut best: Option<(f64, Lump)> = None;
            for middle in elements.spread_middles(MIDDLES) {
                let mut ball = Lump {
                    middle,
                    diameter,
                    contrast: 1.0,
                };
                let column = without(self.explained, self.column(&ball));
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
            found.extend(best);
        }
        found.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        found.into_iter().map(|(_, ball)| ball).collect()
    }

    /// Returns the derivatives of the residuals by the logarithm of the stiffness of a ball.
    fn column(&self, ball: &Lump) -> DVector<f64> {
        let shares = self.body.lump_elements().shares(ball);
        let sigma = self.body.standard_deviations();
        DVector::from_fn(sigma.len(), |i, _| {
            let terms = shares.iter();
            let terms = terms.map(|(e, share)| share * self.by_element[i][*e]);
            terms.sum::<f64>() / sigma[i]
        })
    }
}
