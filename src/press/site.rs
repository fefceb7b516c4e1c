//! Where a press goes: a point of the boundary, which way is out of the body there, and how thick
//! the body is.

use super::PressOptions;
use crate::mesh::{TetMesh, Topology, TriangleBvh};
use crate::render::{Ray, ReferenceRaycaster};
use crate::scene::Stage;
use crate::{Error, Result};
use glam::{DVec2, DVec3};

/// A fitting fingertip's radius over the thickness, at most that part of the body's diagonal; and at
/// least so many edges of the boundary, at most twice that part.
const RADIUS: f64 = 0.25;
const EDGES: f64 = 1.5;
const LARGEST: f64 = 0.05;
/// The outward direction is that of faces within so many of their edges.
const NORMAL_RADIUS: f64 = 2.5;
/// Steps of a ball until it touches.
const TOUCHES: u32 = 200;
/// The cosine from which on a face is too steep to be pressed from above.
const MIN_UP_COSINE: f64 = 0.5;
/// Rings of points of the picture that are tried where its middle shows nothing.
const SEARCH_RINGS: u32 = 12;

/// A place to press on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressSite {
    /// On the boundary, in file units.
    pub point: DVec3,
    /// Unit vector out of the body.
    pub outward: DVec3,
    /// How thick the body is there, in file units.
    pub thickness: f64,
}

/// The boundary of a body, as presses ask for it.
pub(super) struct Boundary {
    faces: Vec<[DVec3; 3]>,
    tree: TriangleBvh,
    rays: ReferenceRaycaster,
    /// Mean edge.
    edge: f64,
    low: DVec3,
    high: DVec3,
}

impl Boundary {
    pub fn new(mesh: &TetMesh) -> Boundary {
        let topology = Topology::new(mesh);
        let corners = |b| {
            topology
                .boundary_nodes(mesh, b)
                .map(|v| mesh.nodes[v as usize])
        };
        let faces: Vec<[DVec3; 3]> = topology.boundary.iter().map(|b| corners(*b)).collect();
        let edges = faces
            .iter()
            .map(|[a, b, c]| (a.distance(*b) + b.distance(*c) + c.distance(*a)) / 3.0);
        let (low, high) = mesh.bounds();
        Boundary {
            edge: edges.sum::<f64>() / faces.len().max(1) as f64,
            tree: TriangleBvh::new(faces.clone()),
            rays: ReferenceRaycaster::new(mesh, &mesh.nodes, &vec![0.0; mesh.nodes.len()]),
            faces,
            low,
            high,
        }
    }

    fn diagonal(&self) -> f64 {
        self.low.distance(self.high)
    }

    /// What there is to press on at a point of the boundary.
    fn spot(&self, point: DVec3, out: DVec3) -> PressSite {
        PressSite {
            point,
            outward: out,
            thickness: self.thickness(point, out),
        }
    }

    /// A radius that suits the mesh, where the body is so thick.
    pub fn fitting_radius(&self, thickness: f64) -> f64 {
        let largest = LARGEST * self.diagonal();
        (RADIUS * thickness)
            .min(largest)
            .max((EDGES * self.edge).min(2.0 * largest))
    }

    /// The point of the boundary that is nearest to `p`.
    fn nearest(&self, p: DVec3) -> Option<DVec3> {
        let (face, weights) = self.tree.nearest(p)?;
        let parts = self.faces[face].into_iter().zip(weights);
        Some(parts.map(|(corner, w)| w * corner).sum())
    }

    /// Which way is out of the body around a point of the boundary.
    fn outward(&self, point: DVec3) -> DVec3 {
        let reach = NORMAL_RADIUS * self.edge;
        let mut out = DVec3::ZERO;
        let mut nearest = (f64::INFINITY, DVec3::Z);
        for [a, b, c] in &self.faces {
            let (middle, normal) = ((*a + *b + *c) / 3.0, (*b - *a).cross(*c - *a));
            let away = middle.distance(point);
            if away < nearest.0 {
                nearest = (away, normal);
            }
            if away <= reach {
                out += normal;
            }
        }
        let own = nearest.1.normalize_or(DVec3::Z);
        let out = out.normalize_or(own);
        // Of thin parts both sides are near.
        if out.dot(own) > 0.3 { out } else { own }
    }

    /// How far a ray into the body goes until it leaves it.
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

    /// Where a ball that comes along a spot's outward direction first touches the body: how far its
    /// middle is from the point then, outwards.
    pub fn first_touch(&self, spot: &PressSite, radius: f64) -> f64 {
        // No distance changes faster than the ball moves.
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

    /// The first point of the body that is met from far away against `up`, with the way up as the
    /// way out; none where nothing is met, or what is met is steeper than 60°.
    pub fn first_from_above(&self, up: DVec3, beside: DVec3) -> Option<PressSite> {
        let far = beside + up * (self.diagonal() - (beside - self.low).dot(up));
        let met = |face: &&[DVec3; 3]| hit(far, -up, face).is_some();
        let height = |face: &[DVec3; 3]| hit(far, -up, face).unwrap_or(f64::INFINITY);
        let over = self.faces.iter().filter(met);
        let first = over.min_by(|a, b| height(a).total_cmp(&height(b)))?;
        let point = far - height(first) * up;
        let steep = self.outward(point).dot(up) < MIN_UP_COSINE;
        (!steep).then(|| self.spot(point, up))
    }
}

/// How far along a ray a triangle is met, if it is.
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

/// The place that is asked for, on a body of that `boundary`, which `stage` shows at rest.
pub(super) fn find_site(
    stage: &mut Stage,
    boundary: &Boundary,
    wanted: &PressOptions,
) -> Result<PressSite> {
    let point = match wanted.at {
        Some(at) => {
            let near = |p: &DVec3| p.distance(at) <= 0.5 * boundary.diagonal();
            boundary.nearest(at).filter(near).ok_or_else(|| {
                Error::Input(format!(
                    "{at} is nowhere near the body, which lies from {} to {}; give a point on it (--at x,y,z)",
                    boundary.low, boundary.high
                ))
            })?
        }
        None => seen(stage, wanted.pick)?,
    };
    Ok(boundary.spot(point, boundary.outward(point)))
}

/// What the picture shows at a point of it, or nearest to its middle.
fn seen(stage: &mut Stage, pick: Option<DVec2>) -> Result<DVec3> {
    if let Some(pixel) = pick {
        let found = stage.pick(pixel)?;
        return found.map(|p| p.point).ok_or_else(|| {
            Error::Input(format!(
                "at {},{} the picture shows nothing of the body; pick another point of it (--pick X,Y), or give --at x,y,z",
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
        "the picture shows nothing of the body; move the camera, or give --at x,y,z".into(),
    ))
}
