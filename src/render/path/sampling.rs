//! The samples of a picture by light paths: how many are drawn at a time, and when they are enough.

use super::picture::PathPicture;
use super::{ITEMS, PathTracer};
use crate::progress::ProgressFn;
use crate::render::Image;
use crate::{Error, Result};

/// Most samples per pixel in a dispatch, between two looks for a cancellation.
const BATCH: u32 = 16;

/// Paths given up, and pixels that needed another dispatch, of all dispatches so far.
pub(super) struct Counts {
    pub lost: u32,
    pub unfinished: u32,
}

impl PathTracer {
    /// Filters the noise of pictures by that of the raycaster from the same camera: `guide`, of the
    /// same size.
    ///
    /// # Errors
    /// [`Error::Input`] for another size.
    pub fn filter_by(&mut self, guide: Image) -> Result<()> {
        if guide.size != self.size || guide.channels != 4 {
            return Err(Error::Input(
                "the guide of the filter must have the size of the picture".into(),
            ));
        }
        self.guide = Some(guide);
        Ok(())
    }

    /// Draws until each pixel has `until` samples.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the device fails.
    pub(super) fn draw_until(&mut self, until: u32) -> Result<()> {
        let mut unfinished = self.counts()?.unfinished;
        loop {
            for tile in &mut self.tiles {
                tile.params.until = until;
                let mut work = self.gpu.start_recording();
                tile.pass.set_params(&mut work, &tile.params)?;
                tile.pass.record(&mut work);
                work.submit()?;
            }
            // Reading waits for the device: a queue without bound would delay a cancellation.
            let before = std::mem::replace(&mut unfinished, self.counts()?.unfinished);
            if unfinished == before {
                self.samples = until;
                return Ok(());
            }
        }
    }

    /// Adds up to `more` samples per pixel, at most those of the options. Returns the picture; `None` if it
    /// had them all.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the device fails.
    pub fn refine(&mut self, more: u32) -> Result<Option<PathPicture>> {
        let until = self.options.samples.min(self.samples.saturating_add(more));
        if until <= self.samples {
            return Ok(None);
        }
        self.draw_until(until)?;
        self.picture().map(Some)
    }

    pub(super) fn counts(&self) -> Result<Counts> {
        let counts = self.gpu.read_buffer::<u32>(&self.counts)?;
        let at = |k: usize| counts.get(k).copied().unwrap_or(0);
        Ok(Counts {
            lost: at(0),
            unfinished: at(1),
        })
    }

    /// Adds samples until their number or the noise of the options is reached.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the device fails, and [`Error::Cancelled`].
    pub fn finish(&mut self, progress: ProgressFn) -> Result<PathPicture> {
        let most = self.options.samples;
        let mut next_look = 8;
        loop {
            let done = f64::from(self.samples) / f64::from(most);
            if progress("light paths", done).is_break() {
                return Err(Error::Cancelled);
            }
            // Small batches first, which say how long it takes.
            let batch = BATCH.min(self.samples.max(1));
            let mut until = most.min(self.samples + batch);
            if self.options.noise.is_some() && self.samples < next_look {
                until = until.min(next_look);
            }
            self.draw_until(until)?;
            if self.samples >= most {
                return self.picture();
            }
            // The noise is read back seldom: at powers of √2 or so of the samples.
            if let Some(noise) = self.options.noise
                && self.samples >= next_look
            {
                next_look = self.samples + self.samples / 2;
                let picture = self.picture()?;
                if picture.noise() <= noise {
                    return Ok(picture);
                }
            }
        }
    }

    /// Returns the picture of the samples so far. Waits for the device and reads back.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the device fails.
    pub fn picture(&self) -> Result<PathPicture> {
        let columns = self.size[0] as usize;
        let mut sums = vec![[[0.0f32; 4]; ITEMS]; columns * self.size[1] as usize];
        for tile in &self.tiles {
            let part: Vec<[[f32; 4]; ITEMS]> = self.gpu.read_buffer(&tile.sums)?;
            let [width, _] = tile.window.size.map(|n| n as usize);
            let [x, y] = tile.window.corner.map(|n| n as usize);
            for (line, row) in part.chunks_exact(width).zip(y..) {
                sums[row * columns + x..][..width].copy_from_slice(line);
            }
        }
        Ok(PathPicture::new(
            self.size,
            &sums,
            (self.samples, self.counts()?.lost),
            &self.options,
            self.guide.as_ref(),
        ))
    }
}
