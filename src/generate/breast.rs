//! Phantom of a breast on the chest muscle.

use super::lump::{Lump, Organ, organ, surface_above};
use super::shapes::{ellipsoid, rod, smooth_union};
use crate::mesh::TetMesh;
use crate::{Result, no_progress};
use glam::DVec3;

/// Radius of its base and its height, m, and the exponent of its profile.
const BASE: f64 = 0.07;
const HEIGHT: f64 = 0.052;
const POWER: i32 = 3;
/// Thickness of the muscle beneath it, m.
const MUSCLE: f64 = 0.008;
/// Position of the lump: the upper outer quadrant, the most frequent site.
const LUMP: [f64; 2] = [0.022, 0.022];

/// Returns a breast of about `tets` tets, 14 cm wide and 5 cm high, in metres: its base lies at z =
/// 0 and it rises along z. The cell field `label` has fat, gland, the chest muscle and, if `lump`
/// is given, a lump below its upper outer quadrant; `stiffness` is the lump's contrast there and 1
/// elsewhere, for
/// [`Material::stiffness_scale_field`](crate::physics::Material::stiffness_scale_field). It has no
/// skin: its thickness of 1.5 mm is below the element size. Deterministic.
///
/// # Errors
/// An [`Error::Input`](crate::Error::Input) for fewer than 1,000 tets or more than 20 million, and
/// for an invalid lump or one that does not fit.
pub fn breast(tets: usize, lump: Option<Lump>) -> Result<TetMesh> {
    organ(Breast, tets, lump, &no_progress)
}

/// The shape of [`breast`].
pub(super) struct Breast;

impl Breast {
    /// Approximate signed distance to the surface, negative inside.
    fn outside(p: DVec3) -> f64 {
        let around = p.truncate().length();
        let [a, b] = [around / BASE, p.z.abs() / HEIGHT];
        let q = (a.powi(POWER) + b.powi(POWER)).cbrt();
        let slope =
            q.powi(1 - POWER) * f64::hypot(a.powi(POWER - 1) / BASE, b.powi(POWER - 1) / HEIGHT);
        let dome = match q > 0.0 {
            true => (q - 1.0) / slope,
            false => -HEIGHT,
        };
        let nipple = ellipsoid(
            p,
            DVec3::new(0.0, 0.0, HEIGHT),
            DVec3::new(6e-3, 6e-3, 4e-3),
        );
        smooth_union(dome, nipple, 6e-3).max(-p.z)
    }
}

impl Organ for Breast {
    const NAME: &'static str = "breast";
    const TISSUES: &'static [&'static str] = &["fat", "gland", "muscle"];

    fn bounds(&self) -> (DVec3, DVec3) {
        let around = BASE + 1e-3;
        (
            DVec3::new(-around, -around, 0.0),
            DVec3::new(around, around, HEIGHT + 6e-3),
        )
    }

    fn inside(&self, tissue: usize, p: DVec3) -> f64 {
        match tissue {
            0 => -Breast::outside(p),
            1 => {
                let body = ellipsoid(p, DVec3::new(0.0, 0.0, 0.024), DVec3::new(0.05, 0.05, 0.02));
                let ducts = [DVec3::new(0.0, 0.0, 0.03), DVec3::new(0.0, 0.0, HEIGHT)];
                -smooth_union(body, rod(p, ducts, [9e-3, 4e-3]), 0.012)
            }
            _ => MUSCLE - p.z,
        }
    }

    fn above_lump(&self) -> (DVec3, DVec3) {
        surface_above(|p| -Breast::outside(p), LUMP, [MUSCLE, 2.0 * HEIGHT])
    }
}
