//! Closed surfaces: winding number, signed distance, and domains bounded by them.

use super::Domain;
use crate::mesh::{SurfaceDescription, TriMesh, TriangleBvh};
use crate::{Error, Result};
use glam::DVec3;
use std::f64::consts::PI;

/// Subtrees whose centre is farther than this multiple of their radius are approximated by one
/// dipole.
const FAR_FIELD_RATIO: f64 = 3.0;
/// Maximum fraction of open edges of a surface.
const MAX_OPEN_EDGE_RATIO: f64 = 0.02;

/// A closed surface with inside test and signed distance.
///
/// A point is inside if its winding number exceeds ½: the generalised winding number of Jacobson et
/// al., *Robust inside-outside segmentation using generalized winding numbers* (2013), summed over
/// a tree as by Barill et al., *Fast winding numbers for soups and clouds* (2018). Components may
/// therefore overlap, the surface may intersect itself, and small holes are closed; cavities are
/// components that face inward.
#[derive(Debug)]
pub struct ClosedSurface {
    tree: TriangleBvh,
    /// The dipole of each box of the tree.
    dipoles: Vec<Dipole>,
    /// Repairs and warnings, one sentence each.
    notes: Vec<String>,
    volume: f64,
}

/// The far-field approximation of the triangles of a box.
#[derive(Clone, Copy, Debug, Default)]
struct Dipole {
    /// Area-weighted centre.
    centre: DVec3,
    /// Sum of the area vectors.
    normal: DVec3,
    /// The squared distance of the farthest corner from the centre.
    radius_squared: f64,
}

impl ClosedSurface {
    /// Prepares `surface`; triangles are oriented consistently first.
    ///
    /// # Errors
    /// An [`Error::Mesh`] for a surface with large holes, or without an inside.
    pub fn new(surface: &TriMesh) -> Result<ClosedSurface> {
        let mut surface = surface.clone();
        let mut notes = Vec::new();
        let turned = surface.orient_consistently();
        if turned > 0 {
            notes.push(format!("{turned} triangles flipped to face outward"));
        }
        let description = SurfaceDescription::new(&surface);
        let open = description.open_edges;
        let edges = 1.5 * surface.triangles.len() as f64;
        if open as f64 > MAX_OPEN_EDGE_RATIO * edges {
            return Err(Error::Mesh(format!(
                "surface must be closed, but has {open} open edges; close its holes first (for \
                example in MeshLab or Blender)"
            )));
        }
        if open > 0 {
            notes.push(format!(
                "surface has {open} open edges; holes closed by the generalised winding number"
            ));
        }
        if !(description.volume.is_finite() && description.volume > 0.0) {
            return Err(Error::Mesh(
                "surface encloses no volume; check that it is not an open sheet and that its \
                triangles are oriented consistently"
                    .into(),
            ));
        }
        let triangles = (0..surface.triangles.len()).map(|t| surface.corners(t));
        let tree = TriangleBvh::new(triangles.collect());
        let dipoles = dipoles(&tree);
        Ok(ClosedSurface {
            tree,
            dipoles,
            notes,
            volume: description.volume,
        })
    }

    /// Returns the repairs and warnings of the surface.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns the enclosed volume; overlaps count twice.
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Returns the axis-aligned bounding box: (lower corner, upper corner).
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let root = self.tree.boxes.first();
        root.map_or((DVec3::ZERO, DVec3::ZERO), |b| (b.low, b.high))
    }

    /// Returns the signed distance to the surface, positive inside.
    pub fn signed_distance(&self, p: DVec3) -> f64 {
        let distance = self.tree.distance(p);
        if self.is_inside(p) {
            distance
        } else {
            -distance
        }
    }

    /// Whether `p` is inside.
    pub fn is_inside(&self, p: DVec3) -> bool {
        let (low, high) = self.bounds();
        p.cmpge(low).all() && p.cmple(high).all() && self.winding_number(p) > 0.5
    }

    /// Returns the winding number of `p`: 1 inside, 0 outside, with fractions near holes.
    pub fn winding_number(&self, p: DVec3) -> f64 {
        let mut angle = 0.0;
        let mut stack = [0usize; 64];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let index = stack[depth];
            let dipole = &self.dipoles[index];
            let towards = dipole.centre - p;
            let distance_squared = towards.length_squared();
            if distance_squared > FAR_FIELD_RATIO * FAR_FIELD_RATIO * dipole.radius_squared {
                angle += towards.dot(dipole.normal) / (distance_squared * distance_squared.sqrt());
                continue;
            }
            let node = &self.tree.boxes[index];
            if node.right == 0 || depth + 2 > stack.len() {
                for triangle in &self.tree.triangles[node.range.0..node.range.1] {
                    angle += solid_angle(triangle.map(|v| v - p));
                }
            } else {
                stack[depth] = node.right;
                stack[depth + 1] = index + 1;
                depth += 2;
            }
        }
        angle / (4.0 * PI)
    }
}

/// Returns the solid angle of a triangle seen from the origin: Van Oosterom & Strackee (1983).
pub(crate) fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let above = a.dot(b.cross(c));
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * above.atan2(below)
}

fn dipoles(tree: &TriangleBvh) -> Vec<Dipole> {
    tree.boxes
        .iter()
        .map(|node| {
            let triangles = &tree.triangles[node.range.0..node.range.1];
            let (mut area, mut normal, mut centre) = (0.0, DVec3::ZERO, DVec3::ZERO);
            for [a, b, c] in triangles {
                let vector = 0.5 * (*b - *a).cross(*c - *a);
                let size = vector.length();
                normal += vector;
                centre += size * (*a + *b + *c) / 3.0;
                area += size;
            }
            let centre = match area > 0.0 {
                true => centre / area,
                false => 0.5 * (node.low + node.high),
            };
            let radius_squared = triangles
                .iter()
                .flatten()
                .map(|p| p.distance_squared(centre))
                .fold(0.0, f64::max);
            Dipole {
                centre,
                normal,
                radius_squared,
            }
        })
        .collect()
}

/// Regions bounded by one closed surface each; where they overlap, the later one takes precedence
/// (bone inside skin).
#[derive(Debug)]
pub struct SurfaceDomain {
    surfaces: Vec<ClosedSurface>,
}

impl SurfaceDomain {
    /// Creates the domain; region n + 1 is the inside of surface n.
    ///
    /// # Errors
    /// An error for no surface, or more than a few thousand.
    pub fn new(surfaces: Vec<ClosedSurface>) -> Result<SurfaceDomain> {
        match surfaces.len() {
            1..=4096 => Ok(SurfaceDomain { surfaces }),
            n => Err(Error::Input(format!(
                "number of surfaces to mesh together must be 1 to 4096, got {n}"
            ))),
        }
    }

    /// Returns the surfaces, the first being that of region 1.
    pub fn surfaces(&self) -> &[ClosedSurface] {
        &self.surfaces
    }
}

impl Domain for SurfaceDomain {
    fn bounds(&self) -> (DVec3, DVec3) {
        self.surfaces.iter().map(ClosedSurface::bounds).fold(
            (DVec3::INFINITY, DVec3::NEG_INFINITY),
            |(low, high), (l, h)| (low.min(l), high.max(h)),
        )
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        // The signed distance of a region is clipped where a later one begins.
        let mut outside = f64::INFINITY;
        for (n, surface) in self.surfaces.iter().enumerate().rev() {
            let distance = surface.signed_distance(p);
            weights.push((n as u16 + 1, distance.min(outside)));
            outside = outside.min(-distance);
        }
        weights.push((0, outside));
    }

    fn uniform(&self, low: DVec3, high: DVec3) -> Option<u16> {
        let middle = 0.5 * (low + high);
        let radius = 0.5 * (high - low).length();
        // If no surface is near, the whole box belongs to the last region that contains the centre.
        let mut region = 0;
        for (n, surface) in self.surfaces.iter().enumerate() {
            if surface.tree.distance(middle) <= radius {
                return None;
            }
            if surface.is_inside(middle) {
                region = n as u16 + 1;
            }
        }
        Some(region)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// A torus about z: large radius 2, small radius 0.7.
    fn torus(n: u32) -> TriMesh {
        let mut surface = TriMesh::default();
        let turn = |i: u32| f64::from(i) / f64::from(n) * 2.0 * PI;
        for i in 0..n {
            for j in 0..n {
                let ring = 2.0 + 0.7 * turn(j).cos();
                surface.vertices.push(DVec3::new(
                    ring * turn(i).cos(),
                    ring * turn(i).sin(),
                    0.7 * turn(j).sin(),
                ));
                let at = |i: u32, j: u32| (i % n) * n + j % n;
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                surface.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        surface
    }

    fn points(count: u64) -> impl Iterator<Item = DVec3> {
        let mut state = 88_172_645_463_325_252u64;
        let mut unit = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..count)
            .map(move |_| DVec3::new(6.0 * unit() - 3.0, 6.0 * unit() - 3.0, 2.4 * unit() - 1.2))
    }

    #[test]
    fn torus_distance_matches_analytic_formula() {
        let surface = ClosedSurface::new(&torus(120)).unwrap();
        let mut inside = 0;
        for p in points(3000) {
            let exact = 0.7 - (p.truncate().length() - 2.0).hypot(p.z);
            let found = surface.signed_distance(p);
            assert!((found - exact).abs() < 3e-3, "{p}: {found} for {exact}");
            inside += u32::from(exact > 0.0);
        }
        assert!(inside > 300);
    }

    #[test]
    fn winding_number_matches_sum_over_triangles() {
        let mut mesh = torus(40);
        let check = |mesh: &TriMesh| {
            let surface = ClosedSurface::new(mesh).unwrap();
            let difference = |p: DVec3| {
                let sum: f64 = (0..mesh.triangles.len())
                    .map(|t| solid_angle(mesh.corners(t).map(|v| v - p)))
                    .sum();
                (surface.winding_number(p) - sum / (4.0 * PI)).abs()
            };
            points(500).map(difference).fold(0.0, f64::max)
        };
        let worst = check(&mesh);
        assert!(worst < 0.04, "{worst}");
        // A hole changes the sum, so the comparison is sensitive.
        let closed = ClosedSurface::new(&mesh).unwrap();
        mesh.triangles.truncate(mesh.triangles.len() - 20);
        let holed = ClosedSurface::new(&mesh).unwrap();
        let change = points(500)
            .map(|p| (closed.winding_number(p) - holed.winding_number(p)).abs())
            .fold(0.0, f64::max);
        assert!(change > 0.1, "{change}");
        assert!(holed.notes().iter().any(|n| n.contains("open edges")));
        assert!(check(&mesh) < 0.04);
    }

    #[test]
    fn surfaces_are_oriented_outward_and_keep_cavities() {
        let right = torus(24);
        let volume = right.volume();
        assert!(volume > 0.0);
        let mut wrong = right.clone();
        for t in (0..wrong.triangles.len()).step_by(3) {
            wrong.triangles[t].swap(0, 1);
        }
        wrong.orient_consistently();
        assert!((wrong.volume() - volume).abs() < 1e-9);
        let mut inward = right.clone();
        inward.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        assert_eq!(inward.orient_consistently(), inward.triangles.len());
        // A smaller torus inside that faces inward is a cavity.
        let mut hollow = right.clone();
        let first = hollow.vertices.len() as u32;
        for p in &right.vertices {
            let ring = 2.0 * p.truncate().normalize().extend(0.0);
            hollow.vertices.push(ring + 0.5 * (*p - ring));
        }
        for [a, b, c] in &right.triangles {
            hollow.triangles.push([a + first, c + first, b + first]);
        }
        let surface = ClosedSurface::new(&hollow).unwrap();
        assert!(!surface.is_inside(DVec3::new(2.0, 0.0, 0.0)));
        assert!(surface.is_inside(DVec3::new(2.0, 0.0, 0.5)));
    }

    #[test]
    fn later_surfaces_take_precedence() {
        let outer = ClosedSurface::new(&torus(40)).unwrap();
        let mut inner = torus(40);
        for p in &mut inner.vertices {
            let ring = 2.0 * p.truncate().normalize().extend(0.0);
            *p = ring + 0.5 * (*p - ring);
        }
        let inner = ClosedSurface::new(&inner).unwrap();
        let domain = SurfaceDomain::new(vec![outer, inner]).unwrap();
        let region = |p: DVec3| {
            let mut weights = Vec::new();
            domain.weights(p, &mut weights);
            let largest = weights.iter().max_by(|a, b| a.1.total_cmp(&b.1));
            largest.unwrap().0
        };
        assert_eq!(region(DVec3::new(2.0, 0.0, 0.0)), 2);
        assert_eq!(region(DVec3::new(2.0, 0.0, 0.5)), 1);
        assert_eq!(region(DVec3::ZERO), 0);
    }

    #[test]
    fn rejects_open_sheets() {
        let mut sheet = torus(24);
        sheet.triangles.truncate(600);
        let error = ClosedSurface::new(&sheet).unwrap_err().to_string();
        assert!(error.contains("open edges"), "{error}");
    }
}
