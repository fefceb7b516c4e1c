//! Taubin smoothing of surfaces.

use super::TriMesh;
use crate::parallel;
use glam::DVec3;
use rayon::slice::ParallelSliceMut;

/// The shrinking step λ, and the inflating step μ that restores large shapes.
const STEPS: [f64; 2] = [0.5, -0.53];

impl TriMesh {
    /// Returns this surface after `rounds` of Taubin's λ|μ smoothing (*A signal processing approach
    /// to fair surface design*, 1995), λ = 0.5, μ = −0.53: it removes steps of the size of voxels
    /// and preserves the volume. Vertices on open rims are fixed. Ten rounds remove the steps of a
    /// label surface.
    pub fn smoothed(&self, rounds: u32) -> TriMesh {
        let neighbours = Neighbours::new(self);
        let mut surface = self.clone();
        for step in (0..rounds).flat_map(|_| STEPS) {
            let places = &surface.vertices;
            surface.vertices = parallel::map(places.len(), |v| {
                let around = neighbours.of(v);
                if around.is_empty() {
                    return places[v];
                }
                let sum: DVec3 = around.iter().map(|n| places[*n as usize]).sum();
                places[v].lerp(sum / around.len() as f64, step)
            });
        }
        surface
    }
}

/// The edge neighbours of each vertex; none for fixed vertices.
struct Neighbours {
    /// Start of the neighbours of each vertex, and the end.
    starts: Vec<usize>,
    vertices: Vec<u32>,
}

impl Neighbours {
    fn new(surface: &TriMesh) -> Neighbours {
        // Each edge once for each of its triangles, in both directions.
        let mut pairs: Vec<[u32; 2]> = surface
            .triangles
            .iter()
            .flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
            .flat_map(|[a, b]| [[a, b], [b, a]])
            .collect();
        pairs.par_sort_unstable();
        let mut on_rim = vec![false; surface.vertices.len()];
        for same in pairs.chunk_by(|a, b| a == b) {
            on_rim[same[0][0] as usize] |= same.len() == 1;
        }
        pairs.dedup();
        pairs.retain(|[v, _]| !on_rim[*v as usize]);
        let mut starts = vec![0; surface.vertices.len() + 1];
        for [v, _] in &pairs {
            starts[*v as usize + 1] += 1;
        }
        for v in 1..starts.len() {
            starts[v] += starts[v - 1];
        }
        Neighbours {
            starts,
            vertices: pairs.into_iter().map(|[_, n]| n).collect(),
        }
    }

    fn of(&self, v: usize) -> &[u32] {
        &self.vertices[self.starts[v]..self.starts[v + 1]]
    }
}
