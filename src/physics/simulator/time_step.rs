//! The range of time steps.

use crate::{Error, Result};

/// Checks a time step, s.
///
/// # Errors
/// [`Error::Input`] unless it is finite and positive.
pub(in crate::physics) fn check_time_step(dt: f64) -> Result<()> {
    match dt > 0.0 && dt.is_finite() {
        true => Ok(()),
        false => Err(Error::Input(time_step_message(dt))),
    }
}

/// Returns the message on a time step that [`check_time_step`] rejects.
pub(in crate::physics) fn time_step_message(dt: f64) -> String {
    format!("time step must be finite and > 0, got {dt} s")
}
