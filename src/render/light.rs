//! Lighting of the volume: gradients at the nodes and their shading, in float64; reference of
//! `shaders/render/node_gradients.wgsl` and `shaders/lib/shade.wgsl`.

use super::Geometry;
use crate::mesh::{FACES, NO_NEIGHBOUR, TetMesh, Topology, group_by_key};
use crate::{Error, Result, parallel};
use glam::DVec3;
use std::str::FromStr;

/// Coefficients of ambient, diffuse and specular light, and the exponent of the specular term.
const AMBIENT: f64 = 0.4;
const DIFFUSE: f64 = 0.7;
const SPECULAR: f64 = 0.22;
const SHININESS: i32 = 32;
/// Gradient length with half lighting, in scalar ranges per body size.
pub(in crate::render) const GRADIENT_HALF_SATURATION: f64 = 2.0;
/// Gradient length assigned to the boundary of the body or between regions.
pub(super) const BOUNDARY_GRADIENT: f64 = 12.0;

/// Light source of the volume.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Light {
    /// No lighting: the colours of the transfer function are used unchanged.
    #[default]
    None,
    /// Headlight at the eye.
    Head,
    /// Directional light: direction from the body towards the light, in file coordinates.
    From(DVec3),
}

impl Light {
    /// Whether lighting is enabled.
    pub fn is_on(self) -> bool {
        self != Light::None
    }

    pub(super) fn check(self) -> Result<()> {
        match self {
            Light::From(way) if !(way.is_finite() && way.length() > 0.0) => Err(Error::Input(
                format!("light direction must be finite and not zero, got {way}"),
            )),
            _ => Ok(()),
        }
    }

    /// Returns the unit direction towards the light, and w = 1 for a headlight.
    pub(super) fn to_gpu(self) -> [f32; 4] {
        match self {
            Light::None => [0.0; 4],
            Light::Head => [0.0, 0.0, 0.0, 1.0],
            Light::From(way) => way.normalize_or_zero().as_vec3().extend(0.0).to_array(),
        }
    }
}

impl FromStr for Light {
    type Err = Error;

    /// Parses `none`, `head`, or a direction `x,y,z`.
    fn from_str(text: &str) -> Result<Light> {
        let numbers: Vec<f64> = text
            .split(',')
            .map_while(|t| t.trim().parse().ok())
            .collect();
        let light = match (text, numbers.as_slice()) {
            ("none", _) => Light::None,
            ("head", _) => Light::Head,
            (_, [x, y, z]) if text.split(',').count() == 3 => Light::From(DVec3::new(*x, *y, *z)),
            _ => {
                return Err(Error::Input(format!(
                    "unknown light \"{text}\"; use head, none, or a direction x,y,z towards it"
                )));
            }
        };
        light.check()?;
        Ok(light)
    }
}

/// Incidence lists of the nodes, from which gradients are computed.
pub(super) struct NodeIncidence {
    /// Start of the list of each node in `items`, followed by the total length.
    pub firsts: Vec<u32>,
    /// Incident tets of each node if the scalars are at the nodes; and incident `boundary_faces`,
    /// with indices offset by the number of tets.
    pub items: Vec<u32>,
    /// Faces on the boundary of the body or of a region: three nodes, oriented so that the normal
    /// points inwards or to the region with the larger value, and `NO_NEIGHBOUR`.
    pub boundary_faces: Vec<[u32; 4]>,
}

impl NodeIncidence {
    /// Builds the lists. With `cells`, regions are sets of tets with equal values; without, the
    /// scalars are at the nodes. `place` maps tets to their indices in the lists.
    pub fn new(
        mesh: &TetMesh,
        topology: &Topology,
        cells: Option<&[f64]>,
        place: impl Fn(usize) -> u32 + Copy,
    ) -> NodeIncidence {
        let boundary_faces = parallel::collect(mesh.tets.len(), |range, ends| {
            for t in range {
                let (tet, across) = (mesh.tets[t], topology.neighbours[t]);
                for (face, code) in FACES.iter().zip(across) {
                    let [a, b, c] = face.map(|k| tet[k]);
                    if code == NO_NEIGHBOUR {
                        ends.push([a, c, b, NO_NEIGHBOUR]);
                    } else if let Some(cells) = cells
                        && cells[t] < cells[code as usize / 4]
                    {
                        ends.push([a, b, c, NO_NEIGHBOUR]);
                    }
                }
            }
        });
        let shaded = mesh.tets.iter().filter(|_| cells.is_none()).enumerate();
        let tets = shaded.flat_map(move |(t, tet)| tet.map(|v| (v, place(t))));
        let faces = (mesh.tets.len() as u32..).zip(&boundary_faces);
        let faces = faces.flat_map(|(item, [a, b, c, _])| [*a, *b, *c].map(|v| (v, item)));
        let (firsts, items) = group_by_key(mesh.nodes.len(), tets.chain(faces));
        NodeIncidence {
            firsts,
            items,
            boundary_faces,
        }
    }
}

impl Geometry {
    /// Returns the gradient used for lighting at every node of `mesh` with node positions `positions`
    /// (local units): the volume-weighted mean of the tet gradients of `shares` (node scalars
    /// normalised to their range), plus, at boundaries, the direction into the body or between regions.
    pub fn reference_node_gradients(
        mesh: &TetMesh,
        topology: &Topology,
        positions: &[DVec3],
        shares: &[f64],
        cells: Option<&[f64]>,
    ) -> Vec<DVec3> {
        let around = NodeIncidence::new(mesh, topology, cells, |t| t as u32);
        let of_node = |v: usize| {
            let (mut rise, mut volume) = (DVec3::ZERO, 0.0);
            let (mut area, mut areas) = (DVec3::ZERO, 0.0);
            let incident = around.firsts[v] as usize..around.firsts[v + 1] as usize;
            for item in &around.items[incident] {
                let item = match (*item as usize).checked_sub(mesh.tets.len()) {
                    None => mesh.tets[*item as usize],
                    Some(end) => around.boundary_faces[end],
                };
                let p = positions[item[0] as usize];
                let edge = |k: usize| positions[item[k] as usize] - p;
                let (a, b) = (edge(1), edge(2));
                if item[3] == NO_NEIGHBOUR {
                    area += a.cross(b);
                    areas += a.cross(b).length();
                    continue;
                }
                let c = edge(3);
                let more = |k: usize| shares[item[k] as usize] - shares[item[0] as usize];
                rise += more(1) * b.cross(c) + more(2) * c.cross(a) + more(3) * a.cross(b);
                volume += a.dot(b.cross(c));
            }
            let mut gradient = DVec3::ZERO;
            if volume.abs() > 1e-20 {
                gradient = rise / volume;
            }
            if areas > 0.0 {
                gradient += BOUNDARY_GRADIENT / areas * area;
            }
            gradient
        };
        (0..mesh.nodes.len()).map(of_node).collect()
    }
}

impl Light {
    /// Returns the shading of a gradient for a ray with unit direction `ray`: the factor on colours and
    /// the specular term, which is added in proportion to opacity (Blinn 1977, after Phong).
    pub fn shade(self, gradient: DVec3, ray: DVec3) -> [f64; 2] {
        let steep = gradient.length();
        shade_by(
            self,
            gradient,
            ray,
            steep / (steep + GRADIENT_HALF_SATURATION),
        )
    }

    /// As [`Light::shade`], for a surface perpendicular to the gradient, independent of the gradient's length.
    pub fn shade_surface(self, gradient: DVec3, ray: DVec3) -> [f64; 2] {
        shade_by(self, gradient, ray, 1.0)
    }
}

fn shade_by(light: Light, gradient: DVec3, ray: DVec3, weight: f64) -> [f64; 2] {
    let towards = match light {
        Light::None => return [1.0, 0.0],
        Light::Head => -ray,
        Light::From(way) => way.normalize_or_zero(),
    };
    let steep = gradient.length();
    if steep < 1e-6 {
        return [1.0, 0.0];
    }
    let n = gradient / steep;
    let facing = n.dot((towards - ray).normalize_or_zero()).abs();
    let diffuse = AMBIENT + DIFFUSE * n.dot(towards).abs();
    [
        1.0 + weight * (diffuse - 1.0),
        SPECULAR * weight * facing.powi(SHININESS),
    ]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;

    #[test]
    fn linear_field_gradient_is_exact_and_boundary_gradient_points_inwards() {
        let mesh = generate::by_name("box", Some(2000)).unwrap();
        let topology = Topology::new(&mesh);
        let (low, high) = mesh.bounds();
        let slope = DVec3::new(1.0, -2.0, 0.5);
        let shares: Vec<f64> = mesh.nodes.iter().map(|p| p.dot(slope)).collect();
        let found =
            Geometry::reference_node_gradients(&mesh, &topology, &mesh.nodes, &shares, None);
        for (p, g) in mesh.nodes.iter().zip(&found) {
            let depth = (*p - low).min(high - *p);
            let inside = depth.min_element() > 1e-9;
            let face = (0..3).filter(|k| depth[*k] < 1e-9).count() == 1;
            if inside {
                assert!(g.distance(slope) < 1e-9, "{g}");
            } else if face {
                let middle = 0.5 * (low + high);
                let end = *g - slope;
                assert!(
                    (end.length() / BOUNDARY_GRADIENT - 1.0).abs() < 1e-9,
                    "{end}"
                );
                assert!(end.dot(middle - *p) > 0.0);
            }
        }
    }

    #[test]
    fn light_parses_valid_and_rejects_invalid_text() {
        assert_eq!("head".parse::<Light>().unwrap(), Light::Head);
        assert_eq!("none".parse::<Light>().unwrap(), Light::None);
        let from: Light = "1, 0,-2".parse().unwrap();
        assert_eq!(from, Light::From(DVec3::new(1.0, 0.0, -2.0)));
        for wrong in ["", "sun", "1,2", "1,2,x", "0,0,0", "1,2,3,4"] {
            let error = wrong.parse::<Light>().unwrap_err().to_string();
            assert!(error.contains("light"), "{error}");
        }
    }

    #[test]
    fn shading_is_two_sided_and_brightest_facing_light() {
        let ray = DVec3::NEG_Z;
        let [faced, shine] = Light::Head.shade(DVec3::Z * 50.0, ray);
        let [behind, _] = Light::Head.shade(DVec3::NEG_Z * 50.0, ray);
        let [across, none] = Light::Head.shade(DVec3::X * 50.0, ray);
        assert_eq!(faced, behind);
        assert!(faced > 1.0 && across < 0.5 && shine > 0.1 && none < 1e-9);
        assert_eq!(Light::Head.shade(DVec3::ZERO, ray), [1.0, 0.0]);
        assert_eq!(Light::None.shade(DVec3::Z, ray), [1.0, 0.0]);
        let [flat, _] = Light::Head.shade(DVec3::X * 0.01, ray);
        assert!(flat > 0.99);
        // Light from behind has no half vector.
        assert!(Light::shade(Light::From(DVec3::NEG_Z), DVec3::Z, ray)[1] == 0.0);
    }
}
