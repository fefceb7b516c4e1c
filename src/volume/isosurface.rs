//! Isosurfaces of volumes at full voxel resolution.

use super::Volume;
use super::cube_cases::CUBE_CASES;
use crate::mesh::{AnatomicalFrame, TriMesh};
use crate::parallel;
use crate::{Error, Result};
use glam::DVec3;

/// Minimum distance of a vertex from a voxel centre, in voxels, to avoid degenerate triangles.
const MIN_VERTEX_OFFSET: f64 = 1e-3;

/// Marks an edge of the grid without a vertex.
const NONE: u32 = u32::MAX;

impl Volume {
    /// Extracts the boundary of the points with values from `low` to `high`, in the world (RAS,
    /// mm); either may be infinite.
    ///
    /// Marching cubes (Lorensen & Cline 1987) between the centres of voxels, with values linear
    /// along the edges of that grid. Everything beyond the outermost voxels and NaN voxels is
    /// outside. The surface is closed, every edge belongs to two triangles, every vertex to one fan
    /// of them, and triangles face outward. The result is deterministic.
    ///
    /// # Errors
    /// An [`Error::Input`] for a range without voxels or without an inside, and for a surface of
    /// more vertices than 32 bits can count.
    pub fn isosurface(&self, low: f64, high: f64) -> Result<TriMesh> {
        if low.is_nan() || high.is_nan() || low > high {
            return Err(Error::Input(format!(
                "invalid value range {low} to {high}: the lower value must be at most the upper \
                value"
            )));
        }
        let surface = self.marching_cubes(|value| value, low, high)?;
        if surface.triangles.is_empty() {
            let range = match self.range() {
                Some((least, most)) => format!("values range from {least} to {most}"),
                None => "no value is finite".into(),
            };
            return Err(Error::Input(format!(
                "no voxel has a value from {low} to {high}; {range}"
            )));
        }
        Ok(surface)
    }

    /// Extracts the boundary of the voxels that have one of `labels`, in the world (RAS, mm),
    /// half-way between the centres of voxels inside and outside; otherwise as
    /// [`Volume::isosurface`].
    ///
    /// # Errors
    /// An [`Error::Input`] if no voxel has one of the labels, and for a surface of more vertices
    /// than 32 bits can count.
    pub fn label_surface(&self, labels: &[i64]) -> Result<TriMesh> {
        let is_in = |value: f64| labels.iter().any(|l| *l as f64 == value);
        let surface = self.marching_cubes(|value| f64::from(u8::from(is_in(value))), 0.5, 1.5)?;
        if surface.triangles.is_empty() {
            let there = match self.labels() {
                Some(there) => {
                    let names: Vec<String> = there.keys().take(20).map(|l| l.to_string()).collect();
                    format!("available labels: {}", names.join(", "))
                }
                None => "the volume is not a label map".into(),
            };
            return Err(Error::Input(format!(
                "no voxel has a label in {labels:?}; {there}"
            )));
        }
        Ok(surface)
    }

    /// Extracts the boundary of the points at which `value_of` the value is from `low` to `high`.
    fn marching_cubes(
        &self,
        value_of: impl Fn(f64) -> f64 + Sync,
        low: f64,
        high: f64,
    ) -> Result<TriMesh> {
        let grid = Grid {
            volume: self,
            value_of,
            window: (low, high),
            row: self.size[0] + 2,
            plane: (self.size[0] + 2) * (self.size[1] + 2),
        };
        let slabs = self.size[2] + 1;
        let vertices = parallel::map_coarse(slabs, |k| grid.vertices(k));
        let mut first = Vec::with_capacity(vertices.len() + 1);
        let mut count = 0usize;
        for (_, slab) in &vertices {
            first.push(count as u32);
            count += slab.len();
            if count >= NONE as usize {
                return Err(Error::Input(
                    "surface exceeds the range of 32-bit vertex indices; crop or downsample the \
                    volume"
                        .into(),
                ));
            }
        }
        // The last plane, entirely outside, has no vertices.
        first.push(count as u32);
        let mirrored = self.to_world.matrix3.determinant() < 0.0;
        let triangles = parallel::map_coarse(slabs, |k| {
            let start = [first[k], first[k] + vertices[k].0 as u32, first[k + 1]];
            grid.triangles(k, start, mirrored)
        });
        Ok(TriMesh {
            vertices: vertices.into_iter().flat_map(|(_, slab)| slab).collect(),
            triangles: triangles.concat(),
            frame: Some(AnatomicalFrame::Ras),
            ..TriMesh::default()
        })
    }
}

/// A volume with a layer of outside voxels around it. Slab k lies between planes k and k + 1; its
/// vertices are those in plane k, then those between the planes.
struct Grid<'a, F> {
    volume: &'a Volume,
    value_of: F,
    window: (f64, f64),
    /// Number of points in a row of a plane.
    row: usize,
    /// Number of points in a plane.
    plane: usize,
}

/// The vertices on the edges along i and j of a plane, two per point.
type PlaneNumbers = Vec<[u32; 2]>;

impl<F: Fn(f64) -> f64 + Sync> Grid<'_, F> {
    fn is_inside(&self, value: f64) -> bool {
        self.window.0 <= value && value <= self.window.1
    }

    /// Returns the values in plane k, row by row; those around the volume are NaN.
    fn load(&self, k: usize) -> Vec<f64> {
        let mut values = vec![f64::NAN; self.plane];
        let [ni, nj, nk] = self.volume.size;
        if (1..=nk).contains(&k) {
            for j in 0..nj {
                let from = ((k - 1) * nj + j) * ni;
                let to = (j + 1) * self.row + 1;
                for (i, value) in values[to..to + ni].iter_mut().enumerate() {
                    *value = (self.value_of)(self.volume.value(from + i));
                }
            }
        }
        values
    }

    /// Returns the end of the range along an edge from an inside to an outside point, as a
    /// fraction.
    fn crossing(&self, inside: f64, outside: f64) -> f64 {
        let (low, high) = self.window;
        let bound = if outside < low { low } else { high };
        let t = (bound - inside) / (outside - inside);
        match t.is_nan() {
            true => 0.5,
            false => t.clamp(MIN_VERTEX_OFFSET, 1.0 - MIN_VERTEX_OFFSET),
        }
    }

    /// Returns the vertex on the edge along `axis` from point `n` of plane `k`, if there is one.
    fn vertex(&self, k: usize, n: usize, axis: usize, [a, b]: [f64; 2]) -> Option<DVec3> {
        let part = match (self.is_inside(a), self.is_inside(b)) {
            (true, false) => self.crossing(a, b),
            (false, true) => 1.0 - self.crossing(b, a),
            _ => return None,
        };
        let mut index = DVec3::new((n % self.row) as f64, (n / self.row) as f64, k as f64);
        index[axis] += part;
        Some(self.volume.to_world.transform_point3(index - 1.0))
    }

    /// Returns the vertices of slab `k`, and the number of them in its plane.
    fn vertices(&self, k: usize) -> (usize, Vec<DVec3>) {
        let [low, high] = [k, k + 1].map(|k| self.load(k));
        let mut vertices = Vec::new();
        for n in 0..self.plane {
            for (axis, step) in [1, self.row].into_iter().enumerate() {
                if let Some(end) = low.get(n + step) {
                    vertices.extend(self.vertex(k, n, axis, [low[n], *end]));
                }
            }
        }
        let in_plane = vertices.len();
        for n in 0..self.plane {
            vertices.extend(self.vertex(k, n, 2, [low[n], high[n]]));
        }
        (in_plane, vertices)
    }

    /// Numbers the vertices in a plane with these values, starting at `next`.
    fn plane_numbers(&self, values: &[f64], mut next: u32) -> PlaneNumbers {
        let crossed = |n: usize, step: usize| {
            let end = values.get(n + step);
            end.is_some_and(|end| self.is_inside(values[n]) != self.is_inside(*end))
        };
        (0..self.plane)
            .map(|n| [1, self.row].map(|step| number(crossed(n, step), &mut next)))
            .collect()
    }

    /// Returns the triangles of slab `k`; `start` holds the numbers of the first vertex in its
    /// plane, of the first above it, and of the first in the next plane.
    fn triangles(&self, k: usize, start: [u32; 3], mirrored: bool) -> Vec<[u32; 3]> {
        let [low, high] = [k, k + 1].map(|k| self.load(k));
        let planes = [
            self.plane_numbers(&low, start[0]),
            self.plane_numbers(&high, start[2]),
        ];
        let mut next = start[1];
        let upright: Vec<u32> = low
            .iter()
            .zip(&high)
            .map(|(a, b)| number(self.is_inside(*a) != self.is_inside(*b), &mut next))
            .collect();
        let mut triangles = Vec::new();
        for n in 0..self.plane - self.row {
            if n % self.row + 1 == self.row {
                continue;
            }
            let at = |corner: usize| n + (corner & 1) + (corner >> 1 & 1) * self.row;
            let mut case = 0;
            for corner in 0..8 {
                let plane = if corner < 4 { &low } else { &high };
                case |= usize::from(self.is_inside(plane[at(corner)])) << corner;
            }
            let vertex = |edge: u8| {
                let (axis, corner) = (usize::from(edge / 8), usize::from(edge % 8));
                match axis {
                    2 => upright[at(corner)],
                    _ => planes[corner >> 2][at(corner)][axis],
                }
            };
            for triangle in &CUBE_CASES[case] {
                let [a, b, c] = triangle.map(vertex);
                triangles.push(if mirrored { [a, c, b] } else { [a, b, c] });
            }
        }
        triangles
    }
}

/// Returns the next number if `there` is true.
fn number(there: bool, next: &mut u32) -> u32 {
    match there {
        true => {
            *next += 1;
            *next - 1
        }
        false => NONE,
    }
}
