//! Soft shadows of a directional light and ambient occlusion of a headlight, in float64. Reference
//! of `shaders/lib/shadow_grid.wgsl` and `shaders/render/shadow_*.wgsl`.
//!
//! Extinction is splatted into a coarse grid over the current bounds of the body, and light is
//! marched through it from every node. The result depends on the body and its appearance, not on
//! the camera.

use super::Geometry;
use super::light::{GRADIENT_HALF_SATURATION, Light};
use super::sections::Sections;
use crate::mesh::TetMesh;
use glam::{DVec3, UVec3};

/// Minimum extent of the grid along an axis, relative to the largest extent.
const FLAT: f64 = 1.0 / 64.0;
/// Tolerance in cells, so that rounding does not add a cell.
const SLACK: f64 = 1e-3;
/// Minimum and maximum number of cells; in between, one per tet.
const CELLS: [u32; 2] = [4096, 65_536];
/// Sample points in each tet if there are as many cells as tets.
const POINTS: u32 = 12;
/// Maximum number of sample points in a large tet.
const MAX_GRID_POINTS: f64 = 1024.0;
/// Number of directions for ambient occlusion and for the cone of a directional light.
const AO_DIRECTIONS: u32 = 16;
const SHADOW_DIRECTIONS: u32 = 6;
/// Range of ambient occlusion, relative to the largest extent of the body.
const AO_RADIUS: f64 = 0.3;
/// Start offset of a ray outwards from the surface of the node, in cells.
pub(super) const SURFACE_OFFSET: f64 = 2.0;
/// Maximum number of steps for ambient occlusion and for shadow rays.
const MAX_MARCH_STEPS: [u32; 2] = [24, 256];
/// Tangent of half the angular size of the light.
const LIGHT_CONE_TANGENT: f64 = 0.2;

/// Resolution of the shadow computation.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShadowResolution {
    pub cells: u32,
    pub points: u32,
}

impl ShadowResolution {
    /// Returns the resolution for a mesh with `tets` tets.
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

/// Directions in which light is marched.
#[derive(Clone, Debug)]
pub(super) struct LightDirections {
    /// Unit vectors.
    pub list: Vec<DVec3>,
    /// Number of steps, of one cell each, along each direction.
    pub steps: u32,
    /// Number of directions over the light counted as full: for ambient occlusion, the half of the
    /// sky that a flat surface sees.
    pub normalisation: f64,
}

impl LightDirections {
    /// Returns the directions for `light` in a grid of `cells` cells.
    pub fn to(light: Light, cells: u32) -> LightDirections {
        let Light::From(way) = light else {
            // Fibonacci spiral.
            let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
            let list = (0..AO_DIRECTIONS).map(|k| {
                let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(AO_DIRECTIONS);
                let (sin, cos) = (turn * f64::from(k)).sin_cos();
                let r = (1.0 - z * z).sqrt();
                DVec3::new(r * cos, r * sin, z)
            });
            // Assumes a cubic grid.
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

/// Returns the brightness of a node that receives the fraction `share` of the light.
fn brightness(share: f64, strength: f64) -> f64 {
    1.0 - strength * (1.0 - share.min(1.0))
}

/// Grid of cubic cells over the bounds of a body.
struct ShadowGrid {
    low: DVec3,
    cell: f64,
    dims: UVec3,
    /// Extinction of each cell per unit of length.
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

    /// Returns the cell index at a position in cells from `low`.
    fn at(&self, place: DVec3) -> Option<usize> {
        let k = place.floor();
        let dims = self.dims.as_dvec3();
        let within = k.cmpge(DVec3::ZERO).all() && k.cmplt(dims).all();
        within.then_some((k.x + dims.x * (k.y + dims.y * k.z)) as usize)
    }
}

/// Returns the barycentric coordinates of point `i`: a low-discrepancy sequence in the cube, folded
/// into a tet (Rocchini and Cignoni 2000).
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

impl Geometry {
    /// Returns the fraction of light at every node of `mesh` with node positions `positions` (any unit
    /// of length) for shadows of the given strength; 1 is unshadowed. `rest` are the rest positions,
    /// for planes of `inside` fixed to the rest configuration, and `gradients` those used for lighting
    /// ([`Geometry::reference_node_gradients`]); `extinction` maps a tet and barycentric coordinates
    /// to the extinction per unit of length.
    pub fn reference_node_shadows(
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
            // Tets larger than a cell get proportionally more sample points.
            let samples = (f64::from(points) * cells_wide).min(MAX_GRID_POINTS).ceil() as u32;
            let samples = samples.max(points);
            let share = cells_wide / f64::from(samples);
            // Vary the points between tets: equal points would alias with the cells.
            let first = (tet.iter().fold(0u32, |sum, v| sum.wrapping_add(*v)) & 255) * points;
            for i in first..first + samples {
                let w = weights(i);
                let mixed = |q: &[DVec3; 4]| (0..4).map(|k| w[k] * q[k]).sum::<DVec3>();
                let position = mixed(&p);
                if inside.is_clipped(position, mixed(&r)) {
                    continue;
                }
                if let Some(k) = grid.at((position - grid.low) / grid.cell) {
                    grid.extinction[k] += share * extinction(t, w);
                }
            }
        }
        let ways = LightDirections::to(light, cells);
        let of_node = |(p, gradient): (&DVec3, &DVec3)| {
            // Start outside the surface of the node to avoid self-shadowing.
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
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;
    use crate::mesh::Topology;

    #[test]
    fn sample_points_are_inside_tet_and_uniform() {
        let mut mean = [0.0; 4];
        for i in 0..400 {
            let w = weights(i);
            assert!(w.iter().all(|x| (-1e-12..=1.0).contains(x)), "{w:?}");
            assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            (0..4).for_each(|k| mean[k] += w[k] / 400.0);
        }
        assert!(mean.iter().all(|m| (m - 0.25).abs() < 0.01), "{mean:?}");
    }

    /// Returns the gradients used for lighting of a constant scalar.
    fn ends_only(mesh: &TetMesh) -> Vec<DVec3> {
        let same = vec![0.0; mesh.nodes.len()];
        Geometry::reference_node_gradients(mesh, &Topology::new(mesh), &mesh.nodes, &same, None)
    }

    #[test]
    fn lit_side_is_bright_and_far_side_is_shadowed() {
        let mesh = generate::by_name("box", Some(6000)).unwrap();
        let (low, high) = mesh.bounds();
        let size = (high - low).max_element();
        let dense = |_: usize, _: [f64; 4]| 5.0 / size;
        let plain = Sections::default();
        let gradients = ends_only(&mesh);
        let at = [&mesh.nodes[..], &mesh.nodes[..], &gradients[..]];
        let light = Light::From(DVec3::Z);
        let found = Geometry::reference_node_shadows(&mesh, at, light, 1.0, &dense, &plain);
        let mut top = 0;
        for (p, bright) in mesh.nodes.iter().zip(&found) {
            // The optical depth of a ray straight to the light matches within one or two cells.
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
        // A face sees half of the sky, an edge more, the centre almost nothing.
        let found = Geometry::reference_node_shadows(
            &mesh,
            at,
            Light::Head,
            0.5,
            &|_, _| 200.0 / size,
            &plain,
        );
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
    fn clipped_half_casts_no_shadow() {
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
        let [whole, half] = [&Sections::default(), &cut]
            .map(|i| Geometry::reference_node_shadows(&mesh, at, light, 1.0, &dense, i));
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
