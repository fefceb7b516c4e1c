//! The finer space in which the error of a solution is estimated: that of quadratic tets on the same
//! mesh for linear ones, and of each tet divided into eight for quadratic ones. It contains the
//! solution exactly.

use super::quadratic::{PIECES, TenNodes};
use super::quadratic_shape::shape_functions;
use super::{ElementOrder, TET_EDGES, TetMesh};
use crate::Result;
use glam::DVec3;

/// A mesh of order 2 whose space of shape functions contains that of a coarser mesh.
pub(crate) struct FinerSpace {
    /// The finer mesh. The nodes of the coarser mesh come first, in their order.
    pub mesh: TetMesh,
    /// Number of nodes of the coarser mesh.
    coarse_nodes: usize,
    /// First entry of each further node in `entries`, and their number.
    starts: Vec<usize>,
    /// Nodes of the coarser mesh, with the values of their shape functions at the further nodes.
    entries: Vec<(u32, f64)>,
}

/// The barycentric coordinates of the ten nodes of a tet: corners, then middles of edges.
fn node_coordinates() -> [[f64; 4]; 10] {
    let mut coordinates = [[0.0; 4]; 10];
    for (a, own) in coordinates.iter_mut().take(4).enumerate() {
        own[a] = 1.0;
    }
    for (own, edge) in coordinates[4..].iter_mut().zip(TET_EDGES) {
        edge.into_iter().for_each(|a| own[a] = 0.5);
    }
    coordinates
}

impl FinerSpace {
    /// Returns the finer space of bodies of `mesh`, of the order of the mesh.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the finer mesh would have too many nodes.
    pub fn new(mesh: &TetMesh) -> Result<FinerSpace> {
        match mesh.order {
            ElementOrder::Linear => Ok(FinerSpace::of_linear_tets(
                mesh,
                mesh.with_mid_edge_nodes()?,
            )),
            ElementOrder::Quadratic => FinerSpace::of_quadratic_tets(mesh),
        }
    }

    fn of_linear_tets(mesh: &TetMesh, finer: TetMesh) -> FinerSpace {
        let edges = mesh.edges();
        FinerSpace {
            mesh: finer,
            coarse_nodes: mesh.nodes.len(),
            starts: (0..=edges.len()).map(|edge| 2 * edge).collect(),
            entries: edges.as_flattened().iter().map(|v| (*v, 0.5)).collect(),
        }
    }

    fn of_quadratic_tets(mesh: &TetMesh) -> Result<FinerSpace> {
        let elements = mesh.ten_node_tets()?;
        let pieces = TetMesh {
            order: ElementOrder::Linear,
            ..mesh.clone()
        };
        let edges = pieces.edges();
        let mut values: Vec<Option<Vec<(u32, f64)>>> = vec![None; edges.len()];
        let coordinates = node_coordinates();
        for (nodes, group) in elements.iter().zip(mesh.tets.chunks(PIECES)) {
            for [a, b] in group
                .iter()
                .flat_map(|t| TET_EDGES.map(|e| e.map(|k| t[k])))
            {
                // Every edge of a piece is among them.
                let edge = edges.binary_search(&[a.min(b), a.max(b)]);
                let value = &mut values[edge.unwrap_or_default()];
                if value.is_none() {
                    *value = Some(values_between(nodes, &coordinates, [a, b]));
                }
            }
        }
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for value in values {
            entries.extend(value.unwrap_or_default());
            starts.push(entries.len());
        }
        let mut space = FinerSpace {
            mesh: pieces.with_mid_edge_nodes()?,
            coarse_nodes: mesh.nodes.len(),
            starts,
            entries,
        };
        // Curved edges stay curved.
        space.mesh.nodes = space.interpolate(&mesh.nodes);
        Ok(space)
    }

    /// Returns the vectors at the nodes of the finer mesh, given those at the nodes of the coarser
    /// one: the same function.
    pub fn interpolate(&self, coarse: &[DVec3]) -> Vec<DVec3> {
        let further = self.starts.windows(2).map(|range| {
            let entries = &self.entries[range[0]..range[1]];
            entries.iter().map(|(v, w)| *w * coarse[*v as usize]).sum()
        });
        coarse.iter().copied().chain(further).collect()
    }

    /// Returns the nodes of the finer mesh at which every function of the coarser space is 0 that is 0
    /// at the nodes `fixed` of the coarser mesh.
    pub fn fixed_nodes(&self, fixed: &[bool]) -> Vec<u32> {
        let old = (0..self.coarse_nodes).filter(|v| fixed[*v]);
        let further = self.starts.windows(2).enumerate().filter(|(_, range)| {
            let entries = &self.entries[range[0]..range[1]];
            !entries.is_empty() && entries.iter().all(|(v, _)| fixed[*v as usize])
        });
        let further = further.map(|(k, _)| self.coarse_nodes + k);
        old.chain(further).map(|v| v as u32).collect()
    }
}

/// Returns the values of the shape functions of a ten-node tet half-way between two of its nodes,
/// without zeros.
fn values_between(
    nodes: &TenNodes,
    coordinates: &[[f64; 4]; 10],
    ends: [u32; 2],
) -> Vec<(u32, f64)> {
    let mut l = [0.0; 4];
    for end in ends {
        let place = nodes.iter().position(|v| *v == end).unwrap_or_default();
        for (l, own) in l.iter_mut().zip(coordinates[place]) {
            *l += 0.5 * own;
        }
    }
    let values = nodes.iter().copied().zip(shape_functions(l));
    values.filter(|(_, value)| *value != 0.0).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;

    /// A mesh of order 2 with curved edges.
    fn curved() -> TetMesh {
        let bar = generate::bar([2, 1, 1], DVec3::new(1.0, 0.6, 0.5)).unwrap();
        let mut mesh = bar.with_mid_edge_nodes().unwrap();
        let bend = |p: DVec3| DVec3::new(p.x, p.y + 0.1 * p.x * p.x, p.z - 0.05 * p.x * p.y);
        mesh.nodes.iter_mut().for_each(|p| *p = bend(*p));
        mesh
    }

    #[test]
    fn finer_space_of_linear_tets_contains_them() {
        let mesh = generate::bar([2, 1, 1], DVec3::new(1.0, 0.6, 0.5)).unwrap();
        let space = FinerSpace::new(&mesh).unwrap();
        assert_eq!(space.interpolate(&mesh.nodes), space.mesh.nodes);
        assert_eq!(space.mesh.order, ElementOrder::Quadratic);
    }

    #[test]
    fn finer_space_of_quadratic_tets_contains_quadratic_functions() {
        let mesh = curved();
        let space = FinerSpace::new(&mesh).unwrap();
        let coarse = mesh.ten_node_tets().unwrap();
        let finer = space.mesh.ten_node_tets().unwrap();
        assert_eq!(finer.len(), PIECES * coarse.len());
        // A function of the coarse space with arbitrary values at its nodes.
        let wave = |v: usize| DVec3::new((v as f64).sin(), (3.0 * v as f64).cos(), 0.1 * v as f64);
        let values: Vec<DVec3> = (0..mesh.nodes.len()).map(wave).collect();
        let fine_values = space.interpolate(&values);
        let centre = shape_functions([0.25; 4]);
        let at_centre = |nodes: &TenNodes, values: &[DVec3]| -> DVec3 {
            let parts = nodes.iter().zip(centre);
            parts.map(|(v, n)| n * values[*v as usize]).sum()
        };
        let corners = node_coordinates();
        for (k, piece) in finer.iter().enumerate() {
            // The barycentric coordinates of the piece's centre in its element.
            let element = &coarse[k / PIECES];
            let mut l = [0.0; 4];
            for v in &piece[..4] {
                let place = element.iter().position(|own| own == v).unwrap();
                (0..4).for_each(|a| l[a] += 0.25 * corners[place][a]);
            }
            let parts = element.iter().zip(shape_functions(l));
            let expected: DVec3 = parts.map(|(v, n)| n * values[*v as usize]).sum();
            assert!(at_centre(piece, &fine_values).distance(expected) < 1e-13);
        }
        // A value at a further node that is off is seen.
        let mut wrong = fine_values;
        wrong[mesh.nodes.len()].x += 0.1;
        let differs = |(k, piece): (usize, &TenNodes)| {
            let right = space.interpolate(&values);
            let off = at_centre(piece, &wrong).distance(at_centre(piece, &right));
            k < finer.len() && off > 1e-6
        };
        assert!(finer.iter().enumerate().any(differs));
    }

    #[test]
    fn nodes_between_fixed_nodes_are_fixed() {
        for mesh in [
            curved(),
            generate::bar([2, 1, 1], DVec3::new(1.0, 0.6, 0.5)).unwrap(),
        ] {
            let space = FinerSpace::new(&mesh).unwrap();
            let fixed: Vec<bool> = mesh.nodes.iter().map(|p| p.x < 0.3).collect();
            let found = space.fixed_nodes(&fixed);
            // A function with arbitrary values at the free nodes is 0 at exactly these.
            let free = |(v, is): (usize, &bool)| match is {
                true => DVec3::ZERO,
                false => DVec3::splat(1.5 + (v as f64).sin()),
            };
            let values: Vec<DVec3> = fixed.iter().enumerate().map(free).collect();
            let fine = space.interpolate(&values);
            let zeros = (0..fine.len()).filter(|v| fine[*v] == DVec3::ZERO);
            assert_eq!(found, zeros.map(|v| v as u32).collect::<Vec<_>>());
            assert!(!found.is_empty() && found.len() < fine.len() / 2);
        }
    }
}
