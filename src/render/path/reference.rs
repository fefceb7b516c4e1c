//! Light paths in float64, by other means than the shader: delta tracking with one majorant for the
//! whole body, places found by barycentric coordinates in all tets, and no test of directions to the
//! surroundings. Slow; for bodies of a few tets.

use super::environment::SkyMap;
use super::lobes::{self, SpecularAlbedo};
use super::reference_scan::ReferenceScan;
use super::reference_sections::{ReferenceSection, rest_map};
use super::tone::linear;
use super::walls::Wall;
use crate::random::Random;
use crate::render::AbsoluteTransferFunction;
use glam::DVec3;
use std::f64::consts::PI;

/// Gradient with which half of the collisions are with a surface; as in the shader.
const GRADIENT_HALF_SATURATION: f64 = 2.0;
/// Optical depth and distance within which a cut face acts as a surface; as in the shader.
const CUT_DEPTH: f64 = 3.0;
const CUT_DISTANCE: f64 = 0.01;
/// Distance by which a path leaves a wall; as in the shader.
const WALL_OFFSET: f64 = 2e-5;

/// A body in the local frame, with scalars at its nodes.
pub(super) struct ReferenceBody<'a> {
    pub nodes: &'a [DVec3],
    pub tets: &'a [[u32; 4]],
    pub scalars: &'a [f64],
    /// Gradient at each node.
    pub gradients: &'a [DVec3],
    pub transfer: &'a AbsoluteTransferFunction,
    /// Local units per file unit: extinctions are per file unit.
    pub scale: f64,
    /// Clip planes: normal and offset in the local frame.
    pub clips: &'a [(DVec3, f64)],
    /// Triangles of skins and tools.
    pub walls: &'a [Wall],
    pub sections: &'a [ReferenceSection],
    /// Nodes at rest.
    pub rests: &'a [DVec3],
    pub draws_volume: bool,
    /// In place of the scalars.
    pub scan: Option<&'a ReferenceScan>,
}

pub(super) struct ReferencePaths<'a> {
    pub body: ReferenceBody<'a>,
    pub sky: SkyMap,
    pub roughness: f64,
    pub anisotropy: f64,
    pub albedo: SpecularAlbedo,
    pub random: Random,
    /// Events of all paths so far.
    pub events: u64,
}

/// What a path scatters at.
struct Event {
    place: DVec3,
    /// Linear.
    colour: [f64; 3],
    /// How likely it is with a surface, and the surface's normal.
    share: f64,
    normal: DVec3,
}

/// What a place is made of.
struct Spot {
    scalar: f64,
    gradient: DVec3,
}

impl ReferenceBody<'_> {
    /// Returns the scalar and the gradient at a place; `None` outside.
    fn at(&self, x: DVec3) -> Option<Spot> {
        for tet in self.tets {
            let p = tet.map(|v| self.nodes[v as usize]);
            let volume = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| (b - a).dot((c - a).cross(d - a));
            let whole = volume(p[0], p[1], p[2], p[3]);
            let w = [
                volume(x, p[1], p[2], p[3]),
                volume(p[0], x, p[2], p[3]),
                volume(p[0], p[1], x, p[3]),
                volume(p[0], p[1], p[2], x),
            ]
            .map(|v| v / whole);
            if w.iter().any(|w| *w < 0.0) {
                continue;
            }
            if let Some(scan) = self.scan {
                let rests = tet.map(|v| self.rests[v as usize]);
                let rest: DVec3 = (0..4).map(|k| w[k] * rests[k]).sum();
                return scan.covers(rest).then(|| Spot {
                    scalar: scan.value(rest),
                    gradient: scan.gradient(rest, rest_map(p, rests)),
                });
            }
            let sum = |of: &dyn Fn(usize) -> f64| (0..4).map(|k| w[k] * of(tet[k] as usize)).sum();
            return Some(Spot {
                scalar: sum(&|v| self.scalars[v]),
                gradient: DVec3::new(
                    sum(&|v| self.gradients[v].x),
                    sum(&|v| self.gradients[v].y),
                    sum(&|v| self.gradients[v].z),
                ),
            });
        }
        None
    }

    /// Returns the distance to the nearest clip plane and its normal; negative if clipped.
    fn cut(&self, x: DVec3) -> (f64, DVec3) {
        let each = self.clips.iter().map(|(n, c)| (c - n.dot(x), *n));
        each.fold((f64::INFINITY, DVec3::Z), |best, other| {
            if other.0 < best.0 { other } else { best }
        })
    }
}

impl ReferencePaths<'_> {
    /// Returns light and opacity of one path from `origin` along the unit vector `way`.
    pub fn trace(&mut self, origin: DVec3, way: DVec3) -> ([f64; 3], f64) {
        let (mut x, mut d) = (origin, way);
        let mut weight = [1.0; 3];
        let mut events = 0;
        loop {
            let surface = self.surface(x, d);
            let end = surface.as_ref().map_or(f64::INFINITY, |(t, _)| *t);
            let collision = match self.body.draws_volume {
                true => self.collision(x, d, end),
                false => None,
            };
            let Some(event) = collision.or(surface.map(|(_, event)| event)) else {
                break;
            };
            events += 1;
            self.events += 1;
            x = event.place;
            let normal = match event.normal.dot(d) > 0.0 {
                true => -event.normal,
                false => event.normal,
            };
            let (next, factor) = match self.random.next() < event.share && -normal.dot(d) > 1e-4 {
                true => self.reflect(normal, -d, event.colour),
                false => (self.scatter(d), event.colour),
            };
            d = next;
            for (w, f) in weight.iter_mut().zip(factor) {
                *w *= f;
            }
            let most = weight.iter().copied().fold(0.0, f64::max);
            let survives = if events > 8 { most.min(1.0) } else { 1.0 };
            if most <= 0.0 || self.random.next() >= survives {
                return ([0.0; 3], 1.0);
            }
            weight = weight.map(|w| w / survives);
        }
        if events == 0 {
            return ([0.0; 3], 0.0);
        }
        let sky = self.sky.texels[self.sky.texel(d)];
        (std::array::from_fn(|k| weight[k] * sky[k]), 1.0)
    }

    /// Returns the first collision with the body nearer than `end`: from the box around it by free
    /// flights.
    fn collision(&mut self, x: DVec3, d: DVec3, end: f64) -> Option<Event> {
        let majorant = self.body.transfer.max_extinction() * self.body.scale;
        let (low, high) = crate::mesh::bounds(self.body.nodes);
        let mut gone = enter_box(x, d, low, high)?;
        loop {
            gone -= (1.0 - self.random.next()).ln() / majorant;
            let place = x + gone * d;
            let inside = (place - low).min_element() >= 0.0 && (high - place).min_element() >= 0.0;
            if gone > end || !inside {
                return None;
            }
            let Some(spot) = self.body.at(place) else {
                continue;
            };
            let sigma = self.body.transfer.extinction(spot.scalar) * self.body.scale;
            let cut = self.body.cut(place);
            if cut.0 < 0.0 || self.random.next() * majorant >= sigma {
                continue;
            }
            let steep = spot.gradient.length();
            let mut event = Event {
                place,
                colour: self.body.transfer.colour(spot.scalar).map(linear),
                share: steep / (steep + GRADIENT_HALF_SATURATION),
                normal: spot.gradient.normalize_or_zero(),
            };
            let near = (sigma * cut.0 / CUT_DEPTH).powi(2) + (cut.0 / CUT_DISTANCE).powi(2);
            if self.random.next() < (-near).exp() {
                (event.share, event.normal) = (1.0, cut.1);
            }
            return Some(event);
        }
    }

    /// Returns the distance of the first wall, slice or isosurface that does not let a path through,
    /// and the event there.
    fn surface(&mut self, x: DVec3, d: DVec3) -> Option<(f64, Event)> {
        let mut hits = self.walls(x, d);
        for crossing in self.body.crossings(x, d) {
            let event = Event {
                place: x + crossing.distance * d,
                colour: crossing.colour.map(linear),
                share: 1.0,
                normal: crossing.normal,
            };
            hits.push((crossing.distance, crossing.opacity, event));
        }
        hits.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (t, opacity, event) in hits {
            let clipped = self.body.cut(event.place).0 < 0.0;
            if !clipped && self.random.next() < opacity {
                return Some((t, event));
            }
        }
        None
    }

    /// Returns distance, opacity and event of all walls that a ray meets.
    fn walls(&self, x: DVec3, d: DVec3) -> Vec<(f64, f64, Event)> {
        let mut hits = Vec::new();
        for wall in self.body.walls {
            let [a, b, c] = wall.corners.map(|p| p.as_dvec3());
            // Solves x + t d = a + u (b − a) + v (c − a).
            let columns = glam::DMat3::from_cols(b - a, c - a, -d);
            if columns.determinant().abs() <= 0.0 {
                continue;
            }
            let [u, v, t] = (columns.inverse() * (x - a)).to_array();
            if u < 0.0 || v < 0.0 || u + v > 1.0 || t <= WALL_OFFSET {
                continue;
            }
            let at = |of: [glam::Vec3; 3]| {
                let terms = of.map(|v| v.as_dvec3());
                (1.0 - u - v) * terms[0] + u * terms[1] + v * terms[2]
            };
            let event = Event {
                place: x + t * d,
                colour: at(wall.colours).to_array(),
                share: 1.0,
                normal: at(wall.normals).normalize_or_zero(),
            };
            hits.push((t, f64::from(wall.opacity), event));
        }
        hits
    }

    /// Returns a direction after scattering in soft tissue.
    fn scatter(&mut self, d: DVec3) -> DVec3 {
        let g = self.anisotropy;
        let u = self.random.next();
        let cosine = match g.abs() > 1e-6 {
            true => {
                let s = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
                (1.0 + g * g - s * s) / (2.0 * g)
            }
            false => 1.0 - 2.0 * u,
        };
        let turn = 2.0 * PI * self.random.next();
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let side = d.any_orthonormal_vector();
        let up = d.cross(side);
        sine * (turn.cos() * side + turn.sin() * up) + cosine * d
    }

    /// Returns a direction in which a surface reflects w, evenly over the hemisphere, and its factor.
    fn reflect(&mut self, n: DVec3, w: DVec3, colour: [f64; 3]) -> (DVec3, [f64; 3]) {
        let (z, turn) = (self.random.next(), 2.0 * PI * self.random.next());
        let side = n.any_orthonormal_vector();
        let r = (1.0 - z * z).max(0.0).sqrt();
        let l = r * (turn.cos() * side + turn.sin() * n.cross(side)) + z * n;
        let alpha = self.roughness * self.roughness;
        let (cw, cl) = (n.dot(w), n.dot(l));
        let h = (w + l).normalize();
        let a2 = alpha * alpha;
        let bottom = 1.0 + (a2 - 1.0) * n.dot(h) * n.dot(h);
        let facets = a2 / (PI * bottom * bottom);
        let specular = facets * lobes::fresnel(w.dot(h))
            / (lobes::masking(cw, alpha) * lobes::masking(cl, alpha));
        let base = (1.0 - self.albedo.at(cw)) * (1.0 - self.albedo.at(cl))
            / (PI * (1.0 - self.albedo.mean()));
        (l, colour.map(|c| (c * base + specular) * cl * 2.0 * PI))
    }
}

/// Returns the distance at which a ray is in a box, 0 inside; `None` if it misses.
fn enter_box(x: DVec3, d: DVec3, low: DVec3, high: DVec3) -> Option<f64> {
    let (a, b) = ((low - x) / d, (high - x) / d);
    let near = a.min(b).max_element().max(0.0);
    let far = a.max(b).min_element();
    (near <= far).then_some(near)
}
