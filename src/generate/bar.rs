//! Generators of bars: the paper's, and bars of any size.

use super::{Split, box_mesh};
use crate::mesh::TetMesh;
use crate::{Error, Result};
use glam::DVec3;

/// Cells of the paper's bar along x, y and z.
pub(crate) const PAPER_BAR_CELLS: [usize; 3] = [4, 2, 2];

/// Size of the paper's bar in metres: cells of 30 mm.
pub(crate) const PAPER_BAR_SIZE: DVec3 = DVec3::new(0.12, 0.06, 0.06);

/// Returns the bar of Tejada & Ertl 2005: 80 tets in 4 × 2 × 2 cells of 30 mm, in metres.
///
/// At 1000 kg/m³ its mass is 0.432 kg, and undamped Verlet is stable up to 1.08 ms at κ = 3,000 N/m
/// and 0.342 ms at 30,000 N/m, the time steps reported in the paper.
///
/// # Errors
/// None in practice: its parameters are fixed.
pub fn paper_bar() -> Result<TetMesh> {
    bar(PAPER_BAR_CELLS, PAPER_BAR_SIZE)
}

/// Returns a bar of `cells` cells, five tets each, from the origin to `size`.
///
/// # Errors
/// As [`box_mesh`].
pub fn bar(cells: [usize; 3], size: DVec3) -> Result<TetMesh> {
    box_mesh(cells, size, Split::Five)
}

/// Returns a bar from the origin to `size` with about `tets` tets in nearly cubic cells.
///
/// # Errors
/// As [`box_mesh`], and an error for fewer than 5 tets.
pub fn bar_of_about(tets: usize, size: DVec3) -> Result<TetMesh> {
    super::grid::check_size("a bar", size)?;
    if tets < 5 {
        return Err(Error::Input(format!(
            "bar must have at least 5 tets, got {tets}"
        )));
    }
    let wanted = tets as f64 / 5.0;
    let cell = (size.x * size.y * size.z / wanted).cbrt();
    let ideal = size / cell;
    // A relative error of 10 % in the count costs as much as an aspect ratio of 1.1.
    let cost = |cells: [usize; 3]| {
        let n = DVec3::from(cells.map(|n| n as f64));
        let stretch = n / ideal;
        (n.x * n.y * n.z / wanted).ln().abs()
            + 0.5 * (stretch.max_element() / stretch.min_element()).ln()
    };
    let near = |x: f64| {
        let low = (x.floor() as usize).saturating_sub(1);
        (low..=low.saturating_add(3)).filter(|n| *n > 0)
    };
    let best = near(ideal.x)
        .flat_map(|i| near(ideal.y).flat_map(move |j| near(ideal.z).map(move |k| [i, j, k])))
        .min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
    bar(best.unwrap_or([1; 3]), size)
}
