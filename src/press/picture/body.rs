//! The body of a press picture: its boundary behind the cut, and the cut face with its regions.

use super::raster::{Kind, Raster, Surfel};
use super::view::View;
use glam::DVec3;

/// Edges of a tet.
const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// A body to be drawn: its mesh at rest and deformed, and its boundary triangles with their tets.
pub(super) struct Body<'a> {
    pub rest: &'a [DVec3],
    pub nodes: &'a [DVec3],
    pub tets: &'a [[u32; 4]],
    pub faces: &'a [([u32; 3], u32)],
    /// Region of each tet.
    pub regions: &'a [u16],
    /// Colour of each region.
    pub colours: &'a [[f32; 3]],
    /// Colour of the boundary; that of the regions if `None`.
    pub skin: Option<[f32; 3]>,
}

/// Values at the nodes whose isolines are drawn on the cut, and their distance.
pub(super) struct Isolines<'a> {
    pub values: &'a [f64],
    pub spacing: f64,
}

/// The plane of a cut; what its normal points to is removed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cut {
    pub point: DVec3,
    pub normal: DVec3,
}

impl Cut {
    /// Returns the signed distance of a point, positive where the body is removed.
    pub fn distance(&self, p: DVec3) -> f64 {
        (p - self.point).dot(self.normal)
    }
}

impl Body<'_> {
    /// Returns unit normals at the nodes of the boundary.
    pub fn normals(&self) -> Vec<DVec3> {
        let mut normals = vec![DVec3::ZERO; self.nodes.len()];
        for (face, _) in self.faces {
            let [a, b, c] = face.map(|v| self.nodes[v as usize]);
            let area = (b - a).cross(c - a);
            face.iter().for_each(|v| normals[*v as usize] += area);
        }
        normals.iter().map(|n| n.normalize_or_zero()).collect()
    }

    /// Draws the boundary, behind `cut` if there is one.
    pub fn draw_boundary(&self, raster: &mut Raster, view: &View, cut: Option<&Cut>) {
        let normals = self.normals();
        for (face, tet) in self.faces {
            let x = face.map(|v| self.nodes[v as usize]);
            let beyond = cut.map(|cut| x.map(|p| cut.distance(p)));
            if beyond.is_some_and(|d| d.iter().all(|d| *d > 0.0)) {
                continue;
            }
            let colour = match self.skin {
                Some(colour) => colour,
                None => self.colours[usize::from(self.regions[*tet as usize])],
            };
            let corners = face.map(|v| normals[v as usize]);
            raster.triangle(view, x, |w| {
                let removed =
                    beyond.is_some_and(|d| (0..3).map(|k| w[k] * d[k]).sum::<f64>() > 0.0);
                let normal = (0..3).map(|k| w[k] * corners[k]).sum::<DVec3>();
                (!removed).then(|| Surfel {
                    kind: Kind::Skin,
                    colour,
                    normal: normal.normalize_or(DVec3::Z),
                })
            });
        }
    }

    /// Draws the cut face, with the colours of its regions, and isolines if there are any.
    pub fn draw_cut(&self, raster: &mut Raster, view: &View, cut: &Cut, lines: Option<&Isolines>) {
        let distances: Vec<f64> = self.nodes.iter().map(|p| cut.distance(*p)).collect();
        for (t, tet) in self.tets.iter().enumerate() {
            let d = tet.map(|v| distances[v as usize]);
            if d.iter().all(|d| *d > 0.0) || d.iter().all(|d| *d <= 0.0) {
                continue;
            }
            let region = self.regions[t];
            let colour = self.colours[usize::from(region)];
            let corners: Vec<[f64; 4]> = ordered(d);
            let point = |w: &[f64; 4]| {
                (0..4)
                    .map(|k| w[k] * self.nodes[tet[k] as usize])
                    .sum::<DVec3>()
            };
            for k in 2..corners.len() {
                let of = [corners[0], corners[k - 1], corners[k]];
                let x = of.map(|w| point(&w));
                let values = lines.map(|lines| {
                    let at = |w: [f64; 4]| -> f64 {
                        (0..4).map(|k| w[k] * lines.values[tet[k] as usize]).sum()
                    };
                    (of.map(at), lines.spacing)
                });
                raster.triangle(view, x, |w| {
                    let band = values.map(|(values, spacing)| {
                        let value: f64 = (0..3).map(|c| w[c] * values[c]).sum();
                        (value / spacing).floor().clamp(0.0, 200.0) as u16
                    });
                    Some(Surfel {
                        kind: Kind::Cut(region, band.unwrap_or(0)),
                        colour,
                        normal: cut.normal,
                    })
                });
            }
        }
    }

    /// Returns the outline of the body at rest in the plane of `cut`, as segments.
    pub fn outline_at_rest(&self, cut: &Cut) -> Vec<[DVec3; 2]> {
        let mut segments = Vec::new();
        for (face, _) in self.faces {
            let x = face.map(|v| self.rest[v as usize]);
            let d = x.map(|p| cut.distance(p));
            let crossing = [[0, 1], [1, 2], [2, 0]]
                .into_iter()
                .filter(|[i, j]| (d[*i] > 0.0) != (d[*j] > 0.0))
                .map(|[i, j]| x[i].lerp(x[j], d[i] / (d[i] - d[j])));
            if let [a, b] = crossing.collect::<Vec<_>>()[..] {
                segments.push([a, b]);
            }
        }
        segments
    }
}

/// Returns the corners of the section of a tet with signed distances `d`, in order around it, as
/// weights of the tet's corners.
fn ordered(d: [f64; 4]) -> Vec<[f64; 4]> {
    let crossed = EDGES.iter().filter(|[i, j]| (d[*i] > 0.0) != (d[*j] > 0.0));
    let mut corners: Vec<([usize; 2], [f64; 4])> = crossed
        .map(|[i, j]| {
            let share = d[*i] / (d[*i] - d[*j]);
            let mut weights = [0.0; 4];
            (weights[*i], weights[*j]) = (1.0 - share, share);
            ([*i, *j], weights)
        })
        .collect();
    // Of four corners, those on opposite edges of the tet are opposite.
    if corners.len() == 4 && corners[1].0.iter().all(|v| !corners[2].0.contains(v)) {
        corners.swap(2, 3);
    }
    corners.into_iter().map(|(_, weights)| weights).collect()
}
