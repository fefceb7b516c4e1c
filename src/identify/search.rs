//! The search for the unknowns: from each start, then again after each correction of the forces.

use super::correction::{Corrector, ForceCorrection};
use super::forward::MeasuredBody;
use super::least_squares::{self, Model, Solution, Start};
use super::{IdentifyOptions, IdentifyStep, lump_start};
use crate::{Error, ProgressFn, Result};
use nalgebra::DVector;

/// The best optimum.
pub(super) struct Found {
    pub best: Solution,
    /// Others that explain the data nearly as well.
    pub others: Vec<Solution>,
    /// Factors of the predicted numbers; none without corrections.
    pub ratios: Vec<f64>,
    /// Number of corrections.
    pub corrections: u32,
    /// By how much the last correction changed θ, unless it was the only one of this run.
    pub last_change: Option<DVector<f64>>,
}

/// What is searched, and how.
pub(super) struct Search<'a, 'b> {
    pub body: &'a MeasuredBody<'b>,
    pub corrector: Option<&'a Corrector<'b>>,
    pub options: &'a IdentifyOptions,
    pub on_step: &'a mut dyn FnMut(&IdentifyStep) -> Result<()>,
    pub progress: ProgressFn<'a>,
}

/// Numbers of the start, its last step and the corrections so far, counted from 0.
#[derive(Clone, Copy)]
struct Reached {
    start: u32,
    step: u32,
    corrections: u32,
}

/// Where the search of a start ended, and its factors.
struct Ended {
    reached: Reached,
    solution: Solution,
    ratios: Vec<f64>,
}

impl<'a, 'b> Search<'a, 'b> {
    /// Searches from each start, and from the best optimum again after each further correction.
    ///
    /// # Errors
    /// [`Error::Input`] if no start has led to an optimum; those of predictions at the first values, and of
    /// corrections.
    pub fn run(&mut self) -> Result<Found> {
        let first = self.options.first_start;
        let mut starts: Vec<u32> = (first..first + self.options.starts.max(1)).collect();
        // Later corrections are those of the best start.
        let earlier = self.options.earlier.iter();
        if let Some(step) = earlier.max_by_key(|step| step.corrections)
            && step.corrections > 1
            && self.corrector.is_some()
        {
            starts = vec![step.start.saturating_sub(1)];
        }
        let mut found = self.run_starts(&starts)?;
        found.sort_by(|a, b| {
            let squares = [a, b].map(|one| one.solution.sum_of_squares());
            squares[0].total_cmp(&squares[1])
        });
        let solutions: Vec<Solution> = found.iter().map(|one| one.solution.clone()).collect();
        let others = least_squares::distinct(&solutions);
        let mut best = found.into_iter().next().ok_or_else(|| {
            Error::Input(
                "no start has led to values with an equilibrium; set bounds (--bounds)".into(),
            )
        })?;
        let mut last_change = None;
        while let Some(corrector) = self.corrector
            && best.reached.corrections < self.options.corrections
        {
            let values = &best.solution.values;
            let ratios = corrector.ratios(self.body, values, self.progress)?;
            let theta = best.solution.theta.clone();
            let mut reached = best.reached;
            reached.corrections += 1;
            best = self.minimise(
                reached,
                &Start {
                    theta: theta.clone(),
                },
                ratios,
            )?;
            last_change = Some(&best.solution.theta - theta);
        }
        Ok(Found {
            best: best.solution,
            others,
            ratios: best.ratios,
            corrections: best.reached.corrections,
            last_change,
        })
    }

    /// Searches from each of `starts`; returns where each search ended, but for those that failed.
    fn run_starts(&mut self, starts: &[u32]) -> Result<Vec<Ended>> {
        let mut found = Vec::new();
        let mut balls = None;
        for start in starts {
            let begun = self.begin(*start, &mut balls);
            let ended =
                begun.and_then(|(reached, from, ratios)| self.minimise(reached, &from, ratios));
            match ended {
                Ok(one) => found.push(one),
                // Values far from the first ones may have no equilibrium.
                Err(Error::Input(_) | Error::Solver { .. }) if *start > starts[0] => {}
                Err(error) => return Err(error),
            }
        }
        Ok(found)
    }

    /// Returns where a start begins, with the factors of its first correction: at an earlier step, at one of the
    /// best `balls`, or at values within the bounds.
    fn begin(
        &self,
        start: u32,
        balls: &mut Option<Vec<Start>>,
    ) -> Result<(Reached, Start, Vec<f64>)> {
        let unknowns = self.body.unknowns();
        let mut earlier = self.options.earlier.iter().rev();
        let earlier = earlier.find(|step| step.start == start + 1);
        let from = match earlier {
            Some(step) => Start::from_step(step, unknowns),
            None => {
                let balls = match balls {
                    Some(balls) => balls,
                    none => none.insert(self.balls()?),
                };
                let ball = balls.get(start as usize).cloned();
                ball.unwrap_or_else(|| Start::number(start, unknowns))
            }
        };
        let mut reached = Reached {
            start,
            step: earlier.map_or(0, |step| step.step),
            corrections: 0,
        };
        let Some(corrector) = self.corrector else {
            return Ok((reached, from, Vec::new()));
        };
        let ratios = match earlier.filter(|step| !step.ratios.is_empty()) {
            Some(step) => {
                reached.corrections = step.corrections;
                step.ratios.clone()
            }
            None => {
                reached.corrections = 1;
                corrector.ratios(self.body, &from.values(unknowns), self.progress)?
            }
        };
        Ok((reached, from, ratios))
    }

    /// Returns the starts at the best balls, if a lump is searched.
    fn balls(&self) -> Result<Vec<Start>> {
        let Some(values) = lump_start::values_without_lump(self.body.unknowns()) else {
            return Ok(Vec::new());
        };
        let ratios = match self.corrector {
            Some(corrector) => corrector.ratios(self.body, &values, self.progress)?,
            None => Vec::new(),
        };
        lump_start::starts_at_best_balls(&self.model(&ratios), values)
    }

    fn minimise(&mut self, mut reached: Reached, from: &Start, ratios: Vec<f64>) -> Result<Ended> {
        let unknowns = self.body.unknowns();
        let model = self.model(&ratios);
        let (first, on_step) = (reached.step, &mut *self.on_step);
        let mut each = |step: u32, misfit: f64, values: &[f64]| {
            reached.step = first + step;
            let names = unknowns.iter().map(|own| own.name.clone());
            on_step(&IdentifyStep {
                start: reached.start + 1,
                step: reached.step,
                misfit,
                values: names.zip(values.iter().copied()).collect(),
                corrections: reached.corrections,
                ratios: ratios.clone(),
            })
        };
        let solution = least_squares::minimise(&model, from, &mut each)?;
        Ok(Ended {
            reached,
            solution,
            ratios,
        })
    }

    fn model<'c>(&self, ratios: &'c [f64]) -> Model<'c, 'b>
    where
        'a: 'c,
    {
        Model {
            ratios,
            ..Model::new(self.body, self.progress)
        }
    }
}

impl Found {
    /// Returns how quadratic tets corrected the forces of `body`, if they did.
    pub fn correction(&self, body: &MeasuredBody) -> Option<ForceCorrection> {
        let ends = |of: fn(f64, f64) -> f64| self.ratios.iter().copied().reduce(of);
        let ratios = [ends(f64::min)?, ends(f64::max)?];
        let unknowns = body.unknowns().iter().enumerate();
        let unknowns = unknowns.filter(|(k, _)| !body.grid_nodes.contains(k));
        let last_changes = self.last_change.as_ref().map(|change| {
            unknowns
                .map(|(k, unknown)| {
                    self.best.values[k] - unknown.value(self.best.theta[k] - change[k])
                })
                .collect()
        });
        Some(ForceCorrection {
            times: self.corrections,
            ratios,
            last_changes,
        })
    }
}
