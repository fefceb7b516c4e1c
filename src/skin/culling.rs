//! Culling of skin triangles by their base nodes, in float64: the CPU reference of
//! `shaders/skin/cull_base.wgsl` and `shaders/skin/cull.wgsl`.
//!
//! A triangle is certainly back-facing if all normals that it is bound to face away by more than
//! its tilt against them. A tilt by an angle a at rest and a strain s, the ratio of the largest to
//! the smallest stretch, give a tilt of at most 2 atan(s tan(a / 2)).

use super::basis::{VertexBinding, interpolated_normal};
use crate::render::{Camera, Projection};
use glam::DVec3;
use std::collections::HashMap;

/// Upper bounds of strain and of bend stretch (which must stay below 1).
const MAX_STRAIN: f64 = 1e6;
const MAX_CURVATURE: f64 = 0.999;
/// 90° plus a margin, in radians.
const BACKFACE_ANGLE: f64 = std::f64::consts::FRAC_PI_2 + 0.035;

/// Tilt of a triangle that is culled only outside the view.
const NEVER_CULL: f64 = 1e20;
/// Assumed upper bound of the stretch that moves vertices beyond the border of their triangle.
const RIM_STRETCH: f64 = 2.0;
/// Triangles are degenerate if their squared area is below this fraction of an edge's fourth power.
const NO_AREA: f64 = 1e-20;

/// A base triangle and the data of the vertices bound to it, at rest; lengths in any one unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CullBase {
    /// Its nodes.
    pub nodes: [u32; 3],
    /// Largest offset of a vertex from the triangle.
    pub offset: f64,
    /// Inverse of the metric tensor (Gram matrix of the edges) at rest: (xx, xy, yy) for the edges
    /// from the first node to the second and to the third.
    pub inverse: [f64; 3],
    /// Relative stretch of offset vertices along each side, caused by the rotation of the normals:
    /// offset times curvature.
    pub bend_stretch: [f64; 3],
    /// Whether a vertex is bound in an interpolated basis.
    pub smooth: bool,
    /// Whether a vertex is bound in the basis of the triangle.
    pub flat: bool,
}

impl CullBase {
    /// Creates the data of the triangle `rest` with `normals` at its nodes and vertices up to
    /// `offset` away; `smooth` and `flat` are false.
    pub fn new(nodes: [u32; 3], rest: [DVec3; 3], normals: [DVec3; 3], offset: f64) -> CullBase {
        let (u, v) = (rest[1] - rest[0], rest[2] - rest[0]);
        let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
        let det = uu * vv - uv * uv;
        CullBase {
            nodes,
            offset,
            inverse: [vv / det, -uv / det, uu / det],
            bend_stretch: bends(rest, normals, offset),
            smooth: false,
            flat: false,
        }
    }
}

/// Returns offset times curvature along each side of the triangle `p` with normals `n`.
fn bends(p: [DVec3; 3], n: [DVec3; 3], offset: f64) -> [f64; 3] {
    [0, 1, 2].map(|k| {
        let next = (k + 1) % 3;
        let side = p[next] - p[k];
        let curvature = (n[next] - n[k]).dot(side) / side.length_squared().max(1e-30);
        (offset * curvature).clamp(-MAX_CURVATURE, MAX_CURVATURE)
    })
}

fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// Orientation of a base triangle relative to the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseVisibility {
    /// Lower bound of the angle between the direction to the eye and the normals that vertices are
    /// bound to, over the whole region; −1 if a node has no normal.
    pub angle: f64,
    /// Strain of the vertices bound to it.
    pub strain: f64,
}

impl BaseVisibility {
    /// Computes the visibility data of `base` from `camera`, for the given node positions and
    /// `normals`.
    pub fn new(
        base: &CullBase,
        nodes: &[DVec3],
        normals: &[Option<DVec3>],
        camera: &Camera,
    ) -> BaseVisibility {
        let p = base.nodes.map(|i| nodes[i as usize]);
        let n = base.nodes.map(|i| normals[i as usize]);
        let (u, v) = (p[1] - p[0], p[2] - p[0]);
        let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
        let [xx, xy, yy] = base.inverse;
        let trace = xx * uu + 2.0 * xy * uv + yy * vv;
        let det = (xx * yy - xy * xy) * (uu * vv - uv * uv);
        let largest = 0.5 * (trace + (trace * trace - 4.0 * det).max(0.0).sqrt());
        let smallest = det / largest.max(1e-30);
        let stretch = (largest.max(1.0) / smallest.clamp(1e-12, 1.0)).sqrt();
        let known = n.map(|n| n.unwrap_or(DVec3::ZERO));
        let now = bends(p, known, base.offset);
        let mut bent: f64 = 1.0;
        for (now, rest) in now.iter().zip(base.bend_stretch) {
            for side in [1.0, -1.0] {
                let ratio = (1.0 + side * now) / (1.0 + side * rest);
                bent = bent.max(ratio).max(1.0 / ratio);
            }
        }
        let strain = stretch * bent;
        let longest = uu.max(vv).max((v - u).length_squared()).sqrt();
        let reach = base.offset + longest;
        let least = (0..3).map(|k| {
            let (to_eye, aside) = match camera.projection {
                Projection::Orthographic { .. } => (camera.eye - camera.look_at, 0.0),
                Projection::Perspective { .. } => {
                    let to_eye = camera.eye - p[k];
                    (to_eye, (reach / to_eye.length()).min(1.0).asin())
                }
            };
            let smooth = if base.smooth {
                angle(known[k], to_eye)
            } else {
                4.0
            };
            let flat = if base.flat {
                angle(u.cross(v), to_eye)
            } else {
                4.0
            };
            smooth.min(flat) - aside
        });
        let least = least.fold(f64::INFINITY, f64::min);
        BaseVisibility {
            angle: if n.contains(&None) { -1.0 } else { least },
            strain: strain.min(MAX_STRAIN),
        }
    }

    /// Whether a triangle of a closed opaque skin is certainly back-facing: `tilt` is the tangent of
    /// half the largest rest angle between its normal and those that its vertices are bound to,
    /// `outlooks` are those of their base triangles. The eye is outside.
    pub fn is_skipped(tilt: f64, outlooks: [BaseVisibility; 3]) -> bool {
        let least = outlooks.iter().fold(f64::INFINITY, |m, o| m.min(o.angle));
        let strain = outlooks.iter().fold(0.0, |m: f64, o| m.max(o.strain));
        least > BACKFACE_ANGLE + 2.0 * (strain * tilt).atan()
    }
}

/// Culling data of a skin at rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CullData {
    /// Base triangles that vertices are bound to.
    pub bases: Vec<CullBase>,
    /// For each triangle, the base triangles of its vertices, and the tangent of half the largest
    /// angle between its normal and those that its vertices are bound to.
    pub triangles: Vec<([u32; 3], f64)>,
}

impl CullData {
    /// Computes the data of the triangles `corners`, whose vertices are `bound` to nodes at the
    /// rest positions `nodes` with `normals`. A degenerate triangle, or one with a vertex without a
    /// normal, is never culled as back-facing.
    pub fn new(
        nodes: &[DVec3],
        normals: &[Option<DVec3>],
        bound: &[VertexBinding],
        corners: &[[u32; 3]],
    ) -> CullData {
        let (own, offsets) = stand_off(nodes, bound);
        let bases = offsets.iter().map(|(of, offset)| {
            let rest = of.map(|i| nodes[i as usize]);
            let n = of.map(|i| normals[i as usize].unwrap_or_default());
            CullBase::new(*of, rest, n, *offset)
        });
        let mut bases: Vec<CullBase> = bases.collect();
        for (b, own) in bound.iter().zip(&own) {
            let base = &mut bases[*own as usize];
            base.smooth |= b.interpolated;
            base.flat |= !b.interpolated;
        }
        // Rest positions as the mapping reproduces them, and the normals that the vertices are
        // bound to.
        let carried = bound.iter().map(|b| {
            let p = b.nodes.map(|i| nodes[i as usize]);
            let face = (p[1] - p[0]).cross(p[2] - p[0]);
            let smooth = interpolated_normal(b.weights, b.nodes.map(|i| normals[i as usize]));
            let normal = if b.interpolated { smooth } else { face };
            (b.skin(nodes, normals).position, normal.try_normalize())
        });
        let carried: Vec<(DVec3, Option<DVec3>)> = carried.collect();
        let tilt = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| carried[v as usize].0);
            let normal = (b - a).cross(c - a);
            let edge = (b - a).length_squared().max((c - a).length_squared());
            if normal.length_squared() <= NO_AREA * edge * edge {
                return NEVER_CULL;
            }
            let half = t.map(|v| match carried[v as usize].1 {
                Some(carries) => (0.5 * angle(normal, carries)).tan(),
                None => NEVER_CULL,
            });
            half.into_iter().fold(0.0, f64::max).min(NEVER_CULL)
        };
        CullData {
            bases,
            triangles: corners
                .iter()
                .map(|t| (t.map(|v| own[v as usize]), tilt(t)))
                .collect(),
        }
    }
}

/// Returns the base triangle index of each vertex, and the base triangles with the largest offset
/// of a vertex from each.
fn stand_off(nodes: &[DVec3], bound: &[VertexBinding]) -> (Vec<u32>, Vec<([u32; 3], f64)>) {
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    let mut offsets: Vec<([u32; 3], f64)> = Vec::new();
    let own = bound.iter().map(|b| {
        let mut key = b.nodes;
        key.sort_unstable();
        let own = *known.entry(key).or_insert_with(|| {
            offsets.push((b.nodes, 0.0));
            offsets.len() as u32 - 1
        });
        let p = b.nodes.map(|i| nodes[i as usize]);
        let sides = [0, 1, 2].map(|k| p[k].distance(p[(k + 1) % 3]));
        let longest = sides.into_iter().fold(0.0, f64::max);
        let beyond = b.weights.iter().fold(0.0, |m: f64, w| m.max(-w));
        let most = &mut offsets[own as usize].1;
        *most = most.max(b.offset.length() + 2.0 * RIM_STRETCH * beyond * longest);
        own
    });
    (own.collect(), offsets)
}
