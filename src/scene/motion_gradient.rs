//! Gradients of the motion of a scene's body.

use super::Motion;
use crate::physics::{
    Capability, Gradient, LoadSchedule, Loads, Parameter, Quantity, SeriesReader,
};
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
        self.check_gradients()?;
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

    /// Takes steps until the values of a quantity after each of them determine numbers, and returns the
    /// gradients of these: [`Gradients::gradients_of_series`](crate::physics::Gradients::gradients_of_series).
    ///
    /// # Errors
    /// As [`Motion::gradient_of_motion`], and [`Error::Input`] for loads that change over time.
    pub(crate) fn gradients_of_series(
        &mut self,
        most_steps: u32,
        quantity: &Quantity,
        read: SeriesReader<'_>,
        parameters: &[Parameter],
        progress: ProgressFn<'_>,
    ) -> Result<Vec<Gradient>> {
        self.check_gradients()?;
        if self.time_dependent_loads.is_time_dependent() {
            return Err(Error::Input(
                "there are no gradients of a series under loads that change over time".into(),
            ));
        }
        self.wake();
        let steps = (most_steps, self.dt);
        let gradients = Capability::Gradients.require(self.simulator.gradients())?;
        let found = gradients.gradients_of_series(steps, quantity, read, parameters, progress);
        self.progress = self.simulator.progress().ok().or(self.progress);
        found
    }

    /// Checks that nothing moves by itself.
    fn check_gradients(&self) -> Result<()> {
        match self.attachments.is_empty() && self.dynamic_tools.is_empty() {
            true => Ok(()),
            false => Err(Error::Input(
                "there is no gradient of a motion with a [[grab]] or with tools that move freely; use a [[move]] or a [[tool]] with a `path`"
                    .into(),
            )),
        }
    }
}
