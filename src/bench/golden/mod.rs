//! Golden comparisons: pictures with stored ones and with exact ray integrals, motions with
//! float64, within the bounds of the tests.

mod motions;
mod pictures;

pub use pictures::{GOLDEN_PICTURES, golden_picture};

use super::Case;

pub(super) const ABOUT: &str = "Pictures of this adapter next to stored ones and to the exact ray \
    integral in float64, motions next to the same in float64. A row outside its bound, which is \
    that of the tests, means that the other tables measure something else than they should: report \
    it with this page.";

/// Unit of differences of pictures: steps of an 8-bit channel.
const LEVELS: &str = "RMSE, 1/255";

pub(super) fn cases(_quick: bool) -> Vec<Case> {
    let mut all = pictures::cases();
    all.extend(motions::cases());
    all
}
