//! Where a press goes: a point of the boundary, which way is out of the body there, and how thick
//! the body is.

use super::Wanted;
use crate::mesh::{TetMesh, Topology, Tree};
use crate::render::{Ray, RayReference};
use crate::scene::Stage;
use crate::{Error, Result};
use glam::{DVec2, DVec3};

/// A fitting fingertip's radius over the thickness, at most that part of the body's diagonal; and at
/// least so many edges of the boundary, at most twice that part.
const RADIUS: f64 = 0.25;
const EDGES: f64 = 1.5;
const LARGEST: f64 = 0.05;
/// The outward direction is that of faces within so many of their edges.
const AROUND: f64 = 2.5;
/// Steps of a ball until it touches.
const TOUCHES: u32 = 200;
/// Rings of points of the picture that are tried where its middle shows nothing.
const RINGS: u32 = 12;

/// A place to press on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// On the boundary, in file units.
    pub point: DVec3,
    /// Unit vector out of the body.
    pub out: DVec3,
    /// How thick the body is there, in file units.
    pub thickness: f64,
    /// Mean edge of the boundary, and the diagonal of the body.
    edge: f64,
    diagonal: f64,
}

impl Spot {
    /// A radius that suits the thickness and the mesh.
    pub(super) fn fitting_radius(&self) -> f64 {
        let largest = LARGEST * self.diagonal;
        (RADIUS * self.thickness)
            .min(largest)
            .max((EDGES * self.edge).min(2.0 * largest))
    }
}

/// The place that is asked for, on `mesh`, which `stage` shows at rest.
pub(super) fn choose(stage: &mut Stage, mesh: &TetMesh, wanted: &Wanted) -> Result<Spot> {
    let topology = Topology::new(mesh);
    let (low, high) = mesh.bounds();
    let diagonal = (high - low).length();
    let faces: Vec<[u32; 3]> = topology
        .boundary
        .iter()
        .map(|b| topology.boundary_nodes(mesh, *b))
        .collect();
    let corners = |face: &[u32; 3]| face.map(|v| mesh.nodes[v as usize]);
    let edges = faces.iter().map(|face| {
        let [a, b, c] = corners(face);
        (a.distance(b) + b.distance(c) + c.distance(a)) / 3.0
    });
    let edge = edges.sum::<f64>() / faces.len().max(1) as f64;
    let point = match wanted.at {
        Some(at) => {
            let tree = Tree::new(faces.iter().map(corners).collect());
            let found = tree.nearest(at).map(|(face, weights)| {
                let parts = corners(&faces[face]).into_iter().zip(weights);
                parts.map(|(p, w)| w * p).sum::<DVec3>()
            });
            found
                .filter(|p| p.distance(at) <= 0.5 * diagonal)
                .ok_or_else(|| {
                    Error::Input(format!(
                        "{at} is nowhere near the body, which lies from {low} to {high}; give a point on it (--at x,y,z)"
                    ))
                })?
        }
        None => seen(stage, wanted.pick)?,
    };
    let reach = AROUND * edge;
    let mut out = DVec3::ZERO;
    let mut nearest = (f64::INFINITY, DVec3::Z);
    for face in &faces {
        let [a, b, c] = corners(face);
        let (middle, normal) = ((a + b + c) / 3.0, (b - a).cross(c - a));
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
    let out = if out.dot(own) > 0.3 { out } else { own };
    Ok(Spot {
        point,
        out,
        thickness: thickness(mesh, point, out, diagonal),
        edge,
        diagonal,
    })
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
    for ring in 0..RINGS {
        let radius = f64::from(ring) / f64::from(RINGS) * middle.min_element();
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

/// How far a ray into the body goes until it leaves it.
fn thickness(mesh: &TetMesh, point: DVec3, out: DVec3, diagonal: f64) -> f64 {
    let rays = RayReference::new(mesh, &mesh.nodes, &vec![0.0; mesh.nodes.len()]);
    let ray = Ray {
        origin: point + 1e-3 * diagonal * out,
        direction: -out,
    };
    let (mut end, mut start) = (None, 0.0);
    for segment in rays.segments(ray) {
        match end {
            None => start = segment.t[0],
            Some(last) if segment.t[0] > last + 1e-6 * diagonal => break,
            Some(_) => {}
        }
        end = Some(segment.t[1].max(end.unwrap_or(0.0)));
    }
    end.map_or(0.0, |end| end - start).max(1e-3 * diagonal)
}

/// Where a ball that comes along `out` first touches the body: how far its middle is from the point
/// then, outwards.
pub(super) fn first_touch(mesh: &TetMesh, spot: &Spot, radius: f64) -> f64 {
    let topology = Topology::new(mesh);
    let corners = |b| {
        topology
            .boundary_nodes(mesh, b)
            .map(|v| mesh.nodes[v as usize])
    };
    let boundary = Tree::new(topology.boundary.iter().map(|b| corners(*b)).collect());
    // No distance changes faster than the ball moves.
    let mut height = radius + spot.diagonal;
    for _ in 0..TOUCHES {
        let free = boundary.distance(spot.point + height * spot.out) - radius;
        if free < 1e-6 * radius {
            break;
        }
        height -= free;
    }
    height
}
