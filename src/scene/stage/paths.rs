//! Pictures of a stage by light paths.

use super::Stage;
use crate::progress::ProgressFn;
use crate::render::{Image, PathOptions, ProgressivePaths, Wall};
use crate::skin::{PendingWalls, Skin};
use crate::{Error, Result};

/// How a picture by light paths came about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PathReport {
    pub samples: u32,
    /// Standard error of the light, relative to it.
    pub noise: f64,
    pub lost: u32,
}

/// A picture by light paths whose surfaces are being read back.
pub(super) struct StartingPaths {
    options: PathOptions,
    pending: Vec<PendingWalls>,
    /// Those that have arrived.
    walls: Vec<Wall>,
}

fn wait_for(pending: Vec<PendingWalls>) -> Result<Vec<Wall>> {
    let each: Result<Vec<_>> = pending.into_iter().map(PendingWalls::wait).collect();
    Ok(each?.concat())
}

impl Stage {
    /// Draws the picture by light paths: as shown, and linear.
    pub(super) fn draw_paths(
        &mut self,
        options: &PathOptions,
        progress: ProgressFn,
    ) -> Result<[Image; 2]> {
        let walls = wait_for(self.pending_walls()?)?;
        let (camera, size) = (self.looks.camera, self.looks.size);
        let mut paths = self
            .looks
            .raycaster
            .start_paths(&camera, size, (options, &walls))?;
        if options.denoise {
            let guide = self.draw()?;
            paths.filter_by(guide)?;
        }
        let picture = paths.finish(progress)?;
        self.path_report = Some(PathReport {
            samples: picture.samples(),
            noise: picture.noise(),
            lost: picture.lost(),
        });
        Ok([picture.shown(), picture.linear().clone()])
    }

    /// Adds `more` samples per pixel to the picture by light paths of the last call, or begins a `fresh` one
    /// of the present state. Returns it as [`Stage::rgba`] does, without annotations; `None` if it has the
    /// samples of the scene.
    ///
    /// # Errors
    /// As [`Stage::start_paths`].
    pub fn refine_paths(&mut self, more: u32, fresh: bool) -> Result<Option<Vec<u8>>> {
        let mut tracer = match self.path_tracer.take().filter(|_| !fresh) {
            Some(tracer) => tracer,
            None => {
                let (options, pending) = self.prepare_paths()?;
                let walls = wait_for(pending)?;
                let (camera, size) = (self.looks.camera, self.looks.size);
                let with = (&options, walls.as_slice());
                self.looks.raycaster.start_paths(&camera, size, with)?
            }
        };
        let picture = tracer.refine(more)?;
        self.path_tracer = Some(tracer);
        let background = self.looks.background;
        Ok(picture.map(|picture| picture.shown().rgba8(background)))
    }

    /// Returns the picture in local light as [`Stage::rgba`] does, also in a scene with light paths.
    ///
    /// # Errors
    /// As [`Stage::image`].
    pub fn rgba_in_local_light(&mut self) -> Result<Vec<u8>> {
        let paths = self.looks.paths.take();
        if paths.is_some() {
            self.cached = None;
        }
        let drawn = self.rgba();
        if paths.is_some() {
            self.cached = None;
        }
        self.looks.paths = paths;
        drawn
    }

    /// Updates what paths see to the present state. Returns their options, and the surfaces on their way.
    fn prepare_paths(&mut self) -> Result<(PathOptions, Vec<PendingWalls>)> {
        let options = self.looks.paths.clone().ok_or_else(|| {
            Error::Input("the scene has no light paths; set `model = \"path\"` in [light]".into())
        })?;
        self.publish_now()?;
        self.follow_tools()?;
        self.refresh_field()?;
        Ok((options, self.pending_walls()?))
    }

    /// Starts to read back the surfaces of skins and tools.
    fn pending_walls(&self) -> Result<Vec<PendingWalls>> {
        let tools = self.looks.tools.iter().map(|tool| &tool.skin);
        let skins = self.looks.skins.iter().chain(tools);
        skins.map(Skin::walls).collect()
    }

    /// Starts a picture by light paths of `size` pixels, of the present state, over the backdrop, that a
    /// window draws over its frames; it remains that state. Does not block: returns `None` while surfaces
    /// of skins and tools are read back; call again, and not `fresh`, until the picture is there.
    ///
    /// # Errors
    /// [`Error::Input`] for a scene without light paths; otherwise as [`Stage::image`].
    pub fn start_paths(&mut self, size: [u32; 2], fresh: bool) -> Result<Option<ProgressivePaths>> {
        let started = self.starting_paths.take().filter(|_| !fresh);
        let mut starting = match started {
            Some(starting) => starting,
            None => {
                let (options, pending) = self.prepare_paths()?;
                StartingPaths {
                    options,
                    pending,
                    walls: Vec::new(),
                }
            }
        };
        while let Some(next) = starting.pending.first_mut() {
            match next.try_take()? {
                Some(walls) => starting.walls.extend(walls),
                None => {
                    self.starting_paths = Some(starting);
                    return Ok(None);
                }
            }
            starting.pending.remove(0);
        }
        let (camera, over) = (self.looks.camera, (size, self.backdrop));
        let with = (&starting.options, starting.walls.as_slice());
        let raycaster = &mut self.looks.raycaster;
        raycaster
            .start_progressive_paths(&camera, over, with)
            .map(Some)
    }

    /// Whether the picture is drawn by light paths, which takes its time.
    pub fn draws_paths(&self) -> bool {
        self.looks.paths.is_some()
    }

    /// Returns a note on the samples and the noise of the last picture, if it was drawn by light
    /// paths.
    pub fn path_note(&self) -> Option<String> {
        let report = self.path_report?;
        let lost = match report.lost {
            0 => String::new(),
            n => format!(
                "; paths given up: {n}, as in inverted tets, where the picture may be too dark"
            ),
        };
        Some(format!(
            "light paths: {} samples per pixel, noise {:.2} % before filtering{lost}",
            report.samples,
            100.0 * report.noise
        ))
    }
}
