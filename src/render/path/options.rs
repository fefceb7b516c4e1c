//! Options of light paths.

use super::Environment;
use crate::render::{Camera, Projection};
use crate::{Error, Result};

/// Options of a path-traced picture.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PathOptions {
    /// Largest number of samples per pixel.
    pub samples: u32,
    /// Noise at which sampling ends: root mean square of the standard error of the pixels'
    /// luminances, relative to their mean.
    pub noise: Option<f64>,
    /// Seed of the random numbers.
    pub seed: u32,
    /// What lights the body.
    pub environment: Environment,
    /// Factor on the light before tone mapping.
    pub exposure: f64,
    /// Factor on the extinction: above 1, tissue looks more solid.
    pub extinction: f64,
    /// Whether the remaining noise is filtered.
    pub denoise: bool,
    /// Roughness of surfaces, 0.1 to 1.
    pub roughness: f64,
    /// Mean cosine of the scattering angle in soft tissue (g of Henyey and Greenstein), −0.95 to
    /// 0.95.
    pub anisotropy: f64,
    /// Radius of the lens, in file units; 0: all is in focus.
    pub aperture: f64,
    /// Distance from the eye of the plane in focus, in file units; by default that of the point
    /// looked at.
    pub focus: Option<f64>,
}

impl Default for PathOptions {
    fn default() -> PathOptions {
        PathOptions {
            samples: 64,
            noise: None,
            seed: 0,
            environment: Environment::Studio,
            exposure: 1.0,
            extinction: 1.0,
            denoise: false,
            roughness: 0.4,
            anisotropy: 0.0,
            aperture: 0.0,
            focus: None,
        }
    }
}

impl PathOptions {
    /// Checks ranges; `camera` is the one that the picture will have.
    ///
    /// # Errors
    /// [`Error::Input`] with the key, the range and the value.
    pub(super) fn check(&self, camera: &Camera) -> Result<()> {
        self.check_ranges()?;
        if self.aperture > 0.0 && matches!(camera.projection, Projection::Orthographic { .. }) {
            return Err(Error::Input(
                "an orthographic camera has no lens; remove `aperture` or `orthographic`".into(),
            ));
        }
        Ok(())
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Input`] with the key, the range and the value.
    pub fn check_ranges(&self) -> Result<()> {
        let number = |what: &str, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            Err(Error::Input(format!(
                "[light] {what} must be in [{low}, {high}], got {value}"
            )))
        };
        number("samples", f64::from(self.samples), 1.0, 1_048_576.0)?;
        if let Some(noise) = self.noise {
            number("noise (a fraction)", noise, 1e-5, 1.0)?;
        }
        number("exposure", self.exposure, 1e-3, 1e3)?;
        number("extinction", self.extinction, 1e-3, 1e4)?;
        number("roughness", self.roughness, 0.1, 1.0)?;
        number("anisotropy", self.anisotropy, -0.95, 0.95)?;
        number("aperture", self.aperture, 0.0, 1e9)?;
        match self.focus {
            Some(focus) => number("focus", focus, f64::MIN_POSITIVE, 1e12),
            None => Ok(()),
        }
    }

    /// Returns the distance of the plane in focus from the eye, in file units.
    pub(super) fn focus_distance(&self, camera: &Camera) -> f64 {
        self.focus
            .unwrap_or_else(|| camera.eye.distance(camera.look_at))
    }
}
