//! Phantom of a liver.

use super::lump::{Lump, Organ, organ, surface_above};
use super::shapes::{ellipsoid, smooth_union};
use crate::mesh::TetMesh;
use crate::{Result, no_progress};
use glam::DVec3;

/// Height of its flat back, m.
const BACK: f64 = -0.028;
/// Position of the lump: in the right lobe.
const LUMP: [f64; 2] = [-0.03, 0.0];

/// Returns a liver of about `tets` tets, 22 cm wide, in metres: it lies on its flat back, its front
/// faces z, and its right lobe, the larger, is at negative x. The cell field `label` has liver and,
/// if `lump` is given, a lump below the front of the right lobe; `stiffness` is as in
/// [`breast`](super::breast). Deterministic.
///
/// # Errors
/// As [`breast`](super::breast).
pub fn liver(tets: usize, lump: Option<Lump>) -> Result<TetMesh> {
    organ(Liver, tets, lump, &no_progress)
}

/// The shape of [`liver`].
pub(super) struct Liver;

impl Liver {
    /// Approximate signed distance to the surface, negative inside.
    fn outside(p: DVec3) -> f64 {
        let right = ellipsoid(
            p,
            DVec3::new(-0.035, 0.0, 0.0),
            DVec3::new(0.075, 0.062, 0.045),
        );
        let left = ellipsoid(
            p,
            DVec3::new(0.05, 0.014, -0.012),
            DVec3::new(0.065, 0.04, 0.028),
        );
        smooth_union(right, left, 0.03).max(BACK - p.z)
    }
}

impl Organ for Liver {
    const NAME: &'static str = "liver";
    const TISSUES: &'static [&'static str] = &["liver"];

    fn bounds(&self) -> (DVec3, DVec3) {
        (
            DVec3::new(-0.112, -0.064, BACK),
            DVec3::new(0.117, 0.064, 0.048),
        )
    }

    fn inside(&self, _: usize, p: DVec3) -> f64 {
        -Liver::outside(p)
    }

    fn above_lump(&self) -> (DVec3, DVec3) {
        surface_above(|p| -Liver::outside(p), LUMP, [0.0, 0.1])
    }
}
