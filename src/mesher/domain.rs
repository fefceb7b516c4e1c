//! What the mesher fills: space divided into regions.

use glam::DVec3;

/// Space divided into regions 1, 2, … and the outside, 0.
///
/// Each region has a weight at every point, which changes continuously; a point belongs to the
/// region of the largest weight (the lowest region where several are equal).
pub trait Domain: Sync {
    /// A box beyond which everything is outside: (lower corner, upper corner).
    fn bounds(&self) -> (DVec3, DVec3);

    /// Empties `weights` and fills it with (region, weight) at `p`, in no particular order. A
    /// region that is not named has the weight 0.
    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>);
}
