//! The fingertip of a press, drawn as a finger with a nail. Its tip is the sphere that presses.

use super::raster::{Kind, Raster, Surfel};
use super::view::View;
use glam::DVec3;

/// Colours of skin and nail.
const SKIN: [f32; 3] = [0.93, 0.72, 0.60];
const CREASE: [f32; 3] = [0.80, 0.55, 0.45];
const NAIL: [f32; 3] = [0.98, 0.86, 0.82];
const NAIL_EDGE: [f32; 3] = [0.99, 0.96, 0.93];
/// Length of the finger beyond the centre of its tip, in radii.
const LENGTH: f64 = 9.0;
/// Rings along the finger, and points around it.
const RINGS: usize = 96;
const POINTS: usize = 72;
/// Where the nail starts and ends along the finger, in radii from the centre of the tip, and half of
/// its width as an angle.
const NAIL_SPAN: [f64; 2] = [-0.62, 1.25];
const NAIL_ANGLE: f64 = 0.92;
/// How far the nail stands out, in radii.
const NAIL_HEIGHT: f64 = 0.045;
/// Joints along the finger, in radii from the centre of the tip.
const JOINTS: [f64; 2] = [2.55, 6.3];

/// The pose of a finger.
#[derive(Clone, Copy, Debug)]
pub(super) struct Finger {
    /// Centre and radius of the sphere that presses.
    pub centre: DVec3,
    pub radius: f64,
    /// Direction from the tip to the hand, and towards the nail, unit vectors at right angles.
    pub along: DVec3,
    pub nail: DVec3,
}

impl Finger {
    /// Returns a finger that presses along `-outward` and is seen well from the direction `to_eye`,
    /// with the hand towards `aside`.
    pub fn pressing(
        centre: DVec3,
        radius: f64,
        outward: DVec3,
        (aside, to_eye): (DVec3, DVec3),
    ) -> Finger {
        let along = (0.80 * outward + 0.60 * aside).normalize();
        let back = outward - along * outward.dot(along);
        let eye = to_eye - along * to_eye.dot(along);
        let nail = (back.normalize_or_zero() + 0.75 * eye.normalize_or_zero())
            .normalize_or(along.any_orthonormal_vector());
        Finger {
            centre,
            radius,
            along,
            nail,
        }
    }

    /// Returns the surface point at distance `s` along the finger (in radii; negative in the
    /// tip) and `angle` about it from the nail.
    fn point(&self, s: f64, angle: f64) -> DVec3 {
        let side = self.along.cross(self.nail);
        let out = angle.cos() * self.nail + angle.sin() * side;
        let pad = -angle.cos();
        let raised = NAIL_HEIGHT * nail_mask(s, angle);
        let joint: f64 = JOINTS
            .iter()
            .map(|j| (-((s - j) / 0.55).powi(2)).exp())
            .sum();
        let width = match s < 0.0 {
            true => (1.0 - s * s).max(0.0).sqrt(),
            // The finger thickens behind its tip; the pad is fuller, and joints are wider.
            false => {
                1.0 + 0.10 * (s / 2.0).min(1.0)
                    + 0.05 * joint
                    + 0.05 * pad * (1.0 - (s - 0.9).abs()).max(0.0)
            }
        };
        self.centre + self.radius * (s * self.along + (width + raised) * out)
    }

    /// Returns the colour and kind at a place of the surface.
    fn look(s: f64, angle: f64) -> (Kind, [f32; 3]) {
        let nail = nail_mask(s, angle);
        if nail > 0.5 {
            let tip = s < NAIL_SPAN[0] + 0.22;
            return (Kind::Nail, if tip { NAIL_EDGE } else { NAIL });
        }
        let turned = angle.cos();
        let creases = JOINTS.iter().flat_map(|j| [j - 0.22, *j, j + 0.22]);
        let crease: f64 = creases.map(|at| (-((s - at) / 0.045).powi(2)).exp()).sum();
        let crease = (crease * (0.25 + 0.75 * turned.abs())).min(1.0) as f32;
        (
            Kind::Finger,
            [0, 1, 2].map(|k| SKIN[k] + 0.7 * crease * (CREASE[k] - SKIN[k])),
        )
    }

    /// Draws the finger.
    pub fn draw(&self, raster: &mut Raster, view: &View) {
        // Rings are denser over the tip.
        let at = |ring: usize| {
            let u = ring as f64 / RINGS as f64;
            match u < 0.4 {
                true => -(std::f64::consts::FRAC_PI_2 * (1.0 - u / 0.4)).sin(),
                false => LENGTH * (u - 0.4) / 0.6,
            }
        };
        let turn = |point: usize| std::f64::consts::TAU * (point as f64 / POINTS as f64 - 0.5);
        for (ring, point) in (0..RINGS).flat_map(|r| (0..POINTS).map(move |p| (r, p))) {
            let corners =
                [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(a, b)| [at(ring + a), turn(point + b)]);
            for [i, j, k] in [[0, 1, 2], [0, 2, 3]] {
                let of = [corners[i], corners[j], corners[k]];
                let x = of.map(|[s, angle]| self.point(s, angle));
                let normals = of.map(|c| self.normal(c));
                raster.triangle(view, x, |w| {
                    let mean =
                        |f: &dyn Fn(usize) -> f64| -> f64 { (0..3).map(|c| w[c] * f(c)).sum() };
                    let (kind, colour) = Finger::look(mean(&|c| of[c][0]), mean(&|c| of[c][1]));
                    let normal = (0..3).map(|c| w[c] * normals[c]).sum::<DVec3>();
                    Some(Surfel {
                        kind,
                        colour,
                        normal: normal.normalize_or(self.along),
                    })
                });
            }
        }
    }

    fn normal(&self, [s, angle]: [f64; 2]) -> DVec3 {
        let step = 0.02;
        let s = s.clamp(-0.999 + step, LENGTH);
        let ds = self.point(s + step, angle) - self.point(s - step, angle);
        let da = self.point(s, angle + step) - self.point(s, angle - step);
        let normal = da.cross(ds).normalize_or_zero();
        let out = self.point(s, angle) - (self.centre + self.radius * s.max(0.0) * self.along);
        if normal.dot(out) < 0.0 {
            -normal
        } else {
            normal
        }
    }
}

/// Returns 1 on the nail, 0 beside it, and values between at its edge.
fn nail_mask(s: f64, angle: f64) -> f64 {
    let [from, to] = NAIL_SPAN;
    let along = 2.0 * (s - from) / (to - from) - 1.0;
    let across = angle / NAIL_ANGLE;
    let inside = 1.0 - (along.abs().powi(4) + across.abs().powi(4));
    (4.0 * inside).clamp(0.0, 1.0)
}
