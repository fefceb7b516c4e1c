//! Axis indicators: arrows or anatomical letters.

use super::Margins;
use super::canvas::{Anchor, CAP_HEIGHT, Canvas, Colour};
use crate::render::Camera;
use glam::DVec3;

/// Length of an axis parallel to the image plane, as a multiple of the font size.
const LENGTH: f64 = 2.4;
/// Additional distance of its letter, in the same unit.
const LABEL_OFFSET: f64 = 0.75;
/// Okabe and Ito's vermilion, bluish green and sky blue, which are distinguishable with colour
/// blindness.
const COLOURS: [Colour; 3] = [
    [0.835, 0.369, 0.0],
    [0.0, 0.62, 0.451],
    [0.337, 0.706, 0.914],
];
/// Size of letters at the image edges, as a multiple of the font size.
const LARGER: f32 = 1.25;
/// Direction components below this get no letter.
const MIN_COMPONENT: f64 = 0.35;

/// Style of the axis indicator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// Arrows labelled x, y and z at the lower left.
    #[default]
    Xyz,
    /// Letters at the edges of the image: R L A P S I, for right, left, anterior, posterior,
    /// superior and inferior, for a body in patient coordinates. These are RAS, as in
    /// [`volume`](crate::volume) and in meshes generated from scans: x points to the patient's
    /// right, y to the front, z upwards. An oblique view has two or three letters, the dominant
    /// direction first.
    Anatomical,
}

impl Axes {
    pub(super) fn draw(self, canvas: &mut Canvas, camera: &Camera, margins: &Margins) {
        match self {
            Axes::Xyz => arrows(canvas, camera),
            Axes::Anatomical => letters(canvas, camera, margins),
        }
    }
}

fn arrows(canvas: &mut Canvas, camera: &Camera) {
    let view = camera.axes();
    let em = f64::from(canvas.em);
    let reach = (LENGTH + LABEL_OFFSET + 0.5) * em;
    let height = f64::from(canvas.size()[1]);
    let origin = [reach, height - reach];
    let mut axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|a| {
        let [x, y, z] = [view.right, view.up, view.forward].map(|v| v.dot(a));
        (z, [x, -y])
    });
    let mut order = [0, 1, 2];
    // Draws axes that point away from the eye first.
    order.sort_by(|a, b| axes[*b].0.total_cmp(&axes[*a].0));
    for i in order {
        let direction = &mut axes[i].1;
        let at = |far: f64| [0, 1].map(|k| (origin[k] + far * em * direction[k]) as f32);
        canvas.line(at(0.0), at(LENGTH), 0.16 * canvas.em, COLOURS[i]);
    }
    for i in order {
        let direction = axes[i].1;
        // The letter of an axis along the view is placed next to the origin, not on it.
        let long = direction[0].hypot(direction[1]);
        let out = LENGTH * long + LABEL_OFFSET;
        let way = match long > 0.05 {
            true => direction.map(|d| d / long),
            false => [-0.7, 0.7],
        };
        let [x, y] = [0, 1].map(|k| (origin[k] + out * em * way[k]) as f32);
        // Lower-case letters: half their height is a quarter of an em.
        let at = [x, y + 0.25 * canvas.em];
        canvas.text(
            ["x", "y", "z"][i],
            at,
            Anchor::Middle,
            canvas.em,
            COLOURS[i],
        );
    }
}

/// Returns the letters of `direction` in RAS, the dominant one first.
fn anatomical(direction: DVec3) -> String {
    let names = [['L', 'R'], ['P', 'A'], ['I', 'S']];
    let mut parts: Vec<(f64, char)> = direction
        .to_array()
        .iter()
        .zip(names)
        .map(|(part, [less, more])| (part.abs(), if *part < 0.0 { less } else { more }))
        .filter(|(part, _)| *part > MIN_COMPONENT)
        .collect();
    parts.sort_by(|a, b| b.0.total_cmp(&a.0));
    parts.into_iter().map(|(_, letter)| letter).collect()
}

fn letters(canvas: &mut Canvas, camera: &Camera, margins: &Margins) {
    let view = camera.axes();
    let [width, height] = canvas.size();
    let (em, ink, margin) = (LARGER * canvas.em, canvas.foreground, canvas.margin());
    let middle = 0.5 * (height + CAP_HEIGHT * em);
    let right = width - margins.right;
    let edges = [
        (
            view.up,
            [0.5 * width, margins.top + CAP_HEIGHT * em],
            Anchor::Middle,
        ),
        (-view.up, [0.5 * width, height - margin], Anchor::Middle),
        (-view.right, [margin, middle], Anchor::Start),
        (view.right, [right, middle], Anchor::End),
    ];
    for (direction, at, anchor) in edges {
        canvas.text(&anatomical(direction), at, anchor, em, ink);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn anatomical_letters_match_ras() {
        for (direction, expected) in [
            (DVec3::X, "R"),
            (DVec3::NEG_X, "L"),
            (DVec3::Y, "A"),
            (DVec3::NEG_Y, "P"),
            (DVec3::Z, "S"),
            (DVec3::NEG_Z, "I"),
            (DVec3::new(-0.6, 0.8, 0.0), "AL"),
            (DVec3::new(0.2, -0.1, 0.97), "S"),
        ] {
            assert_eq!(anatomical(direction), expected);
        }
        // From the front, the patient's right is at the left of the image.
        let camera = Camera::orthographic(DVec3::Y * 5.0, DVec3::ZERO, DVec3::Z, 2.0);
        assert_eq!(anatomical(camera.axes().right), "L");
        assert_eq!(anatomical(camera.axes().up), "S");
    }
}
