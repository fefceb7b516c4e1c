//! Interpolation of volumes between voxels, and sampling at the nodes of meshes.

use super::Volume;
use crate::mesh::{Field, Location, ScalarType, TET_EDGES, TetMesh};
use crate::parallel;
use glam::DVec3;

/// Maximum number of samples along each axis of the cell of a node.
const MAX_SAMPLES: usize = 9;

impl Volume {
    /// Returns the trilinear value at `p` in the world; outside the outermost voxel centres, `p` is
    /// clamped.
    pub fn sample(&self, p: DVec3) -> f64 {
        self.at_index(self.to_world.inverse().transform_point3(p))
    }

    /// Returns the trilinear value at voxel coordinates `x`.
    pub(crate) fn at_index(&self, x: DVec3) -> f64 {
        let last = DVec3::from(self.size.map(|n| n as f64 - 1.0));
        let x = x.clamp(DVec3::ZERO, last);
        let below = x.floor();
        let part = (x - below).to_array();
        let low = below.to_array().map(|b| b as usize);
        let mut sum = 0.0;
        for corner in 0..8 {
            let mut weight = 1.0;
            let mut n = 0;
            for axis in (0..3).rev() {
                let up = corner >> axis & 1;
                weight *= if up == 1 {
                    part[axis]
                } else {
                    1.0 - part[axis]
                };
                n = n * self.size[axis] + (low[axis] + up).min(self.size[axis] - 1);
            }
            if weight > 0.0 {
                sum += weight * self.value(n);
            }
        }
        sum
    }

    /// Samples the volume at the nodes of `mesh`, in the world, as a node field `name`.
    ///
    /// A node represents its cell: a cube whose side is the mean length of its edges. If that is at
    /// most a voxel, the value is trilinear at the node, otherwise the mean over the cube, so that
    /// a coarse mesh shows the surroundings of its nodes, not single voxels.
    pub fn onto_nodes(&self, mesh: &TetMesh, name: &str) -> Field {
        let to_index = self.to_world.inverse();
        let spacing = self.spacing();
        let sides = node_sides(mesh);
        let values = parallel::map(mesh.nodes.len(), |v| {
            let samples = (sides[v] / spacing).to_array().map(samples_along);
            let count = samples.iter().product::<usize>();
            let middle = to_index.transform_point3(mesh.nodes[v]);
            // The field is written as 32-bit numbers.
            let written = |value: f64| f64::from(value as f32);
            if count == 1 {
                return written(self.at_index(middle));
            }
            // The cube is aligned with the voxel axes.
            let step = DVec3::splat(sides[v]) / spacing / DVec3::from(samples.map(|n| n as f64));
            let mut sum = 0.0;
            for n in 0..count {
                let at = [
                    n % samples[0],
                    n / samples[0] % samples[1],
                    n / samples[0] / samples[1],
                ];
                let shift: [f64; 3] = std::array::from_fn(|axis| {
                    at[axis] as f64 - 0.5 * (samples[axis] as f64 - 1.0)
                });
                sum += self.at_index(middle + step * DVec3::from(shift));
            }
            written(sum / count as f64)
        });
        Field {
            scalar_type: ScalarType::F32,
            ..Field::scalar(name, Location::Node, values)
        }
    }
}

/// Returns the number of samples along an axis on which the cell of a node measures `voxels`.
fn samples_along(voxels: f64) -> usize {
    (voxels.ceil().max(1.0) as usize).min(MAX_SAMPLES)
}

/// Returns the mean length of the edges at each node.
fn node_sides(mesh: &TetMesh) -> Vec<f64> {
    let mut sums = vec![(0.0, 0u32); mesh.nodes.len()];
    for tet in &mesh.tets {
        for [a, b] in TET_EDGES {
            let [a, b] = [tet[a] as usize, tet[b] as usize];
            let length = mesh.nodes[a].distance(mesh.nodes[b]);
            for v in [a, b] {
                sums[v].0 += length;
                sums[v].1 += 1;
            }
        }
    }
    sums.iter()
        .map(|(sum, count)| sum / f64::from((*count).max(1)))
        .collect()
}
