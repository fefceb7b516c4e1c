//! Selection of the cheapest raycast settings for a given image error.
//!
//! The rule is derived from `palpate study pictures`, which compares five bodies, each with a
//! smooth and a narrow-peaked transfer function, with the exact ray integral. Two settings
//! determine the cost of a frame at a given error:
//!
//! - early ray termination. Rays that end at opacity 1 − q omit at most q; the root mean square
//!   over an image was at most 0.25 q.
//! - the table size, which is chosen so that an error bound stays within
//!   [`RaycastOptions::table_tolerance`]. The measured root mean square was at most 0.85 of that
//!   bound.
//!
//! Scans attached to the mesh have a separate setting: the sampling distance.
//!
//! Without pre-integration, a narrow-peaked transfer function needs 32 samples per tet for an error
//! of half a grey level, and each sample costs about as much as a table lookup. The volume table of
//! the paper takes two lookups per tet and is less accurate for narrow peaks. Byte texels have an
//! error larger by a tenth of a grey level than half floats, 32-bit floats one smaller by a
//! thirtieth. A lower resolution causes an edge error beyond any tolerance allowed here.

use super::{Light, RaycastOptions, Xray};
use crate::{Error, Result};

/// Tolerance of the default options: half a grey level of an 8-bit channel.
const DEFAULT_TOLERANCE: f64 = 0.5 / 255.0;
/// Shares of the tolerance for the bound of the table error and for the remaining transparency at
/// ray termination. By the measurements above, the sum stays within 0.7 of the tolerance; the rest
/// is a margin for images that differ from those of the study.
const TABLE_ERROR_SHARE: f64 = 0.5;
const CUTOFF_ERROR_SHARE: f64 = 1.0;
/// Share of the tolerance for the sampling error of scans, which grows with the square of the
/// distance in voxels: the tolerance in grey levels, times this, equals the squared distance. A
/// scan with edges as sharp as voxels allow, with a dense transfer function, had an error of 0.95
/// grey levels at a distance of one voxel.
const SAMPLING_ERROR_SHARE: f64 = 0.6;
/// Upper limit of the tolerance.
const MAX_TOLERANCE: f64 = 0.25;

impl RaycastOptions {
    /// Returns the cheapest options that keep the root mean square error of pixel values (0 to 1)
    /// within `tolerance`; 0.5/255 gives [`RaycastOptions::default`]. Tables have at most 512
    /// texels per axis, so that narrow peaks of a transfer function may limit the accuracy to about
    /// 0.2/255.
    ///
    /// # Errors
    /// [`Error::Input`] for a tolerance outside 0 (exclusive) to 64/255.
    pub fn for_tolerance(tolerance: f64) -> Result<RaycastOptions> {
        if !(tolerance > 0.0 && tolerance <= MAX_TOLERANCE) {
            return Err(Error::Input(format!(
                "image error tolerance must be > 0 and ≤ {limit:.0} (in 1/255), got {}",
                255.0 * tolerance,
                limit = (255.0 * MAX_TOLERANCE).round()
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
