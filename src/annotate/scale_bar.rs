//! Scale bar with a round length.

use super::canvas::{Anchor, Canvas};
use super::numbers::{label, round_below};
use crate::render::{Camera, Projection};

/// Maximum length of the bar as a fraction of the image width.
const MAX_LENGTH_RATIO: f64 = 0.25;
/// Thickness, as a multiple of the font size.
const THICKNESS: f32 = 0.22;
/// Units, the largest first: name, minimum length in metres, metres per unit.
const UNITS: [(&str, f64, f64); 5] = [
    ("m", 1.0, 1.0),
    ("cm", 0.1, 1e-2),
    ("mm", 1e-3, 1e-3),
    ("µm", 1e-6, 1e-6),
    ("nm", 0.0, 1e-9),
];

/// A scale bar with a round length: 1, 2 or 5 times a power of ten of nm, µm, mm, cm or m, or of
/// mesh units.
///
/// Exact for an orthographic camera; for a perspective one it is the length at the distance of the
/// look-at point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScaleBar {
    /// Metres per mesh unit, if known.
    pub length_unit: Option<f64>,
}

impl ScaleBar {
    /// Returns the length of the bar in pixels and its label, for an image of `size` pixels of
    /// `camera`.
    pub fn measure(&self, camera: &Camera, size: [u32; 2]) -> (f64, String) {
        let half = camera.axes().half_height;
        let height = match camera.projection {
            Projection::Perspective { .. } => 2.0 * half * camera.eye.distance(camera.look_at),
            Projection::Orthographic { .. } => 2.0 * half,
        };
        let unit = self.length_unit.unwrap_or(1.0);
        let metre = f64::from(size[1].max(1)) / (height * unit);
        let max_length = MAX_LENGTH_RATIO * f64::from(size[0].max(1)) / metre;
        let length = round_below(max_length);
        let words = match self.length_unit {
            Some(_) => {
                let fits = |(_, from, _): &&(&str, f64, f64)| length >= from * (1.0 - 1e-9);
                let (name, _, metres) = UNITS.iter().find(fits).unwrap_or(&UNITS[4]);
                let number = length / metres;
                format!("{} {name}", label(number, round_below(number)))
            }
            None if length == 1.0 => "1 unit".to_owned(),
            None => format!("{} units", label(length, length)),
        };
        (length * metre, words)
    }

    pub(super) fn draw(&self, canvas: &mut Canvas, camera: &Camera) {
        let [width, height] = canvas.size();
        let (length, words) = self.measure(camera, [width as u32, height as u32]);
        let (em, ink, margin) = (canvas.em, canvas.foreground, canvas.margin());
        let thickness = (THICKNESS * em).round().max(2.0);
        let right = (width - margin).floor();
        let top = (height - margin - thickness).floor();
        let length = length as f32;
        canvas.bar([right - length, top, length, thickness]);
        // A label wider than the bar is right-aligned with it.
        let half = 0.5 * canvas.text_width(&words, em);
        let middle = (right - 0.5 * length).min(right - half);
        let at = [middle, top - 0.4 * em];
        canvas.text(&words, at, Anchor::Middle, em, ink);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn scale_bar_lengths_are_round_with_matching_unit() {
        let eye = DVec3::new(0.0, 0.0, 10.0);
        // A quarter of 800 pixels is 0.25 · 800/600 of the height.
        for (unit, height, expected) in [
            (Some(1e-3), 120.0, "20 mm"),
            (Some(1e-3), 700.0, "20 cm"),
            (Some(1.0), 12.0, "2 m"),
            (Some(1.0), 0.05, "10 mm"),
            (Some(1e-6), 90.0, "20 µm"),
            (Some(1e-9), 30.0, "10 nm"),
            (None, 4.0, "1 unit"),
            (None, 0.7, "0.2 units"),
            (None, 7e5, "200000 units"),
        ] {
            let camera = Camera::orthographic(eye, DVec3::ZERO, DVec3::Y, height);
            let (_, words) = ScaleBar { length_unit: unit }.measure(&camera, [800, 600]);
            assert_eq!(words, expected, "{unit:?} {height}");
        }
    }

    #[test]
    fn perspective_scale_bar_uses_look_at_distance() {
        let eye = DVec3::new(0.0, 0.0, 10.0);
        let bar = ScaleBar {
            length_unit: Some(1.0),
        };
        let perspective = Camera::perspective(eye, DVec3::ZERO, DVec3::Y, 30.0);
        let height = 20.0 * 15f64.to_radians().tan();
        let orthographic = Camera::orthographic(eye, DVec3::ZERO, DVec3::Y, height);
        let [a, b] = [perspective, orthographic].map(|c| bar.measure(&c, [800, 600]));
        assert_eq!(a.1, b.1);
        assert!((a.0 - b.0).abs() < 1e-9);
        assert_eq!(a.1, "1 m");
        assert!((a.0 - 600.0 / height).abs() < 1e-9);
    }
}
