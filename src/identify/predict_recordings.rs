//! What a scene predicts for recordings, with derivatives.

use super::chain::{Chain, DerivedBy};
use super::forward::{MeasuredBody, Prediction};
use super::recorded_body::RecordedBody;
use super::unknown::ScaledUnknown;
use crate::mesh::ElementOrder;
use crate::physics::{Gradient, Simulator};
use crate::{Error, ProgressFn, Result};
use std::cell::OnceCell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Change of θ of the differences of a swing or a motion.
const DIFFERENCE: f64 = 0.02;
/// Largest number of unknowns whose differences of a swing take less time than its adjoint, of linear and of
/// quadratic tets: its motion and its solves, two a step, are in double precision and exact.
const MOST_DIFFERENCES: [usize; 2] = [20, 30];

impl MeasuredBody<'_> {
    /// Predicts a recording at rest, with derivatives by the adjoint method.
    pub(super) fn predict_rest(
        &self,
        recorded: &RecordedBody,
        values: &[f64],
    ) -> Result<Prediction> {
        let (scene, mesh) = self.with_values(values);
        let chain = OnceCell::new();
        let found = recorded.at_rest((self.gpu, &scene, &mesh), &|simulator| {
            let own = self.chain((values, DerivedBy::Unknowns), simulator)?;
            let parameters = own.parameters.clone();
            chain.set(own).ok();
            Ok(parameters)
        })?;
        Ok(prediction_of(&found, chain.get()))
    }

    /// Predicts a swing, with derivatives by differences of a few unknowns and by the adjoint method of many; by
    /// differences also where a motion has no adjoint: of springs, rigid regions, averaged volumes under damping
    /// and loads over time.
    pub(super) fn predict_swing(
        &self,
        recorded: &RecordedBody,
        values: &[f64],
        progress: ProgressFn,
    ) -> Result<Prediction> {
        let is_of_tool = |unknown: &ScaledUnknown| unknown.kind.is_of_tools();
        let most = match self.order() {
            ElementOrder::Linear => MOST_DIFFERENCES[0],
            ElementOrder::Quadratic => MOST_DIFFERENCES[1],
        };
        if self.unknowns.len() <= most || self.unknowns.iter().any(is_of_tool) {
            return self.predict_over_time(recorded, values, progress);
        }
        match self.predict_swing_by_adjoint(recorded, values, progress) {
            Err(Error::Input(_)) => self.predict_over_time(recorded, values, progress),
            found => found,
        }
    }

    /// Predicts a swing, with derivatives by the adjoint method.
    pub(super) fn predict_swing_by_adjoint(
        &self,
        recorded: &RecordedBody,
        values: &[f64],
        progress: ProgressFn,
    ) -> Result<Prediction> {
        let (scene, mesh) = self.with_values(values);
        let chain = OnceCell::new();
        let parameters = |simulator: &dyn Simulator| {
            let own = self.chain_of_motion(values, simulator)?;
            let parameters = own.parameters.clone();
            chain.set(own).ok();
            Ok(parameters)
        };
        let body = (self.gpu, &scene, &mesh);
        let found = recorded.swing_gradients(body, &parameters, progress)?;
        Ok(prediction_of(&found, chain.get()))
    }

    /// Predicts a swing or a motion, with derivatives by differences: one motion for each unknown.
    pub(super) fn predict_over_time(
        &self,
        recorded: &RecordedBody,
        values: &[f64],
        progress: ProgressFn,
    ) -> Result<Prediction> {
        let mut tried = vec![values.to_vec()];
        for (k, unknown) in self.unknowns.iter().enumerate() {
            // Away from the upper bound.
            let theta = unknown.theta(values[k]);
            let above = theta + DIFFERENCE;
            let other = match above < unknown.theta(unknown.bounds[1]) {
                true => above,
                false => theta - DIFFERENCE,
            };
            let mut changed = values.to_vec();
            changed[k] = unknown.value(other);
            tried.push(changed);
        }
        let found = on_threads(tried.len(), |n| {
            let (scene, mesh) = self.with_values(&tried[n]);
            recorded.over_time((self.gpu, &scene, &mesh), 1, progress)
        });
        let found = found.into_iter().collect::<Result<Vec<_>>>()?;
        let numbers = found[0].clone();
        let slopes = (0..numbers.len()).map(|i| {
            let by = |k: usize| {
                let change = tried[k + 1][k] - values[k];
                (found[k + 1][i] - numbers[i]) / change
            };
            (0..self.unknowns.len()).map(by).collect()
        });
        Ok(Prediction {
            slopes: slopes.collect(),
            numbers,
        })
    }
}

/// Returns numbers with their derivatives by the unknowns.
fn prediction_of(found: &[Gradient], chain: Option<&Chain>) -> Prediction {
    let slopes = |gradient: &Gradient| {
        chain.map_or(Vec::new(), |chain| chain.by_unknowns(&gradient.derivatives))
    };
    Prediction {
        slopes: found.iter().map(slopes).collect(),
        numbers: found.iter().map(|gradient| gradient.value).collect(),
    }
}

/// Returns `of(0)`, `of(1)` … on as many threads as there are cores: each may wait for a simulator, which
/// a pool's threads must not.
fn on_threads<T: Send>(count: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let threads = match cfg!(target_arch = "wasm32") {
        true => 1,
        false => std::thread::available_parallelism().map_or(1, usize::from),
    };
    let (next, found) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let work = || {
        loop {
            let n = next.fetch_add(1, Ordering::Relaxed);
            if n >= count {
                return;
            }
            let one = of(n);
            found
                .lock()
                .unwrap_or_else(|e| e.into_inner())
                .push((n, one));
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads.min(count) {
            scope.spawn(work);
        }
        work();
    });
    let mut found = found.into_inner().unwrap_or_else(|e| e.into_inner());
    found.sort_by_key(|(n, _)| *n);
    found.into_iter().map(|(_, one)| one).collect()
}
