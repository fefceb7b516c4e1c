//! Loads of a body that are scaled by an amplitude.

use crate::Result;
use crate::physics::{AmplitudeId, ScaledLoad};

/// Pressures and muscles of a body.
pub trait ScaledLoads {
    /// Adds a pressure or a muscle, with amplitude 0 until [`ScaledLoads::set_amplitude`].
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the load is invalid for this body.
    fn add_scaled_load(&mut self, load: ScaledLoad) -> Result<AmplitudeId>;

    /// Sets the amplitude of a pressure, Pa, or of a muscle, from 0 to 1; takes effect with the
    /// next step.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the amplitude is out of range or `id` is unknown.
    fn set_amplitude(&mut self, id: AmplitudeId, amplitude: f64) -> Result<()>;
}
