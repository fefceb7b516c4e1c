//! What is written on the picture of a press: its depth, the values of isolines, and a key of lines.

use super::drawing::{Layout, REST_INK};
use super::overlay::Pen;
use super::rounded;
use crate::Result;
use crate::annotate::{Anchor, Label, draw_labels, font_size};
use crate::render::{Background, Image};

/// Colour of the mark of the depth.
const DEPTH_INK: [f32; 3] = [0.78, 0.10, 0.08];
/// Size of the values of isolines relative to other text, and their least distance, in heights of
/// the picture over 768.
const VALUE_SIZE: f32 = 0.75;
const VALUE_APART: f64 = 24.0;
/// The line of the key, above the scale bar: its start from the lower right corner, and its length,
/// in the same unit for text of the size in that picture.
const KEY: [f64; 2] = [180.0, 76.0];
const KEY_LENGTH: f64 = 80.0;

pub(super) struct Marks<'a> {
    pub layout: &'a Layout,
    pub depth_m: Option<f64>,
    /// Distance of two isolines, in the displayed unit.
    pub spacing: Option<f64>,
}

impl Marks<'_> {
    /// Draws the marks over `image`.
    pub fn draw(&self, image: &mut Image, background: Background) -> Result<()> {
        let mut labels = Vec::new();
        if let Some(depth) = self.depth_m {
            labels.extend(self.depth(image, depth));
        }
        if let Some(spacing) = self.spacing {
            labels.extend(self.values(image.size, spacing));
        }
        labels.push(key(image, background));
        draw_labels(image, background, &labels)
    }

    /// Draws the depth as a bar between the surface at rest and the lowest point of the fingertip,
    /// with lines that lead there.
    fn depth(&self, image: &mut Image, depth: f64) -> Option<Label> {
        let [rest, lowest] = self.layout.depth_mark;
        let scale = f64::from(image.size[1]) / 768.0;
        let long = f64::hypot(lowest[0] - rest[0], lowest[1] - rest[1]);
        if long < 2.0 * scale {
            return None;
        }
        let mut pen = Pen {
            size: image.size,
            pixels: &mut image.values,
            colour: DEPTH_INK,
            opacity: 0.7,
            width: (1.4 * scale) as f32,
        };
        let [surface, tip] = self.layout.tip;
        pen.line(rest, surface);
        pen.line(lowest, tip);
        (pen.opacity, pen.width) = (1.0, (2.6 * scale) as f32);
        pen.line(rest, lowest);
        let along = [(lowest[0] - rest[0]) / long, (lowest[1] - rest[1]) / long];
        let across = [-along[1], along[0]];
        for end in [rest, lowest] {
            let tick = |side: f64| [0, 1].map(|k| end[k] + side * 8.0 * scale * across[k]);
            pen.line(tick(-1.0), tick(1.0));
        }
        let at = [
            rest[0].min(lowest[0]) - 14.0 * scale,
            0.5 * (rest[1] + lowest[1]) + 7.0 * scale,
        ];
        Some(Label {
            words: format!("{} mm", rounded(1e3 * depth)),
            at: at.map(|x| x as f32),
            anchor: Anchor::End,
            size: 1.0,
        })
    }

    /// Returns the values of the isolines below the fingertip that have room for one.
    fn values(&self, size: [u32; 2], spacing: f64) -> Vec<Label> {
        let scale = f64::from(size[1]) / 768.0;
        let mut labels: Vec<Label> = Vec::new();
        let mut last = self.layout.tip[1];
        for (number, at) in &self.layout.crossings {
            if f64::hypot(at[0] - last[0], at[1] - last[1]) < VALUE_APART * scale {
                continue;
            }
            last = *at;
            labels.push(Label {
                words: rounded(f64::from(*number) * spacing),
                at: [at[0] + 4.0 * scale, at[1] - 3.0 * scale].map(|x| x as f32),
                anchor: Anchor::Start,
                size: VALUE_SIZE,
            });
        }
        labels
    }
}

/// Draws a dashed line at the lower right, and returns what it means.
fn key(image: &mut Image, background: Background) -> Label {
    // Text has a smallest size, so that the key of a small picture is larger.
    let scale = f64::from(font_size(image.size) / font_size([1024, 768]));
    let from = [0, 1].map(|k| f64::from(image.size[k]) - KEY[k] * scale);
    let to = [from[0] + KEY_LENGTH * scale, from[1]];
    // On a dark background the ink of the outline, which lies on the body, would not be seen.
    let colour = match background.is_light() {
        true => REST_INK,
        false => [0.62, 0.70, 0.92],
    };
    let mut pen = Pen {
        size: image.size,
        pixels: &mut image.values,
        colour,
        opacity: 0.9,
        width: (2.2 * scale) as f32,
    };
    pen.dashed(&[[from, to]], 9.0 * scale);
    Label {
        words: "at rest".into(),
        at: [to[0] + 10.0 * scale, to[1] + 7.0 * scale].map(|x| x as f32),
        anchor: Anchor::Start,
        size: 1.0,
    }
}
