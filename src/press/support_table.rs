//! The table on which a pressed body lies: its lowest part is fixed there.

use super::curve::Bed;
use crate::mesh::{TetMesh, Topology};
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
    /// Fixed fraction of the height, and that which suffices for the shape.
    fraction: f64,
    shape_fraction: f64,
    low: f64,
    high: f64,
}

impl Table {
    /// Places `mesh` on a table perpendicular to the coordinate axis closest to `down`. The fixed
    /// part follows from the shape, and is larger only if a coarse mesh has too few nodes there.
    ///
    /// # Errors
    /// [`Error::Input`] if its lower half has too few nodes to support it.
    pub fn new(mesh: &TetMesh, topology: &Topology, down: DVec3) -> Result<Table> {
        let axis = down.abs().max_position();
        let (low, high) = mesh.bounds();
        let mut table = Table {
            axis,
            downward: down[axis] < 0.0,
            fraction: FRACTION,
            shape_fraction: FRACTION,
            low: low[axis],
            high: high[axis],
        };
        while table.fraction < MAX_FRACTION && !table.supports_shape(mesh, topology) {
            table.fraction = (2.0 * table.fraction).min(MAX_FRACTION);
        }
        table.shape_fraction = table.fraction;
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

    /// Whether the fixed part of the boundary is wide enough to prevent the body from turning,
    /// whatever the mesh.
    fn supports_shape(&self, mesh: &TetMesh, topology: &Topology) -> bool {
        let [a, b] = [(self.axis + 1) % 3, (self.axis + 2) % 3];
        let (mut own, mut held) = (Moments::ZERO, Moments::ZERO);
        for face in &topology.boundary {
            let corners = topology
                .boundary_nodes(mesh, *face)
                .map(|v| mesh.nodes[v as usize]);
            own.add_polygon(&corners, a, b);
            held.add_polygon(&self.clip(&corners), a, b);
        }
        extends(&held.covariance(), &own.covariance()) && held.area > 0.0
    }

    /// Returns the part of a triangle that is fixed, a convex polygon.
    fn clip(&self, triangle: &[DVec3; 3]) -> Vec<DVec3> {
        let inside = |p: &DVec3| self.fraction - self.share(*p);
        let mut polygon = Vec::with_capacity(4);
        for (k, p) in triangle.iter().enumerate() {
            let next = &triangle[(k + 1) % 3];
            let (here, there) = (inside(p), inside(next));
            if here >= 0.0 {
                polygon.push(*p);
            }
            if here * there < 0.0 {
                polygon.push(p.lerp(*next, here / (here - there)));
            }
        }
        polygon
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
        fixed.len() >= 3 && extends(&covariance(&fixed), &own)
    }

    /// Returns the direction away from the table.
    pub fn up(&self) -> DVec3 {
        match self.downward {
            true => DVec3::AXES[self.axis],
            false => -DVec3::AXES[self.axis],
        }
    }

    /// Returns the height of `point` above the table, relative to the body's.
    fn share(&self, point: DVec3) -> f64 {
        let height = (self.high - self.low).max(f64::MIN_POSITIVE);
        let share = (point[self.axis] - self.low) / height;
        if self.downward { share } else { 1.0 - share }
    }

    /// Whether `point` belongs to the part that is fixed.
    pub fn holds(&self, point: DVec3) -> bool {
        self.share(point) <= self.fraction
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

    /// Returns a description for reports; `nodes` is the number of fixed nodes.
    pub fn report(&self, nodes: usize) -> Bed {
        let sign = if self.downward { '-' } else { '+' };
        Bed {
            side: format!("{sign}{}", ["x", "y", "z"][self.axis]),
            fraction: self.fraction,
            nodes,
        }
    }

    /// Returns a note if more of the body is fixed than its shape needs.
    pub fn note(&self) -> Option<String> {
        (self.fraction > self.shape_fraction).then(|| {
            format!(
                "the lowest {} % of the body are fixed to the table, because its lowest {} % have too few nodes to support it; a finer mesh needs less",
                significant(100.0 * self.fraction),
                significant(100.0 * self.shape_fraction)
            )
        })
    }
}

/// Whether points with the covariance `held` extend far enough, in every direction, beside those
/// with the covariance `own`.
fn extends(held: &DMat2, own: &DMat2) -> bool {
    // Held − ratio² · own is positive definite.
    let rest = *held - MIN_SUPPORT_RATIO * MIN_SUPPORT_RATIO * *own;
    rest.x_axis.x > 0.0 && rest.determinant() > 0.0
}

/// Area and moments of a surface, projected along a coordinate axis.
struct Moments {
    area: f64,
    first: DVec2,
    second: DMat2,
}

impl Moments {
    /// Those of nothing. (glam's default matrix is the identity.)
    const ZERO: Moments = Moments {
        area: 0.0,
        first: DVec2::ZERO,
        second: DMat2::ZERO,
    };

    /// Adds a convex polygon with its own area and the coordinates `a` and `b`.
    fn add_polygon(&mut self, corners: &[DVec3], a: usize, b: usize) {
        let [origin, rest @ ..] = corners else {
            return;
        };
        for pair in rest.windows(2) {
            let triangle = [*origin, pair[0], pair[1]];
            let area = 0.5 * (pair[0] - *origin).cross(pair[1] - *origin).length();
            let flat = triangle.map(|p| DVec2::new(p[a], p[b]));
            let sum: DVec2 = flat.iter().sum();
            self.area += area;
            self.first += area / 3.0 * sum;
            // ∫ p pᵀ = A/12 (Σ pᵢ pᵢᵀ + Σ pᵢ Σ pᵢᵀ)
            for p in flat.iter().chain([&sum]) {
                self.second += outer_product(*p) * (area / 12.0);
            }
        }
    }

    fn covariance(&self) -> DMat2 {
        if self.area <= 0.0 {
            return DMat2::ZERO;
        }
        self.second * (1.0 / self.area) - outer_product(self.first / self.area)
    }
}

fn outer_product(p: DVec2) -> DMat2 {
    DMat2::from_cols(p.x * p, p.y * p)
}

/// Returns the covariance of points.
fn covariance(points: &[DVec2]) -> DMat2 {
    let count = points.len().max(1) as f64;
    let middle = points.iter().sum::<DVec2>() / count;
    let mut sum = DMat2::ZERO;
    for p in points {
        sum += outer_product(*p - middle);
    }
    sum * (1.0 / count)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::generate;

    fn table(mesh: &TetMesh, down: DVec3) -> Table {
        Table::new(mesh, &Topology::new(mesh), down).unwrap()
    }

    #[test]
    fn table_fixes_enough_nodes_to_support_body() {
        let mut mesh = generate::bar([4, 4, 4], DVec3::splat(1.0)).unwrap();
        let flat = table(&mesh, DVec3::NEG_Z);
        assert!(flat.note().is_none() && flat.holds(DVec3::ZERO));
        assert!(!flat.holds(DVec3::new(0.5, 0.5, 0.05)));
        assert_eq!(flat.up(), DVec3::Z);
        // One corner that sticks out below does not support the body.
        let corner = mesh.nodes.iter().position(|p| p.length() < 1e-9).unwrap();
        mesh.nodes[corner].z = -0.5;
        let wider = table(&mesh, DVec3::NEG_Z);
        assert!(wider.fraction > FRACTION, "{wider:?}");
        assert!(wider.holds(DVec3::new(0.25, 0.0, 0.0)));
        let above = table(&mesh, DVec3::Z);
        assert!(above.holds(DVec3::new(0.0, 0.0, 1.0)) && above.note().is_none());
        assert_eq!(above.region().above, Some(1.0 - FRACTION));
    }

    #[test]
    fn fixed_part_depends_on_shape_alone() {
        let of = |cells: usize| {
            let mut ball = generate::bar([cells; 3], DVec3::splat(2.0)).unwrap();
            for p in &mut ball.nodes {
                // A wedge with a keel: its lowest quarter is too thin to stand on.
                p.x = 1.0 + (p.x - 1.0) * (0.1 * p.z).max(0.05 + 1.9 * (p.z - 0.5));
            }
            table(&ball, DVec3::NEG_Z)
        };
        let (coarse, fine) = (of(4), of(16));
        assert_eq!(coarse.shape_fraction, fine.shape_fraction);
        assert!(
            fine.shape_fraction > FRACTION && fine.note().is_none(),
            "{fine:?}"
        );
        let mut moments = Moments::ZERO;
        let square = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
        moments.add_polygon(&square, 0, 1);
        let found = moments.covariance();
        assert!(
            (found.x_axis - DVec2::new(1.0 / 12.0, 0.0)).length() < 1e-12,
            "{found}"
        );
        assert!(
            (found.y_axis - DVec2::new(0.0, 1.0 / 12.0)).length() < 1e-12,
            "{found}"
        );
    }
}
