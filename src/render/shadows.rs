//! What dims the light on the inside, in float64: soft shadows of a light that stands, and of the
//! eye's light how much of the sky a place sees. The twin of `shaders/lib/shadow_grid.wgsl` and
//! `shaders/render/shadow_*.wgsl`.
//!
//! Extinction is strewn into a coarse grid over the body as it stands, and light is followed from
//! every node through it. It depends on the body and on what is seen of it, not on the camera.

use super::light::{GRADIENT_HALF_SATURATION, Light};
use super::sections::Sections;
use crate::mesh::TetMesh;
use glam::{DVec3, UVec3};

/// How dark it is where no light comes, where shadows are asked for without saying.
pub const DEFAULT_STRENGTH: f64 = 0.7;
/// An extent of the grid is at least this share of the largest.
const FLAT: f64 = 1.0 / 64.0;
/// Rounding makes no further cell.
const SLACK: f64 = 1e-3;
/// Fewest and most cells; between, as many as tets.
const CELLS: [u32; 2] = [4096, 65_536];
/// Points in each tet, where cells are as many.
const POINTS: u32 = 12;
/// Points of the largest tets.
const MOST_POINTS: f64 = 1024.0;
/// Directions to the sky, and around a light.
const AO_DIRECTIONS: u32 = 16;
const SHADOW_DIRECTIONS: u32 = 6;
/// How far the sky is looked for, over the largest extent of the body.
const AO_RADIUS: f64 = 0.3;
/// How far out of the surface that a node stands on light is looked for, in cells.
pub(super) const SURFACE_OFFSET: f64 = 2.0;
/// Steps at most towards the sky, and towards a light.
const MAX_MARCH_STEPS: [u32; 2] = [24, 256];
/// Half the angle under which a light is seen, as a tangent.
const LIGHT_CONE_TANGENT: f64 = 0.2;

/// How finely light is followed.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShadowResolution {
    pub cells: u32,
    pub points: u32,
}

impl ShadowResolution {
    /// For so many tets.
    pub fn of(tets: usize) -> ShadowResolution {
        let tets = u32::try_from(tets).unwrap_or(u32::MAX).max(1);
        let cells = tets.clamp(CELLS[0], CELLS[1]);
        let points = (POINTS * cells.div_ceil(tets)).min(8 * POINTS);
        let points = match tets > cells {
            true => (POINTS * cells / tets).max(1),
            false => points,
        };
        ShadowResolution { cells, points }
    }
}

/// The directions in which light is looked for.
#[derive(Clone, Debug)]
pub(super) struct LightDirections {
    /// Unit vectors.
    pub list: Vec<DVec3>,
    /// Steps of a cell along each.
    pub steps: u32,
    /// What all of them are over the light that is counted as all: the half that a flat surface
    /// sees of the sky is.
    pub normalisation: f64,
}

impl LightDirections {
    /// To `light`, among so many cells.
    pub fn to(light: Light, cells: u32) -> LightDirections {
        let Light::From(way) = light else {
            // Along a Fibonacci spiral.
            let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
            let list = (0..AO_DIRECTIONS).map(|k| {
                let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(AO_DIRECTIONS);
                let (sin, cos) = (turn * f64::from(k)).sin_cos();
                let r = (1.0 - z * z).sqrt();
                DVec3::new(r * cos, r * sin, z)
            });
            // The cells of a cube are as many a side.
            let steps = (AO_RADIUS * f64::from(cells).cbrt()).ceil() as u32;
            return LightDirections {
                list: list.collect(),
                steps: steps.clamp(1, MAX_MARCH_STEPS[0]),
                normalisation: 2.0,
            };
        };
        let axis = way.normalize_or_zero();
        let (u, v) = axis.any_orthonormal_pair();
        let around = (0..SHADOW_DIRECTIONS).map(|k| {
            let turn = std::f64::consts::TAU * f64::from(k) / f64::from(SHADOW_DIRECTIONS);
            let aside = turn.cos() * u + turn.sin() * v;
            (axis + LIGHT_CONE_TANGENT * aside).normalize_or_zero()
        });
        LightDirections {
            list: std::iter::once(axis).chain(around).collect(),
            steps: MAX_MARCH_STEPS[1],
            normalisation: 1.0,
        }
    }
}

/// The share of light that reaches a node of which no `share` of all comes.
fn brightness(share: f64, strength: f64) -> f64 {
    1.0 - strength * (1.0 - share.min(1.0))
}

/// Cubes over the bounds of a body.
struct ShadowGrid {
    low: DVec3,
    cell: f64,
    dims: UVec3,
    /// What each cell absorbs per unit of length.
    extinction: Vec<f64>,
}

impl ShadowGrid {
    fn over(positions: &[DVec3], cells: u32) -> ShadowGrid {
        let (low, high) = crate::mesh::bounds(positions);
        let largest = (high - low).max_element().max(1e-6);
        let extent = (high - low).max(DVec3::splat(FLAT * largest));
        let mut cell = (extent.element_product() / f64::from(cells)).cbrt();
        let dims = |cell: f64| (extent / cell - SLACK).ceil().as_uvec3();
        while dims(cell).element_product() > cells {
            cell *= 1.05;
        }
        let dims = dims(cell);
        ShadowGrid {
            low,
            cell,
            dims,
            extinction: vec![0.0; dims.element_product() as usize],
        }
    }

    /// The cell at a place in cells from `low`.
    fn at(&self, place: DVec3) -> Option<usize> {
        let k = place.floor();
        let dims = self.dims.as_dvec3();
        let within = k.cmpge(DVec3::ZERO).all() && k.cmplt(dims).all();
        within.then_some((k.x + dims.x * (k.y + dims.y * k.z)) as usize)
    }
}

/// The weights of the corners at point `i`: a sequence that fills the cube evenly, folded into a tet
/// (Rocchini and Cignoni 2000).
fn weights(i: u32) -> [f64; 4] {
    let [x, y, z] =
        [0.819_172_5, 0.671_043_6, 0.549_700_5].map(|step| (0.5 + f64::from(i) * step).fract());
    let (x, y) = match x + y > 1.0 {
        true => (1.0 - x, 1.0 - y),
        false => (x, y),
    };
    let [x, y, z] = if y + z > 1.0 {
        [x, 1.0 - z, 1.0 - x - y]
    } else if x + y + z > 1.0 {
        [1.0 - y - z, y, x + y + z - 1.0]
    } else {
        [x, y, z]
    };
    [x, y, z, 1.0 - x - y - z]
}

/// The share of light at every node of `mesh`, its nodes standing at `positions`, in any unit of
/// length, where shadows are so strong: 1 where all of it comes. `rest` is where the nodes rest, for
/// the planes of `inside` that are given there, and `gradients` those that light sees
/// ([`node_gradients`](super::node_gradients)); `extinction` tells, of a tet and the weights of its
/// corners, what is absorbed there per unit of length.
pub fn node_shadows(
    mesh: &TetMesh,
    [positions, rest, gradients]: [&[DVec3]; 3],
    light: Light,
    strength: f64,
    extinction: &dyn Fn(usize, [f64; 4]) -> f64,
    inside: &Sections,
) -> Vec<f64> {
    let ShadowResolution { cells, points } = ShadowResolution::of(mesh.tets.len());
    let mut grid = ShadowGrid::over(positions, cells);
    for (t, tet) in mesh.tets.iter().enumerate() {
        let p = tet.map(|v| positions[v as usize]);
        let r = tet.map(|v| rest[v as usize]);
        let cells_wide = crate::mesh::signed_volume(p).abs() / grid.cell.powi(3);
        // As many more as it is larger than a cell.
        let own = (f64::from(points) * cells_wide).min(MOST_POINTS).ceil() as u32;
        let own = own.max(points);
        let share = cells_wide / f64::from(own);
        // Other points in each tet: the same in all would beat with the cells.
        let first = (tet.iter().fold(0u32, |sum, v| sum.wrapping_add(*v)) & 255) * points;
        for i in first..first + own {
            let w = weights(i);
            let mixed = |q: &[DVec3; 4]| (0..4).map(|k| w[k] * q[k]).sum::<DVec3>();
            let place = mixed(&p);
            if inside.is_clipped(place, mixed(&r)) {
                continue;
            }
            if let Some(k) = grid.at((place - grid.low) / grid.cell) {
                grid.extinction[k] += share * extinction(t, w);
            }
        }
    }
    let ways = LightDirections::to(light, cells);
    let of_node = |(p, gradient): (&DVec3, &DVec3)| {
        // Cells out of the surface that it stands on, which would dim itself.
        let out = SURFACE_OFFSET * *gradient / gradient.length().max(GRADIENT_HALF_SATURATION);
        let start = (*p - grid.low) / grid.cell - out;
        let light = ways.list.iter().map(|way| {
            let cells = (1..=ways.steps).map_while(|k| grid.at(start + f64::from(k) * *way));
            let passed: f64 = cells.map(|k| grid.extinction[k]).sum();
            (-passed * grid.cell).exp()
        });
        let share = ways.normalisation * light.sum::<f64>() / ways.list.len() as f64;
        brightness(share, strength)
    };
    positions.iter().zip(gradients).map(of_node).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::mesh::{Topology, generate};

    #[test]
    fn points_lie_in_the_tet_and_are_spread_evenly() {
        let mut mean = [0.0; 4];
        for i in 0..400 {
            let w = weights(i);
            assert!(w.iter().all(|x| (-1e-12..=1.0).contains(x)), "{w:?}");
            assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            (0..4).for_each(|k| mean[k] += w[k] / 400.0);
        }
        assert!(mean.iter().all(|m| (m - 0.25).abs() < 0.01), "{mean:?}");
    }

    /// The gradients that light sees of a scalar that is the same everywhere.
    fn ends_only(mesh: &TetMesh) -> Vec<DVec3> {
        let same = vec![0.0; mesh.nodes.len()];
        super::super::node_gradients(mesh, &Topology::new(mesh), &mesh.nodes, &same, None)
    }

    #[test]
    fn what_looks_to_the_light_is_bright_and_what_lies_behind_the_body_is_dim() {
        let mesh = generate::by_name("box", Some(6000)).unwrap();
        let (low, high) = mesh.bounds();
        let size = (high - low).max_element();
        let dense = |_: usize, _: [f64; 4]| 5.0 / size;
        let plain = Sections::default();
        let gradients = ends_only(&mesh);
        let at = [&mesh.nodes[..], &mesh.nodes[..], &gradients[..]];
        let light = Light::From(DVec3::Z);
        let found = node_shadows(&mesh, at, light, 1.0, &dense, &plain);
        let mut top = 0;
        for (p, bright) in mesh.nodes.iter().zip(&found) {
            // A ray straight to the light passes as deep, but for a cell or two.
            let depth = 5.0 * (high.z - p.z) / size;
            let middle = (*p - low).min(high - *p).min_element() > 0.3 * size;
            if middle {
                assert!((depth + bright.ln()).abs() < 0.5, "{bright} {depth}");
            }
            if high.z - p.z < 1e-9 {
                top += 1;
                assert_eq!(*bright, 1.0);
            }
        }
        assert!(top > 50);
        // Of the sky a face sees half, an edge more, the middle next to nothing.
        let found = node_shadows(&mesh, at, Light::Head, 0.5, &|_, _| 200.0 / size, &plain);
        for (p, bright) in mesh.nodes.iter().zip(&found) {
            let near = (*p - low).min(high - *p);
            match near.min_element() {
                d if d > 0.2 * size => assert!(*bright < 0.51, "{bright}"),
                d if d < 1e-9 => assert!(*bright > 0.85, "{p} {bright}"),
                _ => {}
            }
        }
    }

    #[test]
    fn what_a_plane_cuts_off_dims_nothing() {
        let mesh = generate::by_name("box", Some(3000)).unwrap();
        let (low, high) = mesh.bounds();
        let middle = 0.5 * (low + high);
        let size = (high - low).max_element();
        let cut = Sections {
            planes: vec![super::super::Plane::clip(middle, DVec3::Z).at_rest()],
            ..Sections::default()
        };
        let gradients = ends_only(&mesh);
        let at = [&mesh.nodes[..], &mesh.nodes[..], &gradients[..]];
        let dense = |_: usize, _: [f64; 4]| 50.0 / size;
        let light = Light::From(DVec3::Z);
        let [whole, half] =
            [&Sections::default(), &cut].map(|i| node_shadows(&mesh, at, light, 1.0, &dense, i));
        let near = |p: &DVec3| (middle.z - p.z).abs() < 0.02 * size;
        let inner = |p: &DVec3| (p.truncate() - middle.truncate()).abs().max_element() < 0.2 * size;
        let mut seen = 0;
        for (k, p) in mesh.nodes.iter().enumerate() {
            if near(p) && inner(p) {
                seen += 1;
                assert!(whole[k] < 0.01 && half[k] > 0.5, "{} {}", whole[k], half[k]);
            }
        }
        assert!(seen > 3, "{seen}");
    }
}
