//! Distribution of a total over a region: an even traction on the body's surface there.

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
    /// the integrals of their shape functions; equal shares if there are no such faces. The shares
    /// sum to 1.
    pub fn shares(&self, nodes: &[u32]) -> Vec<f64> {
        let mut area_of = vec![None; self.mesh.nodes.len()];
        nodes.iter().for_each(|v| area_of[*v as usize] = Some(0.0));
        for face in &self.faces {
            if face.iter().any(|v| area_of[*v as usize].is_none()) {
                continue;
            }
            let [a, b, c]: [DVec3; 3] = face.map(|v| self.mesh.nodes[v as usize]);
            let area = 0.5 * (b - a).cross(c - a).length();
            let shares = traction_shares(face.map(|v| self.middles[v as usize]));
            for (v, share) in face.iter().zip(shares) {
                if let Some(sum) = &mut area_of[*v as usize] {
                    *sum += share * area;
                }
            }
        }
        let areas: Vec<f64> = nodes.iter().filter_map(|v| area_of[*v as usize]).collect();
        let total: f64 = areas.iter().sum();
        match total > 0.0 {
            true => areas.iter().map(|area| area / total).collect(),
            false => vec![1.0 / nodes.len() as f64; nodes.len()],
        }
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
        let mesh = generate::bar([2, 2, 2], DVec3::ONE).unwrap();
        assert_eq!(EvenTraction::new(&mesh).shares(&[0, 5]), [0.5, 0.5]);
    }
}
