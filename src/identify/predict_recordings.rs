//! What a scene predicts for recordings, with derivatives.

use super::forward::{MeasuredBody, Prediction};
use super::recorded_body::RecordedBody;
use crate::physics::Gradient;
use crate::{ProgressFn, Result};
use std::cell::OnceCell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Change of θ of the differences of a swing or a motion.
const DIFFERENCE: f64 = 0.02;

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
            let own = self.chain((values, false), simulator)?;
            let parameters = own.parameters.clone();
            chain.set(own).ok();
            Ok(parameters)
        })?;
        let slopes = |gradient: &Gradient| {
            let chain = chain.get();
            chain.map_or(Vec::new(), |chain| chain.by_unknowns(&gradient.derivatives))
        };
        Ok(Prediction {
            slopes: found.iter().map(slopes).collect(),
            numbers: found.iter().map(|gradient| gradient.value).collect(),
        })
    }

    /// Predicts a swing or a motion, with derivatives by differences: those of all numbers take one motion for
    /// each unknown, by the adjoint method two for each number.
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
