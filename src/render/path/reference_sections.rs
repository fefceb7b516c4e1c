//! Slices and isosurfaces for light paths in float64, found in each tet by itself.

use super::reference::ReferenceBody;
use crate::render::AbsoluteTransferFunction;
use glam::{DMat3, DVec3};

/// Distance below which a path does not meet the surface again that it has left.
const OFFSET: f64 = 1e-9;

/// A slice or an isosurface, in the local frame.
#[derive(Clone, Copy)]
pub(super) struct ReferenceSection {
    pub shape: Shape,
    /// Colour in sRGB; `None` takes that of the transfer function.
    pub colour: Option<[f64; 3]>,
    pub opacity: f64,
}

#[derive(Clone, Copy)]
pub(super) enum Shape {
    /// Normal, offset, and whether the plane is at rest.
    Plane(DVec3, f64, bool),
    /// The value of the scalar.
    Value(f64),
}

/// A surface that a ray crosses.
pub(super) struct Crossing {
    pub distance: f64,
    pub normal: DVec3,
    /// In sRGB.
    pub colour: [f64; 3],
    pub opacity: f64,
}

impl ReferenceSection {
    /// Returns the crossing at a distance, with a normal, where the scalar is `scalar`.
    fn crossing(
        &self,
        (distance, normal): (f64, DVec3),
        scalar: f64,
        transfer: &AbsoluteTransferFunction,
    ) -> Crossing {
        Crossing {
            distance,
            normal,
            colour: self.colour.unwrap_or_else(|| transfer.colour(scalar)),
            opacity: self.opacity,
        }
    }
}

/// Returns the derivative of the rest positions in a tet by the places.
pub(super) fn rest_map(p: [DVec3; 4], rests: [DVec3; 4]) -> DMat3 {
    let edges = |v: [DVec3; 4]| DMat3::from_cols(v[1] - v[0], v[2] - v[0], v[3] - v[0]);
    edges(rests) * edges(p).inverse()
}

impl ReferenceBody<'_> {
    /// Returns all crossings of a ray from x along the unit vector d.
    pub fn crossings(&self, x: DVec3, d: DVec3) -> Vec<Crossing> {
        let mut found = Vec::new();
        if self.sections.is_empty() {
            return found;
        }
        for tet in self.tets {
            let nodes = tet.map(|v| v as usize);
            let p = nodes.map(|v| self.nodes[v]);
            // The rows are the gradients of three barycentric coordinates.
            let rows = DMat3::from_cols(p[1] - p[0], p[2] - p[0], p[3] - p[0])
                .inverse()
                .transpose();
            let [a, b, c] = [rows.x_axis, rows.y_axis, rows.z_axis];
            let slopes = [-(a + b + c), a, b, c];
            let shares = |t: f64| {
                let from_first = x + t * d - p[0];
                let mut w = slopes.map(|g| g.dot(from_first));
                w[0] += 1.0;
                w
            };
            let Some([near, far]) = inside_range(shares(0.0), slopes.map(|g| g.dot(d))) else {
                continue;
            };
            let at = |t: f64, of: &[f64; 4]| -> f64 {
                shares(t).iter().zip(of).map(|(w, f)| w * f).sum()
            };
            for section in self.sections {
                if let (Shape::Value(value), Some(scan)) = (section.shape, self.scan) {
                    let rests = nodes.map(|v| self.rests[v]);
                    let rest = |t: f64| -> DVec3 {
                        shares(t).iter().zip(rests).map(|(w, r)| *w * r).sum()
                    };
                    for u in scan.crossings([rest(near), rest(far)], value) {
                        let distance = near + u * (far - near);
                        let map = rest_map(p, rests);
                        let normal = scan.gradient(rest(distance), map).normalize_or_zero();
                        if distance > OFFSET {
                            found.push(section.crossing((distance, normal), value, self.transfer));
                        }
                    }
                    continue;
                }
                let values = nodes.map(|v| self.section_value(section, v));
                let [front, back] = [near, far].map(|t| at(t, &values));
                if (front < 0.0) == (back < 0.0) {
                    continue;
                }
                let t = near + (far - near) * front / (front - back);
                if t <= OFFSET {
                    continue;
                }
                let scalar = match section.shape {
                    Shape::Plane(..) => at(t, &nodes.map(|v| self.scalars[v])),
                    Shape::Value(value) => value,
                };
                let flat: DVec3 = slopes.iter().zip(values).map(|(g, f)| *g * f).sum();
                let w = shares(t);
                let smooth: DVec3 = (0..4).map(|k| w[k] * self.gradients[nodes[k]]).sum();
                let is_smooth = matches!(section.shape, Shape::Value(_)) && smooth != DVec3::ZERO;
                let normal = if is_smooth { smooth } else { flat }.normalize_or_zero();
                found.push(section.crossing((t, normal), scalar, self.transfer));
            }
        }
        found
    }

    /// Returns the function whose zero is the surface, at a node.
    fn section_value(&self, section: &ReferenceSection, node: usize) -> f64 {
        match section.shape {
            Shape::Value(value) => self.scalars[node] - value,
            Shape::Plane(normal, offset, at_rest) => {
                let places = if at_rest { self.rests } else { self.nodes };
                normal.dot(places[node]) - offset
            }
        }
    }
}

/// Returns the range of t ≥ 0 in which all of start + t · rise are at least 0.
fn inside_range(starts: [f64; 4], rises: [f64; 4]) -> Option<[f64; 2]> {
    let mut range = [0.0f64, f64::INFINITY];
    for (start, rise) in starts.into_iter().zip(rises) {
        let t = -start / rise;
        match rise {
            r if r > 0.0 => range[0] = range[0].max(t),
            r if r < 0.0 => range[1] = range[1].min(t),
            _ if start < 0.0 => return None,
            _ => {}
        }
    }
    (range[0] < range[1]).then_some(range)
}
