//! Implicit solids: approximate signed distances to the surface, negative inside.

use glam::{DVec2, DVec3};

/// Smooth union of two solids, the crease filled to a width of about `k`.
pub(super) fn smooth_union(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - 0.25 * h * h * k
}

/// Smooth step: 0 below `from`, 1 above `to`.
pub(super) fn smooth_step(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Returns the parameter in 0..1 of the closest point of a segment, and the distance to it.
fn nearest_on_segment(p: DVec3, a: DVec3, b: DVec3) -> (f64, f64) {
    let along = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    (along, p.distance(a.lerp(b, along)))
}

/// A rod with round ends whose radius varies linearly from one end to the other.
pub(super) fn rod(p: DVec3, [a, b]: [DVec3; 2], [ra, rb]: [f64; 2]) -> f64 {
    let (along, distance) = nearest_on_segment(p, a, b);
    distance - (ra + (rb - ra) * along)
}

/// Returns the joints of a chain of phalanges from `start` on: each one, of a length in metres, is
/// bent down from the one before by degrees; `spread` is their angle to the x axis.
pub(super) fn bent_chain<'a>(
    start: DVec3,
    spread: f64,
    phalanges: impl Iterator<Item = (f64, &'a f64)>,
) -> Vec<DVec3> {
    let mut joints = vec![start];
    let (mut at, mut pitch) = (start, 0.0f64);
    let yaw = spread.to_radians();
    let (sin, cos) = (yaw.sin(), yaw.cos());
    for (length, bend) in phalanges {
        pitch -= bend.to_radians();
        at += length * DVec3::new(cos * pitch.cos(), sin * pitch.cos(), pitch.sin());
        joints.push(at);
    }
    joints
}

/// An axis-aligned ellipsoid.
pub(super) fn ellipsoid(p: DVec3, centre: DVec3, radii: DVec3) -> f64 {
    let q = (p - centre) / radii;
    let steepness = (q / radii).length();
    if steepness == 0.0 {
        return -radii.min_element();
    }
    q.length() * (q.length() - 1.0) / steepness
}

/// An ellipse in the plane, about the origin.
pub(super) fn ellipse(p: DVec2, radii: DVec2) -> f64 {
    ellipsoid(
        p.extend(0.0),
        DVec3::ZERO,
        radii.extend(radii.min_element()),
    )
}

/// A long bone: a shaft with thicker ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct LongBone {
    /// The centres of its ends.
    pub ends: [DVec3; 2],
    /// Radius in the middle.
    pub shaft: f64,
    /// Radii at the ends.
    pub heads: [f64; 2],
}

impl LongBone {
    pub(super) fn distance(&self, p: DVec3) -> f64 {
        let [a, b] = self.ends;
        let (along, distance) = nearest_on_segment(p, a, b);
        // Each head spans about a quarter of the length.
        let first = smooth_step(0.30, 0.04, along);
        let last = smooth_step(0.70, 0.96, along);
        let radius =
            self.shaft + (self.heads[0] - self.shaft) * first + (self.heads[1] - self.shaft) * last;
        distance - radius
    }
}
