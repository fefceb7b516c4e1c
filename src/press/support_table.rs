//! The table on which a pressed body lies: the lowest part of its surface is fixed there.
//!
//! That part is a region of the shape: what faces the table within the lowest 4 %. A mesh fixes the
//! lowest of its faces, as many as have the area of that region, and with them the same part for
//! linear and quadratic tets.

use super::curve::Bed;
use crate::mesh::{TetMesh, Topology};
use crate::number_format::significant;
use crate::scene::Region;
use crate::{Error, Result};
use glam::{DMat2, DVec2, DVec3};

/// Fraction of the body's height along gravity within which it is fixed; doubled, up to a limit,
/// until the fixed part supports the body.
const FRACTION: f64 = 0.04;
const MAX_FRACTION: f64 = 0.5;

/// Minimum extent of the fixed part in every horizontal direction, relative to that of the body
/// (root mean squares).
const MIN_SUPPORT_RATIO: f64 = 0.1;

/// Difference of heights, relative to the body's, below which faces are chosen together.
const SAME_HEIGHT: f64 = 1e-9;

/// A table below a body.
#[derive(Clone, Debug)]
pub(super) struct Table {
    /// The coordinate axis closest to gravity, and whether gravity points along −axis.
    axis: usize,
    downward: bool,
    /// Fixed fraction of the height, and that which suffices for the shape.
    fraction: f64,
    shape_fraction: f64,
    low: f64,
    high: f64,
    /// The fixed corners of elements, in increasing order.
    nodes: Vec<u32>,
    /// Area of the region of the shape, and of the fixed faces, seen from the table; file units
    /// squared.
    shape_area: f64,
    fixed_area: f64,
}

/// A boundary face of an element.
struct Face {
    nodes: [u32; 3],
    corners: [DVec3; 3],
    /// Its area as seen from the table; negative if it faces away from it.
    seen_area: f64,
    /// Height of its centroid above the table, relative to the body's.
    height: f64,
}

impl Table {
    /// Places `mesh` on a table perpendicular to the coordinate axis closest to `down`. The fixed
    /// part follows from the shape, and is larger only if the mesh is too coarse for it.
    ///
    /// # Errors
    /// [`Error::Input`] if the faces of its lower half do not support it.
    pub fn new(mesh: &TetMesh, down: DVec3) -> Result<Table> {
        let axis = down.abs().max_position();
        let (low, high) = mesh.bounds();
        let mut table = Table {
            axis,
            downward: down[axis] < 0.0,
            fraction: FRACTION,
            shape_fraction: FRACTION,
            low: low[axis],
            high: high[axis],
            nodes: Vec::new(),
            shape_area: 0.0,
            fixed_area: 0.0,
        };
        let faces = match mesh.quadratic_elements() {
            Some(elements) => table.boundary_faces(&mesh.mesh_of_corners(&elements)),
            None => table.boundary_faces(mesh),
        };
        let own = table.moments(faces.iter().map(|face| face.corners.to_vec()));
        while table.fraction < MAX_FRACTION && !table.supports_shape(&faces, &own) {
            table.fraction = (2.0 * table.fraction).min(MAX_FRACTION);
        }
        table.shape_fraction = table.fraction;
        while !table.fix_faces(mesh.nodes.len(), &faces, &own) {
            if table.fraction == MAX_FRACTION {
                return Err(Error::Input(
                    "the lower half of the body has too few faces to support it on a table; set another direction of gravity (--gravity x,y,z) or use a finer mesh".into(),
                ));
            }
            table.fraction = (2.0 * table.fraction).min(MAX_FRACTION);
        }
        Ok(table)
    }

    /// Returns the boundary faces of `mesh`.
    fn boundary_faces(&self, mesh: &TetMesh) -> Vec<Face> {
        let triangles = Topology::new(mesh).boundary_triangles(mesh);
        let face = |nodes: [u32; 3]| {
            let corners = nodes.map(|v| mesh.nodes[v as usize]);
            let [a, b, c] = corners;
            Face {
                nodes,
                corners,
                seen_area: -0.5 * (b - a).cross(c - a).dot(self.up()),
                height: self.share((a + b + c) / 3.0),
            }
        };
        triangles.into_iter().map(face).collect()
    }

    /// Whether the part of the shape that is fixed is wide enough to prevent the body from turning,
    /// whatever the mesh.
    fn supports_shape(&self, faces: &[Face], own: &Moments) -> bool {
        let lower = faces.iter().filter(|face| face.seen_area > 0.0);
        let held = self.moments(lower.map(|face| self.clip(&face.corners)));
        held.area > 0.0 && extends(&held.covariance(), &own.covariance())
    }

    /// Returns the moments of `polygons`, seen from the table.
    fn moments(&self, polygons: impl Iterator<Item = Vec<DVec3>>) -> Moments {
        let [a, b] = [(self.axis + 1) % 3, (self.axis + 2) % 3];
        let mut moments = Moments::ZERO;
        polygons.for_each(|corners| moments.add_polygon(&corners, a, b));
        moments
    }

    /// Fixes the nodes of the lowest faces, as many as come closest to the area of the shape's region.
    /// Returns whether they prevent the body from turning.
    fn fix_faces(&mut self, nodes: usize, faces: &[Face], own: &Moments) -> bool {
        let mut lower: Vec<&Face> = faces.iter().filter(|face| face.seen_area > 0.0).collect();
        lower.sort_by(|a, b| a.height.total_cmp(&b.height));
        self.shape_area = lower.iter().map(|face| self.area_of_region(face)).sum();
        // The first face in that order with each node: a face is fixed as soon as its nodes are.
        let mut first = vec![usize::MAX; nodes];
        for (k, face) in lower.iter().enumerate() {
            for v in face.nodes {
                first[v as usize] = first[v as usize].min(k);
            }
        }
        let fixed_with = |face: &Face| {
            let ranks = face.nodes.map(|v| first[v as usize]);
            ranks.into_iter().max().unwrap_or_default()
        };
        let mut added = vec![0.0; lower.len()];
        for face in &lower {
            added[fixed_with(face)] += face.seen_area;
        }
        let (mut area, mut best) = (0.0, None::<(usize, f64)>);
        for (k, face) in lower.iter().enumerate() {
            area += added[k];
            let next = lower.get(k + 1);
            let is_last = next.is_none_or(|next| next.height > face.height + SAME_HEIGHT);
            let miss = |area: f64| (area - self.shape_area).abs();
            if is_last && best.is_none_or(|(_, least)| miss(area) < miss(least)) {
                best = Some((k, area));
            }
        }
        let Some((last, area)) = best else {
            return false;
        };
        self.fixed_area = area;
        let fixed = (0u32..).zip(&first).filter(|(_, rank)| **rank <= last);
        self.nodes = fixed.map(|(v, _)| v).collect();
        let held = lower.iter().filter(|face| fixed_with(face) <= last);
        let held = self.moments(held.map(|face| face.corners.to_vec()));
        held.area > 0.0 && extends(&held.covariance(), &own.covariance())
    }

    /// Returns the area of the part of `face` in the shape's region, seen from the table.
    fn area_of_region(&self, face: &Face) -> f64 {
        let whole = polygon_area(&face.corners);
        match whole > 0.0 {
            true => face.seen_area * polygon_area(&self.clip(&face.corners)) / whole,
            false => 0.0,
        }
    }

    /// Returns the part of a triangle within the fixed fraction of the height, a convex polygon.
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

    /// Whether `point` of the surface is as low as the part that is fixed.
    pub fn reaches(&self, point: DVec3) -> bool {
        self.share(point) <= self.fraction
    }

    /// Returns the fixed nodes as a region.
    pub fn region(&self) -> Region {
        Region {
            name: Some("table".into()),
            listed: Some(self.nodes.clone()),
            ..Region::default()
        }
    }

    /// Returns a description for reports; `nodes` is the number of fixed nodes, `unit` the metres
    /// per file unit.
    pub fn report(&self, nodes: usize, unit: f64) -> Bed {
        let sign = if self.downward { '-' } else { '+' };
        Bed {
            side: format!("{sign}{}", ["x", "y", "z"][self.axis]),
            fraction: self.fraction,
            area_m2: self.shape_area * unit * unit,
            fixed_area_m2: self.fixed_area * unit * unit,
            nodes,
        }
    }

    /// Returns a note if more of the body is fixed than its shape needs.
    pub fn note(&self) -> Option<String> {
        (self.fraction > self.shape_fraction).then(|| {
            format!(
                "the lowest {} % of the body are fixed to the table, because its lowest {} % have too few faces to support it; a finer mesh needs less",
                significant(100.0 * self.fraction),
                significant(100.0 * self.shape_fraction)
            )
        })
    }
}

fn polygon_area(corners: &[DVec3]) -> f64 {
    let [origin, rest @ ..] = corners else {
        return 0.0;
    };
    let triangles = rest.windows(2);
    triangles
        .map(|pair| 0.5 * (pair[0] - *origin).cross(pair[1] - *origin).length())
        .sum()
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::generate;
    use crate::mesh::FinerSpace;

    fn table(mesh: &TetMesh, down: DVec3) -> Table {
        Table::new(mesh, down).unwrap()
    }

    /// A ball of radius 1, by a block with `cells` along each edge.
    fn ball(cells: usize) -> TetMesh {
        let mut ball = generate::bar([cells; 3], DVec3::splat(2.0)).unwrap();
        for p in &mut ball.nodes {
            let q = *p - 1.0;
            *p = match q.length() > 0.0 {
                true => q * (q.abs().max_element() / q.length()),
                false => q,
            };
        }
        ball
    }

    #[test]
    fn table_fixes_the_face_of_a_block_and_no_more() {
        let mut mesh = generate::bar([4, 4, 4], DVec3::splat(1.0)).unwrap();
        let flat = table(&mesh, DVec3::NEG_Z);
        assert!(flat.note().is_none() && flat.reaches(DVec3::ZERO));
        assert!(!flat.reaches(DVec3::new(0.5, 0.5, 0.05)));
        assert_eq!(flat.up(), DVec3::Z);
        let bottom = |mesh: &TetMesh, z: f64| -> Vec<u32> {
            let nodes = (0u32..).zip(&mesh.nodes);
            let at = nodes.filter(|(_, p)| (p.z - z).abs() < 1e-9);
            at.map(|(v, _)| v).collect()
        };
        assert_eq!(flat.nodes, bottom(&mesh, 0.0));
        assert!((flat.fixed_area - 1.0).abs() < 1e-12 && (flat.shape_area - 1.0).abs() < 1e-12);
        let above = table(&mesh, DVec3::Z);
        assert_eq!(above.nodes, bottom(&mesh, 1.0));
        assert!(above.note().is_none());
        // A finer mesh, with faces on its sides within the lowest 4 %, and quadratic tets of it.
        let fine = generate::bar([2, 2, 50], DVec3::splat(1.0)).unwrap();
        assert_eq!(table(&fine, DVec3::NEG_Z).nodes, bottom(&fine, 0.0));
        let quadratic = fine.with_mid_edge_nodes().unwrap();
        assert_eq!(
            table(&quadratic, DVec3::NEG_Z).nodes,
            bottom(&quadratic, 0.0)
        );
        // One corner that sticks out below does not support the body.
        let corner = mesh.nodes.iter().position(|p| p.length() < 1e-9).unwrap();
        mesh.nodes[corner].z = -0.5;
        let wider = table(&mesh, DVec3::NEG_Z);
        assert!(wider.fraction > FRACTION, "{wider:?}");
    }

    #[test]
    fn fixed_faces_have_the_area_of_the_shapes_region() {
        // Seen from below, the lowest 4 % of a ball of radius 1 are a disc of radius √(1 − 0.92²).
        let exact = std::f64::consts::PI * (1.0 - 0.92f64 * 0.92);
        for (cells, tolerance) in [(4, 0.6), (8, 0.25), (16, 0.1), (32, 0.03)] {
            let own = table(&ball(cells), DVec3::NEG_Z);
            assert_eq!(own.fraction, FRACTION);
            let error = (own.fixed_area / exact - 1.0).abs();
            assert!(
                error < tolerance,
                "{cells} cells: {} of {exact}",
                own.fixed_area
            );
        }
    }

    #[test]
    fn linear_and_quadratic_tets_are_fixed_at_the_same_faces() {
        let mesh = ball(6);
        let linear = table(&mesh, DVec3::NEG_Z);
        let finer = mesh.with_mid_edge_nodes().unwrap();
        let quadratic = table(&finer, DVec3::NEG_Z);
        assert_eq!(linear.fixed_area, quadratic.fixed_area);
        assert_eq!(linear.nodes, quadratic.nodes);
        // The nodes that are 0 where all linear functions are.
        let mut fixed = vec![false; mesh.nodes.len()];
        linear.nodes.iter().for_each(|v| fixed[*v as usize] = true);
        let same = FinerSpace::new(&mesh).unwrap().fixed_nodes(&fixed);
        let nodes = quadratic.region().nodes(&finer).unwrap();
        assert!(nodes == same && nodes.len() > 2 * linear.nodes.len());
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
