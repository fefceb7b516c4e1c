//! The table on which a pressed body lies: its lowest part is fixed there.

use crate::mesh::TetMesh;
use crate::number_format::significant;
use crate::scene::{Axis, Region};
use crate::{Error, Result};
use glam::{DMat2, DVec2, DVec3};

/// Fraction of the body's height along gravity that is fixed; doubled, up to a limit, until the
/// fixed nodes support the body.
const FRACTION: f64 = 0.04;
const MAX_FRACTION: f64 = 0.5;

/// Minimum extent of the fixed nodes in every horizontal direction, relative to that of the body
/// (root mean squares).
const MIN_SUPPORT_RATIO: f64 = 0.1;

/// A table below a body.
#[derive(Clone, Copy, Debug)]
pub(super) struct Table {
    /// The coordinate axis closest to gravity, and whether gravity points along −axis.
    axis: usize,
    downward: bool,
    /// Fixed fraction of the height.
    fraction: f64,
    low: f64,
    high: f64,
}

impl Table {
    /// Places `mesh` on a table perpendicular to the coordinate axis closest to `down`.
    ///
    /// # Errors
    /// [`Error::Input`] if its lower half has too few nodes to support it.
    pub fn new(mesh: &TetMesh, down: DVec3) -> Result<Table> {
        let axis = down.abs().max_position();
        let (low, high) = mesh.bounds();
        let mut table = Table {
            axis,
            downward: down[axis] < 0.0,
            fraction: FRACTION,
            low: low[axis],
            high: high[axis],
        };
        while !table.supports(mesh) {
            if table.fraction == MAX_FRACTION {
                return Err(Error::Input(
                    "the lower half of the body has too few nodes to support it on a table; set another direction of gravity (--gravity x,y,z) or use a finer mesh".into(),
                ));
            }
            table.fraction = (2.0 * table.fraction).min(MAX_FRACTION);
        }
        Ok(table)
    }

    /// Whether the fixed nodes prevent the body from turning: their horizontal extent is not
    /// negligible beside that of the body.
    fn supports(&self, mesh: &TetMesh) -> bool {
        let [a, b] = [(self.axis + 1) % 3, (self.axis + 2) % 3];
        let flat = |p: &DVec3| DVec2::new(p[a], p[b]);
        let fixed: Vec<DVec2> = mesh
            .nodes
            .iter()
            .filter(|p| self.holds(**p))
            .map(flat)
            .collect();
        let own = covariance(&mesh.nodes.iter().map(flat).collect::<Vec<_>>());
        let held = covariance(&fixed);
        // Held − ratio² · own is positive definite.
        let rest = held - MIN_SUPPORT_RATIO * MIN_SUPPORT_RATIO * own;
        fixed.len() >= 3 && rest.x_axis.x > 0.0 && rest.determinant() > 0.0
    }

    /// Whether `point` belongs to the part that is fixed.
    pub fn holds(&self, point: DVec3) -> bool {
        let height = (self.high - self.low).max(f64::MIN_POSITIVE);
        let share = (point[self.axis] - self.low) / height;
        match self.downward {
            true => share <= self.fraction,
            false => share >= 1.0 - self.fraction,
        }
    }

    /// Returns the region that is fixed.
    pub fn region(&self) -> Region {
        Region {
            name: Some("table".into()),
            axis: Some([Axis::X, Axis::Y, Axis::Z][self.axis]),
            below: self.downward.then_some(self.fraction),
            above: (!self.downward).then_some(1.0 - self.fraction),
            ..Region::default()
        }
    }

    /// Returns a note if more of the body is fixed than usual.
    pub fn note(&self) -> Option<String> {
        (self.fraction > FRACTION).then(|| {
            format!(
                "the lowest {} % of the body are fixed to the table, because its lowest {} % have too few nodes to support it; a finer mesh needs less",
                significant(100.0 * self.fraction),
                significant(100.0 * FRACTION)
            )
        })
    }
}

/// Returns the covariance of points.
fn covariance(points: &[DVec2]) -> DMat2 {
    let count = points.len().max(1) as f64;
    let middle = points.iter().sum::<DVec2>() / count;
    let mut sum = DMat2::ZERO;
    for p in points {
        let off = *p - middle;
        sum += DMat2::from_cols(off.x * off, off.y * off);
    }
    sum * (1.0 / count)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::generate;

    #[test]
    fn table_fixes_enough_nodes_to_support_body() {
        let mut mesh = generate::bar([4, 4, 4], DVec3::splat(1.0)).unwrap();
        let flat = Table::new(&mesh, DVec3::NEG_Z).unwrap();
        assert!(flat.note().is_none() && flat.holds(DVec3::ZERO));
        assert!(!flat.holds(DVec3::new(0.5, 0.5, 0.05)));
        // One node that sticks out below does not support the body.
        let corner = mesh.nodes.iter().position(|p| p.length() < 1e-9).unwrap();
        mesh.nodes[corner].z = -0.1;
        let wider = Table::new(&mesh, DVec3::NEG_Z).unwrap();
        assert!(wider.note().unwrap().contains("16 %"), "{wider:?}");
        assert!(wider.holds(DVec3::new(1.0, 1.0, 0.0)));
        let above = Table::new(&mesh, DVec3::Z).unwrap();
        assert!(above.holds(DVec3::new(0.0, 0.0, 1.0)) && above.note().is_none());
        assert_eq!(above.region().above, Some(1.0 - FRACTION));
    }
}
