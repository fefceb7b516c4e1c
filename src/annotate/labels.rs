//! Words at places of an image.

use super::canvas::{Anchor, Canvas};
use crate::Result;
use crate::render::{Background, Image};

/// Draws words that end at a place of `image`, in pixels on their baseline, for display on
/// `background`.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) for an image too large to be annotated.
pub(crate) fn draw_labels(
    image: &mut Image,
    background: Background,
    labels: &[(String, [f32; 2])],
) -> Result<()> {
    let mut canvas = Canvas::new(image.size, background)?;
    let (em, ink) = (canvas.em, canvas.foreground);
    for (words, at) in labels {
        canvas.text(words, *at, Anchor::End, em, ink);
    }
    canvas.composite_over(image);
    Ok(())
}
