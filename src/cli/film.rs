//! Animations of the frames that a command renders, and the orbit of the camera around the body.

use clap::Args;
use palpate::render::{Animation, Camera};
use palpate::scene::Stage;
use std::path::PathBuf;

/// Flags of a film.
#[derive(Args, Clone, Debug, Default)]
pub struct AnimationFlags {
    /// Write an animation of all frames: .gif, or .mp4 with the installed program ffmpeg. For
    /// `render`, the camera orbits the body
    #[arg(long, value_name = "FILE", help_heading = "Film")]
    film: Option<PathBuf>,
    /// Set the frame rate of the film, 1/s
    #[arg(
        long,
        value_name = "N",
        default_value_t = 20.0,
        help_heading = "Film",
        requires = "film"
    )]
    fps: f64,
    /// Orbit the camera around the point it looks at, about its up axis, by this angle in degrees from
    /// the first frame to the last [default for a film of `render`: 360]
    #[arg(
        long,
        value_name = "DEGREES",
        help_heading = "Film",
        allow_hyphen_values = true,
        value_parser = angle
    )]
    pub orbit: Option<f64>,
}

fn angle(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(degrees) if degrees.is_finite() => Ok(degrees),
        _ => Err("expected an angle in degrees, such as 360".into()),
    }
}

impl AnimationFlags {
    /// Whether an animation is requested.
    pub fn is_requested(&self) -> bool {
        self.film.is_some()
    }

    /// Returns the flags for a static body: by default the camera makes a full orbit.
    pub fn with_full_orbit(&self) -> anyhow::Result<AnimationFlags> {
        if self.orbit.is_some() && !self.is_requested() {
            anyhow::bail!("--orbit requires a film; add --film FILE.gif");
        }
        Ok(AnimationFlags {
            orbit: self.orbit.or(Some(360.0)),
            ..self.clone()
        })
    }

    /// Rejects invalid output before the work starts.
    pub fn check(&self) -> palpate::Result<()> {
        match &self.film {
            Some(path) => Animation::check(path, self.fps),
            None => Ok(()),
        }
    }

    /// Begins the animation of the images of `stage`, if one is requested.
    pub fn start(&self, stage: &Stage) -> palpate::Result<Option<Animation>> {
        let film = self.film.as_ref();
        film.map(|path| Animation::create(path, stage.size(), self.fps))
            .transpose()
    }

    /// Frames the body from all sides, if the camera orbits.
    pub fn frame(&self, stage: &mut Stage, also: &[palpate::glam::DVec3]) -> palpate::Result<()> {
        match self.orbit {
            Some(_) => stage.fit_orbit(also),
            None if also.is_empty() => Ok(()),
            None => stage.fit_view(also),
        }
    }

    /// Returns the camera at the fraction `share` of the orbit that begins at `starts`.
    pub fn camera(&self, starts: &Camera, share: f64) -> Camera {
        starts.orbited(self.orbit.unwrap_or(0.0) * share)
    }
}

/// Ends an animation, unless it has no frames.
pub fn finish(film: Option<Animation>, frames: bool) -> palpate::Result<()> {
    match film {
        Some(film) if frames => film.finish(),
        _ => Ok(()),
    }
}
