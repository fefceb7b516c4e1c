//! Light paths of a scene: `[light] model = "path"`.

use super::entries::LightEntry;
use crate::Result;
use crate::render::{Environment, Light, PathOptions};

impl LightEntry {
    /// Returns the environment if it is a file.
    pub(super) fn environment_file(&mut self) -> impl Iterator<Item = &mut String> {
        let named = self.environment.as_mut();
        named.filter(|name| name.contains('.')).into_iter()
    }

    /// Returns the options of light paths, if the scene has this model of light.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for a value out of range, with its key.
    pub(super) fn paths(&self) -> Result<Option<PathOptions>> {
        if self.model.as_deref() != Some("path") {
            return Ok(None);
        }
        let default = PathOptions::default();
        let environment = match (&self.environment, self.from) {
            (Some(named), _) => Environment::parse(named)?,
            (None, Some(Light::From(way))) => Environment::Sun(way),
            (None, _) => default.environment,
        };
        let options = PathOptions {
            samples: self.samples.unwrap_or(default.samples),
            noise: self.noise,
            seed: self.seed.unwrap_or(default.seed),
            environment,
            exposure: self.exposure.unwrap_or(default.exposure),
            extinction: self.extinction.unwrap_or(default.extinction),
            denoise: self.denoise.unwrap_or(default.denoise),
            roughness: self.roughness.unwrap_or(default.roughness),
            anisotropy: self.anisotropy.unwrap_or(default.anisotropy),
            aperture: self.aperture.unwrap_or(default.aperture),
            focus: self.focus,
        };
        options.check_ranges()?;
        Ok(Some(options))
    }
}
