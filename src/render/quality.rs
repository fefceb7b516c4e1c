//! From the error that a picture may have to the cheapest settings that keep to it.
//!
//! The rule is drawn from `palpate study pictures`, which holds five bodies, each through a smooth
//! and a spiky transfer function, against the exact ray integral. Of the settings there, two
//! decide what a frame costs at a given error:
//!
//! - where a ray ends. Rays that end at opacity 1 − q leave out q at most; over a whole picture
//!   the root mean square of it was found to be up to 0.25 q.
//! - the table's size, which is chosen so that a bound on its error stays within
//!   [`RaycastOptions::table_tolerance`]. The root mean square found was up to 0.85 of that bound.
//!
//! A scan that the mesh carries has a setting of its own: how far apart it is sampled.
//!
//! Sampling each tet in place of a pre-integrated table needs 32 samples to keep to half a level
//! through a spiky transfer function, and each of them costs about as much as a look-up. The
//! paper's volume takes two look-ups a tet, and misses more where the function is spiky. Bytes
//! miss a tenth of a level more than half floats, and floats a thirtieth less. Fewer pixels cost
//! error at every edge that no tolerance here would allow.

use super::{Light, RaycastOptions, Xray};
use crate::{Error, Result};

/// The tolerance of the default options: half a level of an 8-bit channel.
const DEFAULT_TOLERANCE: f64 = 0.5 / 255.0;
/// The share of the tolerance that the bound of the table's error may take, and the opacity that
/// is left where rays end. By what was found above, both together stay within 0.7 of the
/// tolerance: the rest is for pictures unlike those of the study.
const TABLE_ERROR_SHARE: f64 = 0.5;
const CUTOFF_ERROR_SHARE: f64 = 1.0;
/// What a scan that is sampled so many voxels apart misses grows as the square of that: so many levels
/// of tolerance, times this, are one. A scan with edges as sharp as voxels can hold, through a dense
/// transfer function, was found to miss 0.95 of a level a voxel apart.
const SAMPLING_ERROR_SHARE: f64 = 0.6;
/// Pictures of a larger error are nobody's wish.
const MAX_TOLERANCE: f64 = 0.25;

impl RaycastOptions {
    /// The cheapest options that keep the root mean square error of a picture's values, which lie
    /// from 0 to 1, within `tolerance`: 0.5/255 are those of [`RaycastOptions::default`]. Tables
    /// end at 512 texels a side, so that thin spikes of a transfer function may not allow much
    /// less than 0.2/255.
    ///
    /// # Errors
    /// [`Error::Input`] for a tolerance that is not above 0 and up to 64/255.
    pub fn for_tolerance(tolerance: f64) -> Result<RaycastOptions> {
        if !(tolerance > 0.0 && tolerance <= MAX_TOLERANCE) {
            return Err(Error::Input(format!(
                "a picture cannot be drawn to an error of {} (in 1/255): choose above 0, and up to {:.0}",
                255.0 * tolerance,
                (255.0 * MAX_TOLERANCE).round()
            )));
        }
        Ok(RaycastOptions::keeping(tolerance))
    }

    fn keeping(tolerance: f64) -> RaycastOptions {
        RaycastOptions {
            walk: Default::default(),
            reads: Default::default(),
            table: Default::default(),
            texel: Default::default(),
            table_size: None,
            opacity_cutoff: 1.0 - CUTOFF_ERROR_SHARE * tolerance,
            layers: 32,
            table_tolerance: TABLE_ERROR_SHARE * tolerance,
            light: Light::None,
            shadows: 0.0,
            scan_step: (SAMPLING_ERROR_SHARE * 255.0 * tolerance)
                .sqrt()
                .clamp(1.0 / 64.0, 1.0),
            xray: Xray::default(),
        }
    }
}

impl Default for RaycastOptions {
    fn default() -> RaycastOptions {
        RaycastOptions::keeping(DEFAULT_TOLERANCE)
    }
}
