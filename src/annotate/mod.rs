//! Annotations of a finished image: legend, scale bar, axes, title and time.
//!
//! They are drawn on the CPU and scaled with the image, so that small and large images look alike.
//! Text and lines are light on dark backgrounds and dark on light ones, with a halo of the opposite
//! brightness, so that they are legible everywhere.

mod axes;
mod canvas;
mod heading;
mod labels;
mod legend;
mod numbers;
mod preset_sheet;
mod scale_bar;

pub use axes::Axes;
pub(crate) use canvas::Anchor;
pub(crate) use canvas::{font_size, missing_letters};
pub use heading::FrameTime;
pub(crate) use labels::{Label, draw_labels};
pub use legend::{BarColours, ColourBar, Legend, Swatch};
pub use preset_sheet::preset_sheet;
pub use scale_bar::ScaleBar;

use crate::render::{Background, Camera, Image};
use crate::{Error, Result};
use canvas::Canvas;

/// Annotations of an image; none by default.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Annotations {
    /// A line of text at the top, shrunk if it is too long.
    pub title: Option<String>,
    /// Time of the image, at the upper left.
    pub time: Option<FrameTime>,
    /// Colour legend, at the right.
    pub legend: Option<Legend>,
    /// Scale bar, at the lower right.
    pub scale_bar: Option<ScaleBar>,
    /// Axis indicator, at the lower left or at the image edges.
    pub axes: Option<Axes>,
}

impl Annotations {
    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        *self == Annotations::default()
    }

    /// Draws all annotations onto `image`, rendered with `camera` for display on `background`.
    ///
    /// # Errors
    /// [`Error::Input`] for an image without exactly four channels, or an invalid camera.
    pub fn draw(&self, image: &mut Image, camera: &Camera, background: Background) -> Result<()> {
        if self.is_empty() {
            return Ok(());
        }
        if image.channels != 4 {
            return Err(Error::Input(format!(
                "an annotated image must have 4 channels, got {}; convert it with Image::to_rgba",
                image.channels
            )));
        }
        camera.check()?;
        let mut canvas = Canvas::new(image.size, background)?;
        let mut margins = Margins {
            top: canvas.margin(),
            right: canvas.margin(),
        };
        if let Some(title) = &self.title {
            margins.top = heading::draw_title(&mut canvas, title);
        }
        if let Some(time) = &self.time {
            heading::draw_time(&mut canvas, time, margins.top);
        }
        if let Some(legend) = &self.legend {
            margins.right = legend.draw(&mut canvas);
        }
        if let Some(bar) = &self.scale_bar {
            bar.draw(&mut canvas, camera);
        }
        if let Some(axes) = self.axes {
            axes.draw(&mut canvas, camera, &margins);
        }
        canvas.composite_over(image);
        Ok(())
    }
}

/// Space already occupied at the image edges, in pixels.
struct Margins {
    top: f32,
    right: f32,
}
