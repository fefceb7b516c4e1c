//! The table on which a pressed body lies: the lowest part of its surface is fixed there.
//!
//! That part is a region of the shape: what faces the table within the lowest 4 %. A mesh fixes the
//! lowest of its faces, as many as have the area of that region, and with them the same part for
//! linear and quadratic tets.

use super::curve::Bed;
use super::surface_moments::{Moments, extends, polygon_area};
use crate::mesh::{TetMesh, Topology};
use crate::number_format::significant;
use crate::scene::Region;
use crate::{Error, Result};
use glam::DVec3;

/// Fraction of the body's height along gravity within which it is fixed; doubled, up to a limit,
/// until the fixed part supports the body.
const FRACTION: f64 = 0.04;
const MAX_FRACTION: f64 = 0.5;

/// Difference of heights, relative to the body's, below which faces are chosen together.
const SAME_HEIGHT: f64 = 1e-9;

/// Share of the way to another choice of faces that does not matter.
const NEGLIGIBLE_SHARE: f64 = 1e-6;

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
    /// Area of the region of the shape, seen from the table, in file units squared.
    shape_area: f64,
    /// The faces whose area comes closest to it, and the closest ones on its other side.
    fixed: FixedFaces,
    others: Option<FixedFaces>,
}

/// The lowest faces of a mesh, up to some height.
#[derive(Clone, Debug, Default)]
struct FixedFaces {
    /// Their nodes, corners of elements, in increasing order.
    nodes: Vec<u32>,
    /// Their area, seen from the table, in file units squared.
    area: f64,
}

/// Another choice of fixed faces, for an estimate of how much the choice matters.
pub(super) struct OtherSupport {
    /// The fixed corners of elements.
    pub nodes: Vec<u32>,
    /// Share of the way from the chosen to the other area, at which the area of the shape's region
    /// lies.
    pub share: f64,
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
            shape_area: 0.0,
            fixed: FixedFaces::default(),
            others: None,
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
        // The last face of each height, and the area of the faces up to there.
        let (mut area, mut choices) = (0.0, Vec::<(usize, f64)>::new());
        for (k, face) in lower.iter().enumerate() {
            area += added[k];
            let next = lower.get(k + 1);
            let is_last = next.is_none_or(|next| next.height > face.height + SAME_HEIGHT);
            if is_last && choices.last().is_none_or(|(_, before)| area > *before) {
                choices.push((k, area));
            }
        }
        let of = |(last, area): (usize, f64)| FixedFaces {
            nodes: (0u32..)
                .zip(&first)
                .filter(|(_, rank)| **rank <= last)
                .map(|(v, _)| v)
                .collect(),
            area,
        };
        let wanted = self.shape_area;
        let miss = |choice: &(usize, f64)| (choice.1 - wanted).abs();
        let best = choices.iter().min_by(|a, b| miss(a).total_cmp(&miss(b)));
        let Some(best) = best.copied() else {
            return false;
        };
        let mut beyond = choices
            .iter()
            .filter(|(_, area)| (area - wanted) * (best.1 - wanted) < 0.0);
        let other = match best.1 < wanted {
            true => beyond.next(),
            false => beyond.next_back(),
        };
        self.others = other.copied().map(of);
        self.fixed = of(best);
        let held = lower.iter().filter(|face| fixed_with(face) <= best.0);
        let held = self.moments(held.map(|face| face.corners.to_vec()));
        held.area > 0.0 && extends(&held.covariance(), &own.covariance())
    }

    /// Returns the choice of faces on the other side of the shape's region; `None` if the chosen ones
    /// have its area.
    pub fn other_support(&self) -> Option<OtherSupport> {
        let other = self.others.as_ref()?;
        let share = (self.shape_area - self.fixed.area) / (other.area - self.fixed.area);
        (share > NEGLIGIBLE_SHARE).then(|| OtherSupport {
            nodes: other.nodes.clone(),
            share,
        })
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
            listed: Some(self.fixed.nodes.clone()),
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
            fixed_area_m2: self.fixed.area * unit * unit,
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
        assert_eq!(flat.fixed.nodes, bottom(&mesh, 0.0));
        assert!((flat.fixed.area - 1.0).abs() < 1e-12 && (flat.shape_area - 1.0).abs() < 1e-12);
        let above = table(&mesh, DVec3::Z);
        assert_eq!(above.fixed.nodes, bottom(&mesh, 1.0));
        assert!(above.note().is_none());
        // A finer mesh, with faces on its sides within the lowest 4 %, and quadratic tets of it.
        let fine = generate::bar([2, 2, 50], DVec3::splat(1.0)).unwrap();
        assert_eq!(table(&fine, DVec3::NEG_Z).fixed.nodes, bottom(&fine, 0.0));
        let quadratic = fine.with_mid_edge_nodes().unwrap();
        assert_eq!(
            table(&quadratic, DVec3::NEG_Z)
                .region()
                .nodes(&quadratic)
                .unwrap(),
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
            let error = (own.fixed.area / exact - 1.0).abs();
            assert!(
                error < tolerance,
                "{cells} cells: {} of {exact}",
                own.fixed.area
            );
        }
    }

    #[test]
    fn linear_and_quadratic_tets_are_fixed_at_the_same_faces() {
        let mesh = ball(6);
        let linear = table(&mesh, DVec3::NEG_Z);
        let finer = mesh.with_mid_edge_nodes().unwrap();
        let quadratic = table(&finer, DVec3::NEG_Z);
        assert_eq!(linear.fixed.area, quadratic.fixed.area);
        assert_eq!(linear.fixed.nodes, quadratic.fixed.nodes);
        // The nodes that are 0 where all linear functions are.
        let mut fixed = vec![false; mesh.nodes.len()];
        linear
            .fixed
            .nodes
            .iter()
            .for_each(|v| fixed[*v as usize] = true);
        let same = FinerSpace::new(&mesh).unwrap().fixed_nodes(&fixed);
        let nodes = quadratic.region().nodes(&finer).unwrap();
        assert!(nodes == same && nodes.len() > 2 * linear.fixed.nodes.len());
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
    }
}
