//! A cylindrical block whose mesh has a disc on its top.

use crate::Result;
use crate::generate::FIVE;
use crate::mesh::{TetMesh, signed_volume};
use glam::{DVec2, DVec3};

/// A cylinder along z, below z = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Radius, m.
    pub radius: f64,
    /// Height, m.
    pub height: f64,
    /// Radius of the disc on its top, m.
    pub disc: f64,
}

/// Half of the side of the square in the middle of the disc, over the disc's radius.
const CORE: f64 = 0.45;

/// Ratio of the last layer of cells to the first, outwards from the disc and downwards.
const GROWTH: f64 = 3.0;

impl Block {
    /// Returns the block with about `cells` cells across half of the disc: a square
    /// of cells in its middle, rings of cells around it, and layers. The nodes of the disc's edge lie
    /// on its circle.
    ///
    /// # Errors
    /// As [`TetMesh::new`].
    pub fn mesh(&self, cells: usize) -> Result<TetMesh> {
        let (side, inner) = (cells, cells.div_ceil(2));
        let around = self.sections(side, inner, cells);
        let layers: Vec<f64> = (0..=cells)
            .map(|k| -self.height * graded(k, cells))
            .collect();
        let mut nodes = Vec::new();
        for z in &layers {
            nodes.extend(around.points.iter().map(|p| p.extend(*z)));
        }
        let mut tets = Vec::new();
        let count = around.points.len();
        for layer in 0..cells {
            for quad in &around.quads {
                let corner = |k: usize| {
                    let (v, is_odd) = quad[k % 4];
                    let level = layer + k / 4;
                    ((v + count * level) as u32, is_odd != (level % 2 == 1))
                };
                // Neighbouring cells are divided alike on their common face, by the parity of nodes.
                let first = usize::from(corner(0).1);
                for tet in FIVE {
                    let mut tet = tet.map(|k| corner(k ^ first).0);
                    let at = tet.map(|v| nodes[v as usize]);
                    if signed_volume(at) < 0.0 {
                        tet.swap(2, 3);
                    }
                    tets.push(tet);
                }
            }
        }
        TetMesh::new(nodes, tets, vec![], vec![])
    }

    /// Returns a layer of nodes and its cells.
    fn sections(&self, side: usize, inner: usize, outer: usize) -> Section {
        let mut points = Vec::new();
        let mut quads = Vec::new();
        let half = CORE * self.disc;
        for j in 0..=side {
            for i in 0..=side {
                let at = |k: usize| half * (2.0 * k as f64 / side as f64 - 1.0);
                points.push(DVec2::new(at(i), at(j)));
            }
        }
        let core = |i: usize, j: usize| i + j * (side + 1);
        for (i, j) in (0..side).flat_map(|j| (0..side).map(move |i| (i, j))) {
            let corners = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)];
            quads.push(corners.map(|(i, j)| (core(i, j), (i + j) % 2 == 1)));
        }
        // The nodes of the square's edge, anticlockwise, are the first ring.
        let length = 4 * side;
        let edge = |k: usize| {
            let along = k % side;
            match k / side {
                0 => (along, 0),
                1 => (side, along),
                2 => (side - along, side),
                _ => (0, side - along),
            }
        };
        let ring_node = |ring: usize, k: usize| {
            let (i, j) = edge(k % length);
            let v = match ring {
                0 => core(i, j),
                _ => (side + 1) * (side + 1) + (ring - 1) * length + k % length,
            };
            (v, (i + j + ring) % 2 == 1)
        };
        for ring in 1..=inner + outer {
            for k in 0..length {
                let (i, j) = edge(k);
                let from = points[core(i, j)];
                let angle = 0.25 * std::f64::consts::PI * (8.0 * k as f64 / length as f64 - 3.0);
                let out = DVec2::from_angle(angle);
                points.push(match ring.checked_sub(inner) {
                    None | Some(0) => from.lerp(self.disc * out, ring as f64 / inner as f64),
                    Some(n) => (self.disc + (self.radius - self.disc) * graded(n, outer)) * out,
                });
            }
            for k in 0..length {
                let corners = [(ring - 1, k), (ring - 1, k + 1), (ring, k), (ring, k + 1)];
                quads.push(corners.map(|(ring, k)| ring_node(ring, k)));
            }
        }
        Section { points, quads }
    }

    /// Moves the nodes in the middle of edges outside the disc, and of the disc's edge, onto circles.
    pub fn round(&self, mesh: &mut TetMesh) {
        for element in mesh.quadratic_elements().unwrap_or_default() {
            for (middle, [a, b]) in element[4..].iter().zip(crate::mesh::TET_EDGES) {
                let ends = [a, b].map(|k| mesh.nodes[element[k] as usize]);
                let radii = ends.map(|x| x.truncate().length());
                if radii.iter().all(|r| *r > (1.0 - 1e-9) * self.disc) {
                    let middle_node = &mut mesh.nodes[*middle as usize];
                    let chord = 0.5 * (ends[0] + ends[1]);
                    let radius = 0.5 * (radii[0] + radii[1]);
                    let on_circle = chord.truncate().normalize_or_zero() * radius;
                    *middle_node = on_circle.extend(chord.z);
                }
            }
        }
    }

    /// Whether a node is on the base.
    pub fn is_base(&self, x: DVec3) -> bool {
        x.z < -(1.0 - 1e-9) * self.height
    }

    /// Whether a node is on the disc.
    pub fn is_disc(&self, x: DVec3) -> bool {
        x.z > -1e-9 * self.height && x.truncate().length() < (1.0 + 1e-9) * self.disc
    }
}

/// Nodes of a layer, and the corners of its cells, each with its parity.
struct Section {
    points: Vec<DVec2>,
    quads: Vec<[(usize, bool); 4]>,
}

/// The place of layer `k` of `count`, from 0 to 1, with layers that grow by a constant factor.
fn graded(k: usize, count: usize) -> f64 {
    let place = |k: f64| GROWTH.powf(k / count as f64) - 1.0;
    place(k as f64) / place(count as f64)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::mesh::{BoundaryReport, QualityReport, Topology};

    #[test]
    fn block_is_closed_and_its_disc_is_round() {
        let block = Block {
            radius: 0.05,
            height: 0.04,
            disc: 0.02,
        };
        for cells in [1, 2, 4, 6] {
            let mesh = block.mesh(cells).unwrap();
            assert!((0..mesh.tets.len()).all(|t| mesh.tet_volume(t) > 0.0));
            let topology = Topology::new(&mesh);
            assert_eq!(BoundaryReport::new(&mesh, &topology).euler_number(), 2);
            assert_eq!(QualityReport::new(&mesh).slivers, 0);
            // Of a polygon of four sides for each cell.
            let angle = 0.5 * std::f64::consts::PI / cells as f64;
            let area = 2.0 * cells as f64 * angle.sin() * block.radius * block.radius;
            let volume: f64 = (0..mesh.tets.len()).map(|t| mesh.tet_volume(t)).sum();
            assert!(
                (volume / (area * block.height) - 1.0).abs() < 1e-12,
                "{volume}"
            );
            let edge = mesh.nodes.iter().filter(|x| {
                block.is_disc(**x) && x.truncate().length() > (1.0 - 1e-9) * block.disc
            });
            assert_eq!(edge.count(), 4 * cells);
            // Its mid-edge nodes make it round.
            let mut curved = mesh.with_mid_edge_nodes().unwrap();
            block.round(&mut curved);
            let edge = curved.nodes.iter().filter(|x| {
                block.is_disc(**x) && x.truncate().length() > (1.0 - 1e-9) * block.disc
            });
            assert_eq!(edge.count(), 8 * cells);
            assert!(
                curved
                    .folded_elements(&curved.ten_node_tets().unwrap())
                    .is_empty()
            );
        }
    }
}
