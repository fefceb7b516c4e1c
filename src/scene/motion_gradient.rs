//! Gradients of the motion of a scene's body.

use super::Motion;
use crate::physics::{Capability, Gradient, Parameter, Quantity};
use crate::progress::ProgressFn;
use crate::{Error, Result};

impl Motion {
    /// Takes steps and returns the gradient of a quantity at their end, or of its integral over time if
    /// `integral`: [`Gradients::gradient_of_motion`](crate::physics::Gradients::gradient_of_motion).
    ///
    /// # Errors
    /// [`Error::Input`] if loads of the scene depend on time, if something is grabbed, for tools that
    /// move freely, and for a body without gradients; otherwise as there.
    pub fn gradient_of_motion(
        &mut self,
        steps: u32,
        quantity: &Quantity,
        integral: bool,
        parameters: &[Parameter],
        progress: ProgressFn<'_>,
    ) -> Result<Gradient> {
        if !self.has_constant_loads() {
            return Err(Error::Input(
                "a gradient of a motion requires constant loads, but this scene has grabs, free tools, or paths or loads that depend on time; remove them"
                    .into(),
            ));
        }
        self.wake();
        let steps = (steps, self.dt);
        let gradients = Capability::Gradients.require(self.simulator.gradients())?;
        let found = gradients.gradient_of_motion(steps, quantity, integral, parameters, progress);
        // Also of the steps before an error.
        self.progress = self.simulator.progress().ok().or(self.progress);
        found
    }
}
