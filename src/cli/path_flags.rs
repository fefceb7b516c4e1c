//! Flags of light paths.

use clap::Args;
use palpate::render::Light;
use palpate::scene::LightEntry;
use std::str::FromStr;

/// Value of `--light`.
#[derive(Clone, Copy, Debug)]
pub enum LightFlag {
    /// From the gradient at each place.
    Local(Light),
    /// By light paths.
    Path,
}

impl FromStr for LightFlag {
    type Err = palpate::Error;

    fn from_str(text: &str) -> palpate::Result<LightFlag> {
        match text {
            "path" => Ok(LightFlag::Path),
            other => Ok(LightFlag::Local(other.parse()?)),
        }
    }
}

/// Flags of a picture by light paths.
#[derive(Args, Clone, Debug, Default)]
pub struct PathFlags {
    /// Set the samples per pixel of light paths [default: 64]
    #[arg(long, value_name = "N", help_heading = "Light paths")]
    pub spp: Option<u32>,
    /// End light paths when the noise is at most this share of the light, such as 1%
    #[arg(long, value_name = "PERCENT", value_parser = super::refinement::percent, help_heading = "Light paths")]
    pub noise: Option<f64>,
    /// Set the seed of light paths: the same one gives the same picture [default: 0]
    #[arg(long, value_name = "N", help_heading = "Light paths")]
    pub seed: Option<u32>,
    /// Set what lights the body by paths: studio, white, or a picture .hdr or .exr of the surroundings
    /// [default: studio]
    #[arg(long, value_name = "ENVIRONMENT", help_heading = "Light paths")]
    pub environment: Option<String>,
    /// Multiply the extinction by this factor for light paths: above 1, tissue looks more solid
    /// [default: 1]
    #[arg(long, value_name = "FACTOR", help_heading = "Light paths")]
    pub extinction: Option<f64>,
    /// Filter the last noise of light paths
    #[arg(long, help_heading = "Light paths")]
    pub denoise: bool,
    /// Multiply the light of paths by this factor [default: 1]
    #[arg(long, value_name = "FACTOR", help_heading = "Light paths")]
    pub exposure: Option<f64>,
}

impl PathFlags {
    /// Overrides the light of a scene.
    pub fn apply_to(self, light: &mut LightEntry) {
        super::flags::override_with(self.spp, &mut light.samples);
        super::flags::override_with(self.noise, &mut light.noise);
        super::flags::override_with(self.seed, &mut light.seed);
        super::flags::override_with(self.environment, &mut light.environment);
        super::flags::override_with(self.extinction, &mut light.extinction);
        super::flags::override_with(self.denoise.then_some(true), &mut light.denoise);
        super::flags::override_with(self.exposure, &mut light.exposure);
    }
}
