//! The error of the force of a press that rests, estimated on a background thread.

use super::BodySession;
use crate::loading::BackgroundTask;
use eframe::egui;
use palpate::Error;
use palpate::accuracy::ErrorParts;
use palpate::gpu::Gpu;
use std::time::Duration;
use web_time::Instant;

/// Time for which the finger rests before the estimate starts.
const REST: Duration = Duration::from_millis(400);
/// Largest number of elements of the finer space: 126,000 take a minute.
const MAX_ELEMENTS: usize = 30_000;

/// The estimate of a press at one depth.
#[derive(Default)]
pub(super) struct PressErrorEstimate {
    rests_since: Option<Instant>,
    task: Option<BackgroundTask<ErrorParts>>,
    /// The parts of the error, or why there are none.
    found: Option<std::result::Result<ErrorParts, String>>,
}

impl BodySession {
    /// Starts the estimate of a press that rests, takes its result, and cancels that of one that moves.
    pub fn update_press_error(&mut self, gpu: &Gpu, context: &egui::Context) {
        let pressed = self.force().is_some_and(|force| force > 0.0);
        if self.finger_moves() || !pressed || self.press_warning().is_some() {
            self.press_error = PressErrorEstimate::default();
            return;
        }
        let own = &mut self.press_error;
        if let Some(done) = own.task.as_ref().and_then(BackgroundTask::try_take) {
            own.task = None;
            own.found = Some(done.map_err(|why| match why {
                Error::Solver { .. } => "the body has no equilibrium near this one in the finer space; press less deep, or use a finer mesh".into(),
                other => other.to_string(),
            }));
        }
        if own.task.is_some() || own.found.is_some() {
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
        match session.error_estimate(motion, MAX_ELEMENTS) {
            Ok(estimate) => {
                let gpu = gpu.clone();
                let work = move |progress: palpate::ProgressFn<'_>| estimate(&gpu, progress);
                let task = BackgroundTask::spawn("estimating the error", context, work);
                self.press_error.task = Some(task);
            }
            Err(why) => self.press_error.found = Some(Err(why.to_string())),
        }
    }

    /// Returns the parts of the error of the force of a press that rests, N, or why there are none;
    /// `None` before.
    pub fn press_error(&self) -> Option<std::result::Result<&ErrorParts, &str>> {
        let found = self.press_error.found.as_ref()?;
        Some(found.as_ref().map_err(String::as_str))
    }

    /// Whether the error is being estimated.
    pub fn is_estimating(&self) -> bool {
        self.press_error.task.is_some()
    }
}
