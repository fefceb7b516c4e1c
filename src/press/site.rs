//! Press site: a point of the boundary, the outward direction and the thickness of the body there.

use super::PressOptions;
use crate::mesh::{TetMesh, Topology, TriangleBvh, bounds};
use crate::render::{Ray, ReferenceRaycaster};
use crate::scene::{Motion, Stage};
use crate::{Error, Result};
use glam::{DVec2, DVec3};

/// Default radius of the fingertip, relative to the body's mean chord length: a property of the
/// shape, whatever its mesh.
const RADIUS_RATIO: f64 = 0.2;
/// Maximum number of conservative advancement steps.
const TOUCHES: u32 = 200;
/// Minimum cosine between the outward direction and up for pressing from above.
const MIN_UP_COSINE: f64 = 0.5;
/// Rings of pixels searched if the image centre shows no body.
const SEARCH_RINGS: u32 = 12;

/// A press site.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressSite {
    /// Point on the boundary, in file units.
    pub point: DVec3,
    /// Unit vector out of the body.
    pub outward: DVec3,
    /// Thickness of the body there, in file units.
    pub thickness: f64,
}

impl PressSite {
    /// Returns the default radius of the fingertip on the body of `mesh`, in file units.
    pub fn default_radius(mesh: &TetMesh, topology: &Topology) -> f64 {
        RADIUS_RATIO * topology.mean_chord(mesh)
    }
}

/// Boundary of a body with search structures.
pub(super) struct Boundary {
    faces: Vec<[DVec3; 3]>,
    /// The tet behind each face.
    tets: Vec<u32>,
    tree: TriangleBvh,
    rays: ReferenceRaycaster,
    low: DVec3,
    high: DVec3,
}

impl Boundary {
    /// The boundary of the simulated body at rest; that of quadratic tets has four faces for each face
    /// of its mesh.
    pub fn at_rest(motion: &Motion) -> Boundary {
        let (mesh, topology) = (motion.simulator.mesh(), motion.simulator.topology());
        Boundary::new(mesh, topology, &mesh.nodes)
    }

    /// The boundary of the body of `mesh`, deformed to the node positions `x`.
    pub fn new(mesh: &TetMesh, topology: &Topology, x: &[DVec3]) -> Boundary {
        let corners = |b| topology.boundary_nodes(mesh, b).map(|v| x[v as usize]);
        let faces: Vec<[DVec3; 3]> = topology.boundary.iter().map(|b| corners(*b)).collect();
        let (low, high) = bounds(faces.as_flattened());
        Boundary {
            tets: topology.boundary.iter().map(|b| b.tet).collect(),
            tree: TriangleBvh::new(faces.clone()),
            rays: ReferenceRaycaster::new(mesh, x, &vec![0.0; x.len()]),
            faces,
            low,
            high,
        }
    }

    pub(super) fn diagonal(&self) -> f64 {
        self.low.distance(self.high)
    }

    /// Returns the site at the boundary point nearest to `point`, for a fingertip of `radius`.
    pub fn site_at(&self, point: DVec3, radius: f64) -> PressSite {
        let point = self.nearest(point).unwrap_or(point);
        self.spot(point, self.outward(point, radius))
    }

    /// Returns the site at a boundary point.
    pub(super) fn spot(&self, point: DVec3, out: DVec3) -> PressSite {
        PressSite {
            point,
            outward: out,
            thickness: self.thickness(point, out),
        }
    }

    /// Returns the middle of each face, and its outward direction.
    #[cfg(feature = "identify")]
    pub(super) fn face_middles(&self) -> Vec<(DVec3, DVec3)> {
        let of = |[a, b, c]: &[DVec3; 3]| {
            let outward = (*b - *a).cross(*c - *a).normalize_or_zero();
            ((*a + *b + *c) / 3.0, outward)
        };
        self.faces.iter().map(of).collect()
    }

    /// Returns the tet behind the boundary at a point.
    pub fn tet_at(&self, point: DVec3) -> Option<u32> {
        let (face, _) = self.tree.nearest(point)?;
        self.tets.get(face).copied()
    }

    /// Returns the mean edge length of the faces within `radius` of a boundary point, or of the one
    /// nearest to it.
    pub fn edge_near(&self, point: DVec3, radius: f64) -> f64 {
        let mean =
            |[a, b, c]: &[DVec3; 3]| (a.distance(*b) + b.distance(*c) + c.distance(*a)) / 3.0;
        let near = |[a, b, c]: &&[DVec3; 3]| {
            let away = |p: &DVec3| p.distance(point) <= radius;
            away(a) || away(b) || away(c)
        };
        let edges: Vec<f64> = self.faces.iter().filter(near).map(mean).collect();
        match self.tree.nearest(point) {
            Some((face, _)) if edges.is_empty() => mean(&self.faces[face]),
            _ => edges.iter().sum::<f64>() / edges.len().max(1) as f64,
        }
    }

    /// Returns the boundary point closest to `p`.
    fn nearest(&self, p: DVec3) -> Option<DVec3> {
        let (face, weights) = self.tree.nearest(p)?;
        let parts = self.faces[face].into_iter().zip(weights);
        Some(parts.map(|(corner, w)| w * corner).sum())
    }

    /// Returns the mean outward direction of the boundary within `radius` of a boundary point, on
    /// the same side of the body.
    fn outward(&self, point: DVec3, radius: f64) -> DVec3 {
        let normal = |[a, b, c]: &[DVec3; 3]| (*b - *a).cross(*c - *a);
        let nearest = self.tree.nearest(point);
        let own = nearest.map_or(DVec3::Z, |(face, _)| normal(&self.faces[face]));
        let near = |[a, b, c]: &&[DVec3; 3]| ((*a + *b + *c) / 3.0).distance(point) <= radius;
        let around = self.faces.iter().filter(near).map(normal);
        let out: DVec3 = around.filter(|n| n.dot(own) > 0.0).sum();
        out.normalize_or(own.normalize_or(DVec3::Z))
    }

    /// Returns the length of the ray into the body until it exits.
    fn thickness(&self, point: DVec3, out: DVec3) -> f64 {
        let diagonal = self.diagonal();
        let ray = Ray {
            origin: point + 1e-3 * diagonal * out,
            direction: -out,
        };
        let (mut end, mut start) = (None, 0.0);
        for segment in self.rays.segments(ray) {
            match end {
                None => start = segment.t[0],
                Some(last) if segment.t[0] > last + 1e-6 * diagonal => break,
                Some(_) => {}
            }
            end = Some(segment.t[1].max(end.unwrap_or(0.0)));
        }
        end.map_or(0.0, |end| end - start).max(1e-3 * diagonal)
    }

    /// Returns the distance of the ball's centre from the site, along the outward direction, at
    /// first contact with the body.
    pub fn first_touch(&self, spot: &PressSite, radius: f64) -> f64 {
        // Conservative advancement: the distance changes at most as fast as the ball moves.
        let mut height = radius + self.diagonal();
        for _ in 0..TOUCHES {
            let free = self.tree.distance(spot.point + height * spot.outward) - radius;
            if free < 1e-6 * radius {
                break;
            }
            height -= free;
        }
        height
    }

    /// Returns the site where a ray from far above against `up` first hits the body, with `up` as
    /// the outward direction; `None` on a miss or if the surface within `radius` is steeper than
    /// 60°.
    pub fn first_from_above(&self, up: DVec3, beside: DVec3, radius: f64) -> Option<PressSite> {
        let far = beside + up * (self.diagonal() - (beside - self.low).dot(up));
        let met = |face: &&[DVec3; 3]| hit(far, -up, face).is_some();
        let height = |face: &[DVec3; 3]| hit(far, -up, face).unwrap_or(f64::INFINITY);
        let over = self.faces.iter().filter(met);
        let first = over.min_by(|a, b| height(a).total_cmp(&height(b)))?;
        let point = far - height(first) * up;
        let steep = self.outward(point, radius).dot(up) < MIN_UP_COSINE;
        (!steep).then(|| self.spot(point, up))
    }
}

/// Returns the ray parameter of the intersection with a triangle, if any.
fn hit(origin: DVec3, direction: DVec3, [a, b, c]: &[DVec3; 3]) -> Option<f64> {
    let (u, v) = (*b - *a, *c - *a);
    let across = direction.cross(v);
    let det = u.dot(across);
    let from = origin - *a;
    let s = from.dot(across) / det;
    let q = from.cross(u);
    let t = direction.dot(q) / det;
    let inside = s >= 0.0 && t >= 0.0 && s + t <= 1.0;
    (inside && det != 0.0).then(|| v.dot(q) / det)
}

/// Returns the requested site for a fingertip of `radius` on a body with the given `boundary`, shown
/// at rest by `stage`.
pub(super) fn find_site(
    stage: &mut Stage,
    boundary: &Boundary,
    wanted: &PressOptions,
    radius: f64,
) -> Result<PressSite> {
    let point = match wanted.at {
        Some(at) if boundary.tree.distance(at) > 0.5 * boundary.diagonal() => {
            return Err(Error::Input(format!(
                "press point {at} is too far from the body, which spans {} to {}; give a point on the body (--at x,y,z)",
                boundary.low, boundary.high
            )));
        }
        Some(at) => at,
        None => seen(stage, wanted.pick)?,
    };
    Ok(boundary.site_at(point, radius))
}

/// Returns the point visible at a pixel, or nearest to the image centre.
fn seen(stage: &mut Stage, pick: Option<DVec2>) -> Result<DVec3> {
    if let Some(pixel) = pick {
        let found = stage.pick(pixel)?;
        return found.map(|p| p.point).ok_or_else(|| {
            Error::Input(format!(
                "the body is not visible at pixel {},{}; pick another pixel (--pick X,Y), or give --at x,y,z",
                pixel.x, pixel.y
            ))
        });
    }
    let size = stage.size().map(f64::from);
    let middle = 0.5 * DVec2::from(size);
    for ring in 0..SEARCH_RINGS {
        let radius = f64::from(ring) / f64::from(SEARCH_RINGS) * middle.min_element();
        for k in 0..(1 + 6 * ring) {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(1 + 6 * ring);
            let pixel = middle + radius * DVec2::from_angle(angle);
            if let Some(found) = stage.pick(pixel)? {
                return Ok(found.point);
            }
        }
    }
    Err(Error::Input(
        "the body is not visible in the image; move the camera, or give --at x,y,z".into(),
    ))
}
