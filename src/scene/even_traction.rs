//! Distribution of a total over a region: an even traction on the body's surface or edges there.

use crate::mesh::{TetMesh, Topology, traction_shares};
use glam::DVec3;

/// Faces of a body's boundary, and its mid-edge nodes.
pub(super) struct EvenTraction<'a> {
    mesh: &'a TetMesh,
    faces: Vec<[u32; 3]>,
    middles: Vec<bool>,
}

impl<'a> EvenTraction<'a> {
    pub fn new(mesh: &'a TetMesh) -> EvenTraction<'a> {
        EvenTraction {
            faces: Topology::new(mesh).boundary_triangles(mesh),
            middles: mesh.mid_edge_nodes(),
            mesh,
        }
    }

    /// Returns the share of each of `nodes` in an even traction on the boundary faces between them,
    /// the integrals of their shape functions; on the edges of the boundary if there are no such
    /// faces, and equal shares if there are no such edges. The shares sum to 1.
    pub fn shares(&self, nodes: &[u32]) -> Vec<f64> {
        let mut is_in = vec![false; self.mesh.nodes.len()];
        nodes.iter().for_each(|v| is_in[*v as usize] = true);
        let is_inside = |nodes: &[u32]| nodes.iter().all(|v| is_in[*v as usize]);
        let normalised = |sizes: &[f64]| -> Option<Vec<f64>> {
            let of_nodes = nodes.iter().map(|v| sizes[*v as usize]);
            let total: f64 = of_nodes.clone().sum();
            (total > 0.0).then(|| of_nodes.map(|size| size / total).collect())
        };
        let faces = self.faces.iter().filter(|face| is_inside(*face));
        let on_faces = normalised(&self.areas(faces));
        let on_edges = || normalised(&self.lengths(is_inside));
        on_faces
            .or_else(on_edges)
            .unwrap_or_else(|| vec![1.0 / nodes.len() as f64; nodes.len()])
    }

    /// Returns the area of `faces` by node.
    fn areas<'f>(&self, faces: impl Iterator<Item = &'f [u32; 3]>) -> Vec<f64> {
        let mut areas = vec![0.0; self.mesh.nodes.len()];
        for face in faces {
            let [a, b, c]: [DVec3; 3] = face.map(|v| self.mesh.nodes[v as usize]);
            let area = 0.5 * (b - a).cross(c - a).length();
            let shares = traction_shares(face.map(|v| self.middles[v as usize]));
            for (v, share) in face.iter().zip(shares) {
                areas[*v as usize] += share * area;
            }
        }
        areas
    }

    /// Returns the length of the chosen edges of the boundary by node. Half an edge of a ten-node
    /// tet gives a third of its length to the corner, two thirds to the middle: its shape functions
    /// integrate to 1/6, 2/3 and 1/6.
    fn lengths(&self, is_chosen: impl Fn(&[u32]) -> bool) -> Vec<f64> {
        let sides = self
            .faces
            .iter()
            .flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]);
        let mut edges: Vec<[u32; 2]> = sides
            .filter(|edge| is_chosen(edge))
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let mut lengths = vec![0.0; self.mesh.nodes.len()];
        for edge in edges {
            let [a, b] = edge.map(|v| self.mesh.nodes[v as usize]);
            let middles = edge.map(|v| self.middles[v as usize]);
            for (v, is_middle) in edge.into_iter().zip(middles) {
                let share = match (middles[0] == middles[1], is_middle) {
                    (true, _) => 0.5,
                    (false, true) => 2.0 / 3.0,
                    (false, false) => 1.0 / 3.0,
                };
                lengths[v as usize] += share * a.distance(b);
            }
        }
        lengths
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;

    #[test]
    fn end_of_bar_is_loaded_evenly_whatever_the_mesh() {
        for cells in [[2, 2, 2], [2, 3, 1]] {
            let mesh = generate::bar(cells, DVec3::new(1.0, 0.4, 0.2)).unwrap();
            for mesh in [mesh.with_mid_edge_nodes().unwrap(), mesh] {
                let high = mesh.bounds().1.x - 1e-9;
                let end = (0..mesh.nodes.len() as u32).filter(|v| mesh.nodes[*v as usize].x > high);
                let end: Vec<u32> = end.collect();
                let shares = EvenTraction::new(&mesh).shares(&end);
                assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                // The resultant acts at the middle of the end, and a linear weight is integrated
                // exactly.
                let of_nodes = end.iter().zip(&shares);
                let at: DVec3 = of_nodes.map(|(v, s)| *s * mesh.nodes[*v as usize]).sum();
                let (low, high) = mesh.bounds();
                let middle = DVec3::new(high.x, 0.5 * (low.y + high.y), 0.5 * (low.z + high.z));
                assert!(at.distance(middle) < 1e-12, "{at} {middle}");
            }
        }
    }

    #[test]
    fn line_and_points_are_loaded_evenly() {
        let mesh = generate::bar([2, 2, 1], DVec3::new(1.0, 0.4, 0.2)).unwrap();
        for mesh in [mesh.with_mid_edge_nodes().unwrap(), mesh] {
            let (low, high) = mesh.bounds();
            let is_on = |p: DVec3| p.x > high.x - 1e-9 && p.z > high.z - 1e-9;
            let line = (0..mesh.nodes.len() as u32).filter(|v| is_on(mesh.nodes[*v as usize]));
            let line: Vec<u32> = line.collect();
            let shares = EvenTraction::new(&mesh).shares(&line);
            let of_nodes = || line.iter().zip(&shares);
            let y = |v: &u32| mesh.nodes[*v as usize].y;
            assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let middle: f64 = of_nodes().map(|(v, s)| s * y(v)).sum();
            assert!((middle - 0.5 * (low.y + high.y)).abs() < 1e-12);
            let at_end = of_nodes().find(|(v, _)| y(v) < low.y + 1e-9);
            let wanted = if line.len() > 3 { 1.0 / 12.0 } else { 0.25 };
            assert!((at_end.unwrap().1 - wanted).abs() < 1e-12);
        }
        let mesh = generate::bar([2, 2, 2], DVec3::ONE).unwrap();
        assert_eq!(EvenTraction::new(&mesh).shares(&[0, 26]), [0.5, 0.5]);
    }
}
