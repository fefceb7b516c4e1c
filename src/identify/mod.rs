//! `palpate identify`: material parameters from measured presses and recordings, with intervals.
//!
//! Unknowns are adjusted until the numbers that a scene predicts are those that were measured
//! (`least_squares.rs`), with the derivatives of each force by the adjoint method. Laplace's approximation
//! around the optimum gives intervals, and says which combinations of unknowns the data do not determine
//! (`uncertainty.rs`).

mod best_press;
mod chain;
mod data;
mod forward;
mod least_squares;
mod lump;
mod lump_start;
mod predict_presses;
mod predict_recordings;
mod readings;
mod recorded_body;
mod recording;
mod report;
mod stiffness_grid;
mod swing;
#[cfg(test)]
mod tests;
mod uncertainty;
mod unknown;

pub use data::Experiment;
pub use report::{Identified, IdentifiedValue, PressAdvice, Residual, StiffnessFactor};
pub use unknown::Unknown;

use crate::gpu::Gpu;
use crate::scene::Scene;
use crate::{Error, ProgressFn, Result};
use forward::MeasuredBody;
use least_squares::{Model, Start};
use web_time::Instant;

/// What to identify, and how.
#[derive(Clone, Debug, Default)]
pub struct IdentifyOptions {
    /// The unknowns; see [`Unknown::parse`].
    pub unknowns: Vec<Unknown>,
    /// Standard deviation of the measured numbers: of a curve relative to its largest force, of a map
    /// relative to each stiffness. Without it, it is estimated from the residuals.
    pub noise: Option<f64>,
    /// Number of starts; each but the first from other values within the bounds.
    pub starts: u32,
    /// Whether to find the press that would tell most.
    pub advise: bool,
}

/// One step of an identification, for progress reports.
#[derive(Clone, Debug)]
pub struct IdentifyStep {
    /// Number of the start, counted from 1.
    pub start: u32,
    /// Number of the step, counted from 0.
    pub step: u32,
    /// Root mean square of the residuals over their standard deviations.
    pub misfit: f64,
    /// Names and values of the unknowns.
    pub values: Vec<(String, f64)>,
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
    let unknowns = body.unknowns();
    if unknowns.is_empty() {
        let now = Model {
            body: &body,
            progress,
        };
        let now = now.at(&Start::number(0, unknowns).theta)?;
        return report::compared(&body, &now, options, progress).map(|mut found| {
            found.seconds = clock.elapsed().as_secs_f64();
            found
        });
    }
    // What is known before the data determines the nodes of a grid.
    let determined = unknowns.len() - body.grid_nodes.len();
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
    let named = |values: &[f64]| {
        let pairs = unknowns.iter().zip(values);
        pairs
            .map(|(own, value)| (own.name.clone(), *value))
            .collect()
    };
    let mut found = Vec::new();
    for start in 0..options.starts.max(1) {
        let chosen = match start {
            0 => lump_start::start_at_best_ball(&body, progress)?,
            _ => None,
        };
        let from = chosen.unwrap_or_else(|| Start::number(start, unknowns));
        let mut each = |step: u32, misfit: f64, values: &[f64]| {
            on_step(&IdentifyStep {
                start: start + 1,
                step,
                misfit,
                values: named(values),
            })
        };
        let model = Model {
            body: &body,
            progress,
        };
        match (least_squares::minimise(&model, &from, &mut each), start) {
            (Ok(solution), _) => found.push(solution),
            // Values far from the first ones may have no equilibrium.
            (Err(Error::Input(_) | Error::Solver { .. }), 1..) => {}
            (Err(error), _) => return Err(error),
        }
    }
    found.sort_by(|a, b| a.sum_of_squares().total_cmp(&b.sum_of_squares()));
    let hollows = least_squares::distinct(&found);
    let best = found.into_iter().next().ok_or_else(|| {
        Error::Input("no start has led to values with an equilibrium; set bounds (--bounds)".into())
    })?;
    report::identified(&body, (best, hollows), options, progress).map(|mut identified| {
        identified.seconds = clock.elapsed().as_secs_f64();
        identified
    })
}
