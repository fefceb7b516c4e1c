//! Title and time stamp of an image.

use super::canvas::{Anchor, CAP_HEIGHT, Canvas};
use super::numbers;

/// Size of the title, as a multiple of the font size.
const LARGER: f32 = 1.35;

/// The time of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameTime {
    /// The time, in seconds.
    pub seconds: f64,
    /// Interval between frames, in seconds: determines the number of decimals. 0 if unknown.
    pub resolution: f64,
}

/// Draws a title and returns the y coordinate below it.
pub(super) fn draw_title(canvas: &mut Canvas, text: &str) -> f32 {
    let margin = canvas.margin();
    let room = canvas.size()[0] - 2.0 * margin;
    let em = LARGER * canvas.em;
    let em = em * (room / canvas.text_width(text, em)).clamp(0.5, 1.0);
    let text = canvas.shortened(text, em, room);
    let at = [0.5 * canvas.size()[0], margin + CAP_HEIGHT * em];
    let ink = canvas.foreground;
    canvas.text(&text, at, Anchor::Middle, em, ink);
    at[1] + margin
}

/// Draws the time, with its upper edge at `top`.
pub(super) fn draw_time(canvas: &mut Canvas, time: &FrameTime, top: f32) {
    let text = numbers::time(time.seconds, time.resolution);
    let at = [canvas.margin(), top + CAP_HEIGHT * canvas.em];
    let (em, ink) = (canvas.em, canvas.foreground);
    canvas.text(&text, at, Anchor::Start, em, ink);
}
