//! What a picture needs around it, drawn onto a finished one: a legend, a scale bar, axes, a title
//! and the time.
//!
//! It is drawn on the CPU and sized by the picture, so that small and large ones look alike.
//! Letters and lines are light on dark backgrounds and dark on light ones, with a rim of the other,
//! so that they can be read wherever they lie.

mod axes;
mod canvas;
mod heading;
mod legend;
mod numbers;
mod preset_sheet;
mod scale_bar;

pub use axes::Axes;
pub use heading::FrameTime;
pub use legend::{BarColours, ColourBar, Legend, Swatch};
pub use preset_sheet::preset_sheet;
pub use scale_bar::ScaleBar;

use crate::render::{Background, Camera, Image};
use crate::{Error, Result};
use canvas::Canvas;

/// What is drawn onto a picture; by default nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Annotations {
    /// A line of text at the top, in smaller letters where it is too long.
    pub title: Option<String>,
    /// The time that the picture shows, at the upper left.
    pub time: Option<FrameTime>,
    /// What the colours mean, at the right.
    pub legend: Option<Legend>,
    /// A length, at the lower right.
    pub scale_bar: Option<ScaleBar>,
    /// Where the axes point, at the lower left or at the picture's edges.
    pub axes: Option<Axes>,
}

impl Annotations {
    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        *self == Annotations::default()
    }

    /// Draws all of it onto `image`, a picture of `camera` that will be seen on `background`.
    ///
    /// # Errors
    /// [`Error::Input`] for a picture of other than four channels, or a bad camera.
    pub fn draw(&self, image: &mut Image, camera: &Camera, background: Background) -> Result<()> {
        if self.is_empty() {
            return Ok(());
        }
        if image.channels != 4 {
            return Err(Error::Input(format!(
                "a picture of {} channels cannot be annotated; four are expected (Image::in_colour makes them)",
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

/// What is taken already at the picture's edges, in pixels.
struct Margins {
    top: f32,
    right: f32,
}
