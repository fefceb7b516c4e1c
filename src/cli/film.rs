//! Animations of the frames that a command renders, and the orbit of the camera around the body.

use clap::Args;
use palpate::render::{Animation, Camera};
use palpate::scene::Stage;
use std::path::PathBuf;

/// Flags of a film.
#[derive(Args, Clone, Debug, Default)]
pub struct AnimationFlags {
    /// Makes a film of all frames: .gif, or .mp4 by the installed program ffmpeg. Of `render`, of
    /// what it draws, the camera going round it
    #[arg(long, value_name = "FILE", help_heading = "Film")]
    film: Option<PathBuf>,
    /// Frames of the film a second
    #[arg(
        long,
        value_name = "N",
        default_value_t = 20.0,
        help_heading = "Film",
        requires = "film"
    )]
    fps: f64,
    /// The camera goes round what it looks at, about its up axis, by so many degrees from the first
    /// frame to the last [default of a film by `render`: 360]
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
        _ => Err("degrees are expected, 360 for example".into()),
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
            anyhow::bail!(
                "--orbit is the way of the camera in a film, and this is one picture: give --film FILE.gif too"
            );
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
