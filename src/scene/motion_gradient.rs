//! Gradients of the motion of a scene's body.

use super::Motion;
use crate::physics::{Capability, Gradient, LoadSchedule, Loads, Parameter, Quantity};
use crate::progress::ProgressFn;
use crate::{Error, Result};

impl Motion {
    /// Takes steps and returns the gradient of a quantity at their end, or of its integral over time if
    /// `integral`: [`Gradients::gradient_of_motion`](crate::physics::Gradients::gradient_of_motion).
    ///
    /// # Errors
    /// [`Error::Input`] if something is grabbed, for tools that move freely, and for a body without
    /// gradients; otherwise as there.
    pub fn gradient_of_motion(
        &mut self,
        steps: u32,
        quantity: &Quantity,
        integral: bool,
        parameters: &[Parameter],
        progress: ProgressFn<'_>,
    ) -> Result<Gradient> {
        if !self.attachments.is_empty() || !self.dynamic_tools.is_empty() {
            return Err(Error::Input(
                "there is no gradient of a motion with a [[grab]] or with tools that move freely; use a [[move]] or a [[tool]] with a `path`"
                    .into(),
            ));
        }
        self.wake();
        let (start, dt) = (self.time(), self.dt);
        let actors = &self.time_dependent_loads;
        let kind = self.simulator.integrator();
        let mut apply = |step: u32, loads: &mut Loads| {
            actors.set_loads(loads, kind, (start + f64::from(step) * dt, dt))
        };
        let mut schedule: Option<LoadSchedule<'_>> = None;
        if actors.is_time_dependent() {
            schedule = Some(&mut apply);
        }
        let steps = (steps, dt);
        let gradients = Capability::Gradients.require(self.simulator.gradients())?;
        let found =
            gradients.gradient_of_motion(steps, quantity, integral, parameters, schedule, progress);
        // Also of the steps before an error.
        self.progress = self.simulator.progress().ok().or(self.progress);
        found
    }
}
