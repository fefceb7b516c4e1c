//! Validation and repair of meshes.

use super::group_by::map_groups;
use super::{EdgeMiddles, Field, Location, TetMesh};
use crate::{Error, Result, parallel};
use glam::DVec3;

/// Repairs, drops and warnings from the construction of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RepairReport {
    /// Tets whose orientation was flipped.
    pub inverted_fixed: usize,
    /// Tets dropped for a repeated corner or zero volume.
    pub degenerate: usize,
    /// Tets dropped because they repeat the four nodes of an earlier one.
    pub repeated: usize,
    /// Nodes dropped because no tet uses them.
    pub unused_nodes: usize,
    /// Faces shared by more than two tets; they are left unconnected.
    pub overshared_faces: usize,
    /// Root mean square and maximum of the distances between its boundary and that of the scan or
    /// surface that it was meshed from, in file units; `None` where that is unknown.
    pub surface_distance: Option<[f64; 2]>,
    /// Descriptions of the above and the warnings of the reader.
    pub warnings: Vec<String>,
}

impl TetMesh {
    /// Builds a valid mesh from nodes, tets in any orientation, and fields.
    ///
    /// Inverted tets are flipped; tets with a repeated corner or a volume below the rounding error
    /// of f64, repeated tets, and nodes that no tet uses are dropped. All repairs are counted in
    /// [`TetMesh::repairs`], after the given `warnings`.
    ///
    /// # Errors
    /// An error for no tets, an index out of range, a non-finite coordinate of a used node, or a
    /// field whose length does not match.
    pub fn new(
        nodes: Vec<DVec3>,
        tets: Vec<[u32; 4]>,
        fields: Vec<Field>,
        warnings: Vec<String>,
    ) -> Result<TetMesh> {
        TetMesh::of_order(nodes, tets, fields, warnings, None)
    }

    /// As [`TetMesh::new`]; with `middles`, the nodes in the middle of edges, a mesh of order 2.
    pub(crate) fn of_order(
        nodes: Vec<DVec3>,
        tets: Vec<[u32; 4]>,
        fields: Vec<Field>,
        warnings: Vec<String>,
        middles: Option<EdgeMiddles>,
    ) -> Result<TetMesh> {
        let mut mesh = TetMesh {
            nodes,
            tets,
            fields: Vec::new(),
            repairs: RepairReport {
                warnings,
                ..RepairReport::default()
            },
            ..TetMesh::default()
        };
        for field in fields {
            mesh.set_field(field)?;
        }
        mesh.check_indices()?;
        mesh.drop_bad_tets();
        if mesh.tets.is_empty() {
            return Err(Error::Mesh(
                "no tetrahedron with non-zero volume; Palpate requires a volumetric mesh (mesh a \
                surface first with `palpate mesh`, TetGen or gmsh)"
                    .into(),
            ));
        }
        mesh.repairs.overshared_faces = super::topology::crowded_faces(&mesh.tets);
        if let Some(middles) = middles {
            mesh = mesh.with_edge_middles(middles)?;
        }
        mesh.drop_unused_nodes();
        mesh.describe_repairs();
        Ok(mesh)
    }

    fn check_indices(&self) -> Result<()> {
        if self.nodes.len() > u32::MAX as usize / 4 || self.tets.len() > u32::MAX as usize / 4 {
            return Err(Error::Mesh(format!(
                "mesh has {} nodes and {} tets; each must be at most {} (32-bit indices)",
                self.nodes.len(),
                self.tets.len(),
                u32::MAX / 4
            )));
        }
        for (t, tet) in self.tets.iter().enumerate() {
            for &v in tet {
                let Some(p) = self.nodes.get(v as usize) else {
                    return Err(Error::Mesh(format!(
                        "tet {t} refers to node {v}, but there are only {} nodes (counted from 0)",
                        self.nodes.len()
                    )));
                };
                if !p.is_finite() {
                    return Err(Error::Mesh(format!(
                        "node {v} (corner of tet {t}) must have finite coordinates, got {p}"
                    )));
                }
            }
        }
        Ok(())
    }

    fn drop_bad_tets(&mut self) {
        let volumes = parallel::map(self.tets.len(), |t| {
            let (key, odd) = sorted(self.tets[t]);
            let volume = certain_volume(key.map(|v| self.nodes[v as usize]));
            if odd { -volume } else { volume }
        });
        let mut keep: Vec<bool> = volumes.iter().map(|volume| *volume != 0.0).collect();
        self.repairs.degenerate = keep.iter().filter(|keep| !**keep).count();
        for t in self.repeats(&keep) {
            keep[t as usize] = false;
            self.repairs.repeated += 1;
        }
        let tets = self.tets.iter_mut().zip(&volumes).zip(&keep);
        for ((tet, volume), keep) in tets {
            if *keep && *volume < 0.0 {
                tet.swap(2, 3);
                self.repairs.inverted_fixed += 1;
            }
        }
        if keep.contains(&false) {
            retain_tuples(&mut self.tets, 1, &keep);
            for field in self
                .fields
                .iter_mut()
                .filter(|f| f.location == Location::Cell)
            {
                retain_tuples(&mut field.values, field.components, &keep);
            }
        }
    }

    /// Returns those tets of `keep` that repeat the nodes of an earlier one.
    fn repeats(&self, keep: &[bool]) -> Vec<u32> {
        let kept = self.tets.iter().enumerate().filter(|(t, _)| keep[*t]);
        let by_smallest = kept.map(|(t, tet)| {
            let [a, b, c, d] = sorted(*tet).0;
            (a, [b, c, d, t as u32])
        });
        map_groups(self.nodes.len(), by_smallest, |own, repeats| {
            let pairs = own.windows(2).filter(|w| w[0][..3] == w[1][..3]);
            repeats.extend(pairs.map(|w| w[1][3]));
        })
    }

    pub(super) fn drop_unused_nodes(&mut self) {
        let mut used = vec![false; self.nodes.len()];
        for &v in self.tets.iter().flatten() {
            used[v as usize] = true;
        }
        self.repairs.unused_nodes = used.iter().filter(|u| !**u).count();
        if self.repairs.unused_nodes == 0 {
            return;
        }
        let mut new_index = vec![0u32; self.nodes.len()];
        let mut next = 0;
        for (v, used) in used.iter().enumerate() {
            new_index[v] = next;
            next += u32::from(*used);
        }
        for v in self.tets.iter_mut().flatten() {
            *v = new_index[*v as usize];
        }
        retain_tuples(&mut self.nodes, 1, &used);
        for field in self
            .fields
            .iter_mut()
            .filter(|f| f.location == Location::Node)
        {
            retain_tuples(&mut field.values, field.components, &used);
        }
    }

    fn describe_repairs(&mut self) {
        let r = &mut self.repairs;
        let notes = [
            (r.inverted_fixed, "inverted tets flipped"),
            (
                r.degenerate,
                "tets with a repeated corner or zero volume dropped",
            ),
            (r.repeated, "duplicate tets dropped"),
            (r.unused_nodes, "unused nodes dropped"),
            (
                r.overshared_faces,
                "faces shared by more than two tets; treated as boundary",
            ),
        ];
        for (count, what) in notes {
            if count > 0 {
                r.warnings.push(format!("{count} {what}"));
            }
        }
    }
}

/// Sorts the nodes of a tet; also returns whether the permutation is odd.
fn sorted(mut tet: [u32; 4]) -> ([u32; 4], bool) {
    let mut odd = false;
    for (a, b) in [(0, 1), (2, 3), (0, 2), (1, 3), (1, 2)] {
        if tet[a] > tet[b] {
            tet.swap(a, b);
            odd = !odd;
        }
    }
    (tet, odd)
}

/// Returns six times the signed volume of a tet, or 0 if its sign is not certain in f64 arithmetic:
/// such a tet has no orientation. With the corners in a fixed order, a tet and its mirror image get
/// exactly opposite volumes.
fn certain_volume([p, a, b, c]: [DVec3; 4]) -> f64 {
    let (a, b, c) = (a - p, b - p, c - p);
    let determinant = a.dot(b.cross(c));
    let (a, b, c) = (a.abs(), b.abs(), c.abs());
    let size = a.x * (b.y * c.z + b.z * c.y)
        + a.y * (b.z * c.x + b.x * c.z)
        + a.z * (b.x * c.y + b.y * c.x);
    // Shewchuk's bound for orient3d is (7 + 56ε)ε, ε = 2⁻⁵³; twice that covers any order of the
    // corners.
    if determinant.abs() > 7.0 * f64::EPSILON * size {
        determinant
    } else {
        0.0
    }
}

/// Keeps the tuples of `width` items whose flag is set.
fn retain_tuples<T: Copy>(items: &mut Vec<T>, width: usize, keep: &[bool]) {
    let mut item = 0;
    items.retain(|_| {
        let kept = keep[item / width];
        item += 1;
        kept
    });
}
