//! The error of the force of a press, and the force on finer meshes, estimated on a background thread
//! while the finger rests. A finger that moves has the relative error of the nearest depth at which it
//! rested.

use super::BodySession;
use crate::loading::BackgroundTask;
use eframe::egui;
use palpate::Error;
use palpate::accuracy::{ErrorParts, Round};
use palpate::gpu::Gpu;
use palpate::press::PressSample;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use web_time::Instant;

/// Time for which the finger rests before the estimate starts.
const REST: Duration = Duration::from_millis(400);
/// Largest number of elements of a finer mesh: 126,000 take a minute.
const MAX_ELEMENTS: usize = 30_000;

/// The estimates of a press at one site.
#[derive(Default)]
pub(super) struct PressErrorEstimate {
    rests_since: Option<Instant>,
    /// The sample whose error is being estimated, or was.
    sample: Option<PressSample>,
    task: Option<BackgroundTask<()>>,
    /// The estimates of that sample that the task has found and that are not taken yet.
    found: Arc<Mutex<Vec<ForceOnMesh>>>,
    /// Why there is no error of that sample.
    failed: Option<String>,
    /// The samples with known errors.
    known: Vec<KnownForce>,
}

/// The force of a press on one mesh.
#[derive(Clone, Debug)]
pub struct ForceOnMesh {
    pub round: Round,
    /// The parts of its error, N.
    pub error: ErrorParts,
}

/// What is known about the force of a sample.
struct KnownForce {
    sample: PressSample,
    /// The parts of its error, N.
    error: ErrorParts,
    /// The most exact force on a finer mesh.
    refined: Option<ForceOnMesh>,
}

/// The error of the present force of a press.
pub struct PressError {
    /// Its parts, N.
    pub parts: ErrorParts,
    /// Whether the finger has another depth than at the estimate, whose relative error this is.
    pub is_of_another_depth: bool,
    /// The most exact force at this depth on a finer mesh.
    pub refined: Option<ForceOnMesh>,
}

impl BodySession {
    /// Starts the estimate of a press that rests, takes its result, and cancels that of one that moves.
    pub fn update_press_error(&mut self, gpu: &Gpu, context: &egui::Context) {
        let pressed = self.samples().last().filter(|s| s.force_n > 0.0).copied();
        let pressed = pressed.filter(|_| self.force().is_some() && self.press_warning().is_none());
        let Some(sample) = pressed else {
            self.press_error = PressErrorEstimate::default();
            return;
        };
        let moves = self.finger_moves();
        let own = &mut self.press_error;
        if moves || own.sample.is_some_and(|last| last != sample) {
            let known = std::mem::take(&mut own.known);
            *own = PressErrorEstimate {
                known,
                ..PressErrorEstimate::default()
            };
            if moves {
                return;
            }
        }
        own.take_found(sample);
        if let Some(done) = own.task.as_ref().and_then(BackgroundTask::try_take) {
            own.task = None;
            own.take_found(sample);
            let is_known = own.known.last().is_some_and(|known| known.sample == sample);
            match done {
                // The error is known, however far its mesh could be refined.
                Ok(()) => {}
                Err(_) if is_known => {}
                Err(Error::Solver { .. }) => own.failed = Some("the body has no equilibrium near this one in the finer space; press less deep, or use a finer mesh".into()),
                Err(other) => own.failed = Some(other.to_string()),
            }
        }
        if own.sample.is_some() {
            return;
        }
        let rests = own.rests_since.get_or_insert_with(Instant::now).elapsed();
        if rests < REST || self.under_way {
            context
                .request_repaint_after(REST.saturating_sub(rests).max(Duration::from_millis(20)));
            return;
        }
        let (Ok(session), Some(motion)) = (&self.fingertip, self.stage.motion()) else {
            return;
        };
        self.press_error.sample = Some(sample);
        match session.force_estimates(motion, MAX_ELEMENTS) {
            Ok(estimate) => {
                let gpu = gpu.clone();
                let (found, woken) = (self.press_error.found.clone(), context.clone());
                let mut each = move |round: &Round, error: &ErrorParts| {
                    let force = ForceOnMesh {
                        round: round.clone(),
                        error: *error,
                    };
                    found
                        .lock()
                        .unwrap_or_else(PoisonError::into_inner)
                        .push(force);
                    woken.request_repaint();
                };
                let work =
                    move |progress: palpate::ProgressFn<'_>| estimate(&gpu, &mut each, progress);
                let task = BackgroundTask::spawn("estimating the error", context, work);
                self.press_error.task = Some(task);
            }
            Err(why) => self.press_error.failed = Some(why.to_string()),
        }
    }

    /// Returns the error of the force of a press, or why it has none; `None` before the first estimate.
    pub fn press_error(&self) -> Option<std::result::Result<PressError, &str>> {
        if let Some(why) = &self.press_error.failed {
            return Some(Err(why));
        }
        let now = self.samples().last()?;
        let off = |known: &KnownForce| (known.sample.depth_m - now.depth_m).abs();
        // Of two at the same depth the later one.
        let known = self.press_error.known.iter().rev();
        let known = known.min_by(|a, b| off(a).total_cmp(&off(b)))?;
        let is_of_another_depth = known.sample != *now;
        Some(Ok(PressError {
            parts: known.error.scaled(now.force_n / known.sample.force_n),
            is_of_another_depth,
            refined: known.refined.clone().filter(|_| !is_of_another_depth),
        }))
    }

    /// Whether the error is being estimated, or the force found on a finer mesh.
    pub fn is_estimating(&self) -> bool {
        self.press_error.task.is_some()
    }
}

impl PressErrorEstimate {
    /// Takes the estimates of `sample` that the task has found so far: the first is that of its own mesh;
    /// of the others, those that are more exact than what is known.
    fn take_found(&mut self, sample: PressSample) {
        let mut found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        for force in found.drain(..) {
            match self.known.last_mut().filter(|known| known.sample == sample) {
                Some(known) => {
                    let now = known
                        .refined
                        .as_ref()
                        .map_or(&known.error, |best| &best.error);
                    if force.error.total() < now.total() {
                        known.refined = Some(force);
                    }
                }
                None => self.known.push(KnownForce {
                    sample,
                    error: force.error,
                    refined: None,
                }),
            }
        }
    }
}
