//! Paths of attachments and cutters: places at times, linear between them.

use crate::{Error, Result};
use glam::DVec3;

/// Refuses a path of fewer than `least` places, or whose times do not increase.
pub(super) fn check(path: &[[f64; 4]], least: usize, what: &str) -> Result<()> {
    let ordered = path.windows(2).all(|w| w[0][0] < w[1][0]);
    let finite = path.iter().flatten().all(|x| x.is_finite());
    if path.len() < least || !ordered || !finite {
        return Err(Error::Input(format!(
            "the path of a {what} should be a list of at least {least} [time, x, y, z], the times increasing"
        )));
    }
    Ok(())
}

/// Where a path is at `time`.
pub(super) fn along(path: &[[f64; 4]], time: f64) -> DVec3 {
    let place = |p: &[f64; 4]| DVec3::new(p[1], p[2], p[3]);
    let after = path.partition_point(|p| p[0] <= time);
    match (
        after.checked_sub(1).and_then(|n| path.get(n)),
        path.get(after),
    ) {
        (Some(a), Some(b)) => place(a).lerp(place(b), (time - a[0]) / (b[0] - a[0])),
        (Some(only), None) | (None, Some(only)) => place(only),
        (None, None) => DVec3::ZERO,
    }
}
