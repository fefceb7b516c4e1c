//! Interpolation of node values of one mesh at points of another.

use super::{TetMesh, Topology, TriangleBvh, bounds, signed_volume};
use crate::parallel;
use crate::{Error, Result};
use glam::{DVec3, UVec3};

/// Barycentric interpolation of node values of a mesh at given points: transfers positions and
/// velocities between bodies of the same shape and different resolution.
///
/// A point inside has the barycentric weights of its tet; a point outside extrapolates from the tet
/// at the nearest boundary face, with weights beyond 0 and 1.
#[derive(Clone, Debug)]
pub struct BarycentricMap {
    nodes: usize,
    /// For each point: four nodes and their weights, of sum 1.
    shares: Vec<([u32; 4], [f64; 4])>,
}

/// Tets per cell of the search grid.
const TETS_A_CELL: f64 = 4.0;
/// Maximum number of cells along an axis.
const MAX_CELLS: f64 = 256.0;
/// Weights down to this count as on a face.
const ON_FACE: f64 = -1e-9;

impl BarycentricMap {
    /// Prepares the interpolation from the nodes of `mesh`, at rest, to `points`. Tets with zero
    /// volume are skipped.
    ///
    /// # Errors
    /// An [`Error::Mesh`] if no tet on the boundary has a volume; an [`Error::Input`] for a point
    /// with non-finite coordinates.
    pub fn new(mesh: &TetMesh, points: &[DVec3]) -> Result<BarycentricMap> {
        if let Some(bad) = points.iter().position(|p| !p.is_finite()) {
            return Err(Error::Input(format!(
                "point {bad} must have finite coordinates, got {}",
                points[bad]
            )));
        }
        let topology = Topology::new(mesh);
        let (faces, triangles): (Vec<u32>, Vec<[DVec3; 3]>) = topology
            .boundary
            .iter()
            .filter(|face| mesh.tet_volume(face.tet as usize) > 0.0)
            .map(|face| {
                let corners = topology.boundary_nodes(mesh, *face);
                (face.tet, corners.map(|v| mesh.nodes[v as usize]))
            })
            .unzip();
        if faces.is_empty() {
            return Err(Error::Mesh(
                "cannot interpolate from this mesh: all tets on its boundary have zero volume"
                    .into(),
            ));
        }
        let (tree, grid) = (TriangleBvh::new(triangles), Grid::new(mesh));
        let share = |n: usize| {
            let p = points[n];
            let outside = || tree.nearest(p).map_or(0, |(f, _)| faces[f]);
            let tet = grid.tet_at(mesh, p).unwrap_or_else(outside);
            (mesh.tets[tet as usize], weights(mesh, tet, p))
        };
        Ok(BarycentricMap {
            nodes: mesh.nodes.len(),
            shares: parallel::map(points.len(), share),
        })
    }

    /// Returns the interpolation from a mesh of so many `nodes` with known source nodes and weights.
    pub(crate) fn from_weights(nodes: usize, shares: Vec<([u32; 4], [f64; 4])>) -> BarycentricMap {
        BarycentricMap { nodes, shares }
    }

    /// Returns, for each point, its four source nodes and their weights, of sum 1.
    pub fn source_weights(&self) -> &[([u32; 4], [f64; 4])] {
        &self.shares
    }

    /// Applies the transpose of [`BarycentricMap::apply`]: distributes `forces` at the points to
    /// the nodes, with the same resultant and the same work.
    ///
    /// # Errors
    /// An [`Error::Input`] for a wrong number of forces.
    pub fn apply_transpose(&self, forces: &[DVec3]) -> Result<Vec<DVec3>> {
        if forces.len() != self.shares.len() {
            return Err(Error::Input(format!(
                "got {} forces for {} points; give one force per point",
                forces.len(),
                self.shares.len()
            )));
        }
        let mut gathered = vec![DVec3::ZERO; self.nodes];
        for ((nodes, weights), force) in self.shares.iter().zip(forces) {
            for (v, w) in nodes.iter().zip(weights) {
                gathered[*v as usize] += *w * *force;
            }
        }
        Ok(gathered)
    }

    /// Interpolates `values` at the nodes to the points.
    ///
    /// # Errors
    /// An [`Error::Input`] for a wrong number of values.
    pub fn apply(&self, values: &[DVec3]) -> Result<Vec<DVec3>> {
        if values.len() != self.nodes {
            return Err(Error::Input(format!(
                "got {} values for {} nodes; give one value per node",
                values.len(),
                self.nodes
            )));
        }
        let at = |(nodes, weights): &([u32; 4], [f64; 4])| {
            let parts = nodes.iter().zip(weights);
            parts.map(|(v, w)| *w * values[*v as usize]).sum()
        };
        Ok(self.shares.iter().map(at).collect())
    }
}

/// Returns the barycentric weights of `p` in tet `t`, of sum 1.
fn weights(mesh: &TetMesh, t: u32, p: DVec3) -> [f64; 4] {
    let corners = mesh.tet_nodes(t as usize);
    let volume = signed_volume(corners);
    let [a, b, c] = [1, 2, 3].map(|k| {
        let mut part = corners;
        part[k] = p;
        signed_volume(part) / volume
    });
    [1.0 - a - b - c, a, b, c]
}

/// The tets that overlap each cell of a regular grid.
struct Grid {
    low: DVec3,
    cell: DVec3,
    size: UVec3,
    tets: Vec<Vec<u32>>,
}

impl Grid {
    fn new(mesh: &TetMesh) -> Grid {
        let (low, high) = bounds(&mesh.nodes);
        let extent = (high - low).max(DVec3::splat(f64::MIN_POSITIVE));
        let side = (extent.to_array().iter().product::<f64>() * TETS_A_CELL
            / mesh.tets.len().max(1) as f64)
            .cbrt();
        let size = (extent / side).clamp(DVec3::ONE, DVec3::splat(MAX_CELLS));
        let size = size.as_uvec3();
        let mut grid = Grid {
            low,
            cell: extent / size.as_dvec3(),
            size,
            tets: vec![Vec::new(); size.element_product() as usize],
        };
        for t in 0..mesh.tets.len() {
            if mesh.tet_volume(t) > 0.0 {
                let (low, high) = bounds(&mesh.tet_nodes(t));
                let (first, last) = (grid.cell_at(low), grid.cell_at(high));
                for z in first.z..=last.z {
                    for y in first.y..=last.y {
                        for x in first.x..=last.x {
                            let cell = grid.index(UVec3::new(x, y, z));
                            grid.tets[cell].push(t as u32);
                        }
                    }
                }
            }
        }
        grid
    }

    fn cell_at(&self, p: DVec3) -> UVec3 {
        let cell = ((p - self.low) / self.cell).floor().max(DVec3::ZERO);
        cell.as_uvec3().min(self.size - 1)
    }

    fn index(&self, cell: UVec3) -> usize {
        (cell.x + self.size.x * (cell.y + self.size.y * cell.z)) as usize
    }

    /// Returns the first tet that contains `p`.
    fn tet_at(&self, mesh: &TetMesh, p: DVec3) -> Option<u32> {
        let inside = |t: &&u32| weights(mesh, **t, p).iter().all(|w| *w >= ON_FACE);
        let cell = self.index(self.cell_at(p));
        self.tets[cell].iter().find(inside).copied()
    }
}
