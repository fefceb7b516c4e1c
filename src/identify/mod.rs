//! `palpate identify`: material parameters from measured presses and recordings, with intervals.
//!
//! Unknowns are adjusted until the numbers that a scene predicts are those that were measured
//! (`least_squares.rs`), with the derivatives of each force by the adjoint method. Laplace's approximation
//! around the optimum gives intervals, and says which combinations of unknowns the data do not determine
//! (`uncertainty.rs`).

mod best_press;
mod chain;
mod correction;
mod data;
mod forward;
mod least_squares;
mod lump;
mod lump_start;
mod marker_motion;
mod picture;
mod predict_presses;
mod predict_recordings;
mod predict_swing;
mod profile;
mod readings;
mod recorded_body;
mod recording;
mod report;
mod search;
mod sentences;
mod stiffness_grid;
mod swing;
#[cfg(test)]
mod tests;
mod uncertainty;
mod unknown;

pub use data::Experiment;
pub use report::{Identified, IdentifiedValue, PressAdvice, Residual};
pub use unknown::Unknown;

use crate::gpu::Gpu;
use crate::scene::{Scene, scene_hash};
use crate::{Error, ProgressFn, Result};
use correction::Corrector;
use forward::MeasuredBody;
use least_squares::{Model, Start};
use search::Search;
use serde::{Deserialize, Serialize};
use web_time::Instant;

/// Name for all unknowns.
const ALL: &str = "all";

/// What to identify, and how.
#[derive(Clone, Debug, Default)]
pub struct IdentifyOptions {
    /// The unknowns; see [`Unknown::parse`].
    pub unknowns: Vec<Unknown>,
    /// Standard deviation of the measured numbers: of a curve relative to its largest force, of a map
    /// relative to each stiffness. Without it, it is estimated from the residuals.
    pub noise: Option<f64>,
    /// Number of starts; each but the first of all from other values within the bounds.
    pub starts: u32,
    /// Number of the first start, counted from 0: other computers may take those before it.
    pub first_start: u32,
    /// Names of unknowns whose intervals are found by profile likelihood; `all` for all but the nodes of a
    /// grid.
    pub profiled: Vec<String>,
    /// Whether to find the press that would tell most.
    pub advise: bool,
    /// Number of times that forces of linear tets are corrected by those of quadratic ones: at the first values,
    /// then at those found.
    pub corrections: u32,
    /// Steps of an earlier search of the same unknowns, with which each start goes on.
    pub earlier: Vec<IdentifyStep>,
}

impl IdentifyOptions {
    /// Whether the interval of an unknown is found by profile likelihood.
    fn profiles(&self, unknown: &str) -> bool {
        self.profiled.iter().any(|own| own == unknown || own == ALL)
    }

    /// Returns a hash of the unknowns, the scene and the data: steps with another fingerprint are of another
    /// search.
    pub fn fingerprint(&self, scene: &Scene, data: &[Experiment]) -> u64 {
        let mut crc = flate2::Crc::new();
        crc.update(format!("{:?} {:?} {data:?}", self.unknowns, self.noise).as_bytes());
        (u64::from(scene_hash(scene)) << 32) | u64::from(crc.sum())
    }
}

/// One step of an identification, for progress reports.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct IdentifyStep {
    /// Number of the start, counted from 1.
    pub start: u32,
    /// Number of the step, counted from 0.
    pub step: u32,
    /// Root mean square of the residuals over their standard deviations.
    pub misfit: f64,
    /// Names and values of the unknowns.
    pub values: Vec<(String, f64)>,
    /// Number of corrections by quadratic tets so far, and the factors of all numbers by the last of them.
    #[serde(default)]
    pub corrections: u32,
    /// See `corrections`; empty without one.
    #[serde(default)]
    pub ratios: Vec<f64>,
}

impl IdentifyStep {
    /// Returns the value of an unknown.
    fn value(&self, unknown: &str) -> Option<f64> {
        let own = self.values.iter().find(|(name, _)| name == unknown);
        own.map(|(_, value)| *value)
    }
}

/// Finds the unknowns of `scene` from measurements; without unknowns it compares measured and predicted
/// numbers. Calls `on_step` after each step of each start;
/// `progress` gets the stage and its completed fraction.
///
/// # Errors
/// [`Error::Input`] for data of another body, fewer numbers than unknowns, an unknown that the data do not
/// touch, or a body without gradients; as a press.
pub fn identify(
    gpu: &Gpu,
    scene: &Scene,
    data: &[Experiment],
    options: &IdentifyOptions,
    on_step: &mut dyn FnMut(&IdentifyStep) -> Result<()>,
    progress: ProgressFn,
) -> Result<Identified> {
    let clock = Instant::now();
    let body = MeasuredBody::new(gpu, scene, data, options)?;
    let corrector = Corrector::new((gpu, scene, data), &body, options)?;
    let mut identified = if body.unknowns().is_empty() {
        let model = Model::new(&body, progress);
        let now = model.at(&Start::number(0, &[]).theta)?;
        report::compared(&body, &now, options, progress)?
    } else {
        check(&body, options)?;
        let mut search = Search {
            body: &body,
            corrector: corrector.as_ref(),
            options,
            on_step,
            progress,
        };
        let found = search.run()?;
        let exact = corrector.as_ref().map(|corrector| &corrector.exact);
        report::identified((&body, exact), found, options, progress)?
    };
    identified.seconds = clock.elapsed().as_secs_f64();
    Ok(identified)
}

/// Returns the numbers that a scene predicts for experiments, in their order.
///
/// # Errors
/// As [`identify`].
#[cfg(feature = "study")]
pub(crate) fn predicted(gpu: &Gpu, scene: &Scene, data: &[Experiment]) -> Result<Vec<f64>> {
    let body = MeasuredBody::new(gpu, scene, data, &IdentifyOptions::default())?;
    let prediction = body.predict(&[], &crate::no_progress)?;
    Ok(prediction.numbers)
}

/// Predicted numbers, and for each noise the intervals of the unknowns.
#[cfg(feature = "study")]
pub(crate) struct Forecast {
    pub numbers: Vec<f64>,
    pub intervals: Vec<Vec<[f64; 2]>>,
}

/// The intervals of unknowns that experiments with a noise relative to each number are expected to give.
#[cfg(feature = "study")]
pub(crate) struct ExpectedIntervals<'a>(MeasuredBody<'a>);

#[cfg(feature = "study")]
impl ExpectedIntervals<'_> {
    /// Prepares the body of `scene`.
    ///
    /// # Errors
    /// As [`identify`].
    pub fn new<'a>(
        (gpu, scene, data): (&'a Gpu, &Scene, &[Experiment]),
        unknowns: Vec<Unknown>,
    ) -> Result<ExpectedIntervals<'a>> {
        let options = IdentifyOptions {
            unknowns,
            noise: Some(1.0),
            ..IdentifyOptions::default()
        };
        MeasuredBody::new(gpu, scene, data, &options).map(ExpectedIntervals)
    }

    /// Returns the intervals by Laplace's approximation at these values, for each noise: one prediction with
    /// its derivatives.
    ///
    /// # Errors
    /// As [`identify`].
    pub fn at(&self, values: &[f64], noises: &[f64]) -> Result<Forecast> {
        let found = self.0.predict(values, &crate::no_progress)?;
        let unknowns = self.0.unknowns();
        let jacobian = nalgebra::DMatrix::from_fn(found.numbers.len(), unknowns.len(), |i, k| {
            found.slopes[i][k] * unknowns[k].slope(values[k]) / found.numbers[i]
        });
        let information = jacobian.transpose() * jacobian;
        let of_noise = |noise: &f64| {
            let reach = uncertainty::reach_of_noise(information.clone(), *noise);
            let pairs = unknowns.iter().zip(values).zip(reach);
            let ends = pairs.map(|((unknown, value), reach)| {
                let theta = unknown.theta(*value);
                [unknown.value(theta - reach), unknown.value(theta + reach)]
            });
            ends.collect()
        };
        Ok(Forecast {
            intervals: noises.iter().map(of_noise).collect(),
            numbers: found.numbers,
        })
    }
}

/// Checks that the data may determine the unknowns.
fn check(body: &MeasuredBody, options: &IdentifyOptions) -> Result<()> {
    // What is known before the data determines the nodes of a grid.
    let determined = body.unknowns().len() - body.grid_nodes.len();
    if body.observations().len() < determined + usize::from(options.noise.is_none()) {
        return Err(Error::Input(format!(
            "{} measured numbers do not determine {} unknowns{}; give more data (--data), or fewer unknowns",
            body.observations().len(),
            determined,
            match options.noise {
                None => " and the noise",
                Some(_) => "",
            }
        )));
    }
    let is_known = |name: &&String| {
        let mut names = body.unknowns().iter().map(|own| own.name.as_str());
        *name == ALL || names.any(|own| own == *name)
    };
    match options.profiled.iter().find(|name| !is_known(name)) {
        None => Ok(()),
        Some(name) => Err(Error::Input(format!(
            "\"{name}\" is no unknown, so that it has no interval (--profile)"
        ))),
    }
}
