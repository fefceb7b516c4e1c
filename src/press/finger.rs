//! The shape and colours of a finger with a nail, as which the fingertip of a press is drawn. Its tip is the
//! sphere that presses.

use crate::mesh::TriMesh;
use crate::scene::ToolSurface;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Colours of skin and nail.
const SKIN: [f32; 3] = [0.93, 0.72, 0.60];
const CREASE: [f32; 3] = [0.80, 0.55, 0.45];
const NAIL: [f32; 3] = [0.98, 0.86, 0.82];
const NAIL_EDGE: [f32; 3] = [0.99, 0.96, 0.93];
/// Length of the finger beyond the centre of its tip, in radii.
const LENGTH: f64 = 9.0;
/// Length of its rounded end, in radii.
const END: f64 = 0.9;
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
    pub fn point(&self, [s, angle]: [f64; 2]) -> DVec3 {
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
        let behind = ((s - LENGTH) / END + 1.0).clamp(0.0, 1.0);
        let width = width * (1.0 - behind * behind).sqrt();
        self.centre + self.radius * (s * self.along + (width + raised) * out)
    }

    /// Returns whether a place of the surface is on the nail, and its colour.
    pub fn look([s, angle]: [f64; 2]) -> (bool, [f32; 3]) {
        let nail = nail_mask(s, angle);
        if nail > 0.5 {
            let tip = s < NAIL_SPAN[0] + 0.22;
            return (true, if tip { NAIL_EDGE } else { NAIL });
        }
        let turned = angle.cos();
        let creases = JOINTS.iter().flat_map(|j| [j - 0.22, *j, j + 0.22]);
        let crease: f64 = creases.map(|at| (-((s - at) / 0.045).powi(2)).exp()).sum();
        let crease = (crease * (0.25 + 0.75 * turned.abs())).min(1.0) as f32;
        (
            false,
            [0, 1, 2].map(|k| SKIN[k] + 0.7 * crease * (CREASE[k] - SKIN[k])),
        )
    }

    /// Returns the corners of the quadrilaterals of the surface, as places on it (`[s, angle]`).
    pub fn quads() -> impl Iterator<Item = [[f64; 2]; 4]> {
        let quads = (0..RINGS).flat_map(|ring| (0..POINTS).map(move |point| (ring, point)));
        quads.map(|(ring, point)| {
            [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(a, b)| place(ring + a, point + b))
        })
    }

    /// Returns a finger of `radius` as the surface of a tool that presses along −z and is seen well from −y,
    /// with the hand towards +x.
    pub fn tool_surface(radius: f64) -> ToolSurface {
        let finger = Finger::pressing(DVec3::ZERO, radius, DVec3::Z, (DVec3::X, DVec3::NEG_Y));
        // The first and the last ring are points.
        let sides = (1..RINGS).flat_map(|ring| (0..POINTS).map(move |point| place(ring, point)));
        let ends = [place(0, 0), place(RINGS, 0)];
        let places: Vec<[f64; 2]> = sides.chain(ends).collect();
        let at = |ring: usize, point: usize| match ring {
            0 => places.len() as u32 - 2,
            RINGS => places.len() as u32 - 1,
            _ => ((ring - 1) * POINTS + point % POINTS) as u32,
        };
        let quads = (0..RINGS).flat_map(|ring| (0..POINTS).map(move |point| (ring, point)));
        let triangles = quads.flat_map(|(ring, point)| {
            let [a, b, c, d] =
                [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| at(ring + i, point + j));
            let first = (ring > 0).then_some([a, d, c]);
            let second = (ring + 1 < RINGS).then_some([a, c, b]);
            first.into_iter().chain(second)
        });
        ToolSurface {
            mesh: TriMesh {
                vertices: places.iter().map(|p| finger.point(*p)).collect(),
                triangles: triangles.collect(),
                ..TriMesh::default()
            },
            colours: places.iter().map(|p| Finger::look(*p).1).collect(),
        }
    }

    /// Returns the outward unit normal at such a place.
    pub fn normal(&self, [s, angle]: [f64; 2]) -> DVec3 {
        let step = 0.02;
        let s = s.clamp(-0.999 + step, LENGTH - 2.0 * step);
        let ds = self.point([s + step, angle]) - self.point([s - step, angle]);
        let da = self.point([s, angle + step]) - self.point([s, angle - step]);
        let normal = da.cross(ds).normalize_or_zero();
        let out = self.point([s, angle]) - (self.centre + self.radius * s.max(0.0) * self.along);
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

/// Returns the place on the surface of a point of a ring; rings are denser over the tip.
fn place(ring: usize, point: usize) -> [f64; 2] {
    let u = ring as f64 / RINGS as f64;
    let s = match u < 0.4 {
        true => -(FRAC_PI_2 * (1.0 - u / 0.4)).sin(),
        false => LENGTH * (u - 0.4) / 0.6,
    };
    [s, TAU * (point as f64 / POINTS as f64 - 0.5)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surface_of_tool_is_closed_and_holds_the_sphere() {
        let radius = 0.7;
        let ToolSurface { mesh, colours } = Finger::tool_surface(radius);
        assert_eq!(colours.len(), mesh.vertices.len());
        // Each edge is used once in each direction.
        let mut directed = std::collections::BTreeMap::new();
        for [a, b, c] in &mesh.triangles {
            for edge in [[a, b], [b, c], [c, a]] {
                *directed.entry(edge).or_insert(0) += 1;
            }
        }
        for ([a, b], count) in &directed {
            assert_eq!((*count, directed.get(&[*b, *a])), (1, Some(&1)), "{a} {b}");
        }
        let signed = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
            a.dot(b.cross(c)) / 6.0
        };
        let volume: f64 = mesh.triangles.iter().map(signed).sum();
        let tube = TAU / 2.0 * radius.powi(3) * LENGTH;
        assert!(volume > tube && volume < 1.5 * tube, "{volume} {tube}");
        let nearest = mesh.vertices.iter().map(|p| p.length());
        let nearest = nearest.fold(f64::INFINITY, f64::min);
        assert!((nearest / radius - 1.0).abs() < 1e-9, "{nearest}");
    }
}
