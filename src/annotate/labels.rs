//! Words at places of an image.

use super::canvas::{Anchor, Canvas};
use crate::Result;
use crate::render::{Background, Image};

/// Words at a place of an image.
pub(crate) struct Label {
    pub words: String,
    /// Place on the baseline, in pixels.
    pub at: [f32; 2],
    pub anchor: Anchor,
    /// Height relative to that of other text.
    pub size: f32,
}

/// Draws labels for display on `background`.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) for an image too large to be annotated.
pub(crate) fn draw_labels(
    image: &mut Image,
    background: Background,
    labels: &[Label],
) -> Result<()> {
    let mut canvas = Canvas::new(image.size, background)?;
    let (em, ink) = (canvas.em, canvas.foreground);
    for label in labels {
        canvas.text(&label.words, label.at, label.anchor, label.size * em, ink);
    }
    canvas.composite_over(image);
    Ok(())
}
