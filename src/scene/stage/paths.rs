//! Pictures of a stage by light paths.

use super::Stage;
use crate::Result;
use crate::progress::ProgressFn;
use crate::render::{Image, PathOptions};

/// How a picture by light paths came about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PathReport {
    pub samples: u32,
    /// Standard error of the light, relative to it.
    pub noise: f64,
    pub lost: u32,
}

impl Stage {
    /// Draws the picture by light paths: as shown, and linear.
    pub(super) fn draw_paths(
        &mut self,
        options: &PathOptions,
        progress: ProgressFn,
    ) -> Result<[Image; 2]> {
        let tools = self.looks.tools.iter().map(|tool| &tool.skin);
        let mut walls = Vec::new();
        for skin in self.looks.skins.iter().chain(tools) {
            walls.extend(skin.walls()?);
        }
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
