//! Tetrahedral meshes: nodes, tets, fields; topology, quality.
//!
//! This module is independent of files and of the GPU.

mod anatomical_frame;
mod bisection;
mod blade;
mod boundary;
mod bvh;
mod cut;
mod edge_face_intersection;
mod edge_middles;
mod field;
mod finer_space;
mod frame;
mod fringe;
mod group_by;
mod length_unit;
mod merge;
mod mesh_report;
mod order;
mod packed_normal;
mod partition;
mod quadratic;
mod quadratic_elements;
mod quadratic_shape;
mod quality;
mod region_field;
mod region_shares;
mod region_surface;
mod repair;
mod same_connectivity;
mod smooth;
mod smooth_regions;
mod sorted_list;
mod split_interface;
mod surface_report;
mod topology;
mod transfer;
mod tri_mesh;
mod triangle_bvh;

pub use anatomical_frame::AnatomicalFrame;
pub use blade::Blade;
pub(crate) use boundary::DisjointSets;
pub use boundary::{BoundaryReport, components};
pub(crate) use bvh::{Bounds, Bvh, bounds_union};
pub(crate) use cut::cut_elements;
pub use cut::{TetCut, cut, remove};
#[cfg(test)]
pub(crate) use edge_face_intersection::intersect_edge_face;
pub(crate) use edge_face_intersection::{EdgeFaceIntersection, edge_face_intersections};
pub(crate) use edge_middles::EdgeMiddles;
pub use field::{Field, Location, ScalarType};
pub(crate) use finer_space::FinerSpace;
pub use frame::LocalFrame;
pub(crate) use group_by::group_by_key;
pub use length_unit::Length;
pub(crate) use length_unit::metres_in;
pub use mesh_report::{FieldDescription, MeshDescription, RegionDescription};

pub(crate) use order::order_of;
pub use packed_normal::{NO_NORMAL, pack_normal, unpack_normal};
pub use partition::{MeshPartition, MeshPiece};
pub use quadratic::ElementOrder;
pub(crate) use quadratic::{PIECES, TenNodes, ten_nodes, traction_shares};
pub(crate) use quadratic_shape::{QUADRATURE, QUADRATURE_POINTS, quadrature_point, unit_map};
pub(crate) use quality::DIHEDRAL_BINS;
pub use quality::{QualityReport, TetQuality};
pub use repair::RepairReport;
pub(crate) use smooth_regions::{LabelShares, SmoothRegions};
pub(crate) use sorted_list::replace_sorted;
pub use surface_report::SurfaceDescription;
pub use topology::{BoundaryFace, FACES, NO_NEIGHBOUR, TET_EDGES, Topology};
pub use transfer::BarycentricMap;
pub use tri_mesh::TriMesh;
pub(crate) use tri_mesh::{NORMAL, UV};
pub(crate) use triangle_bvh::{DEPTH, TriangleBvh, closest_point_weights};
pub use triangle_bvh::{depth_field, point_triangle_distance};

use crate::{Error, Result};
use glam::DVec3;
use rayon::slice::ParallelSliceMut;
use std::collections::BTreeMap;

/// A tetrahedral mesh with fields, in the units of the file it came from.
///
/// Every tet (v0 v1 v2 v3) is positively oriented: det(v1−v0, v2−v0, v3−v0) ≥ 0, and face i
/// lies opposite vertex i (see [`FACES`]). Meshes are built by [`TetMesh::new`], which makes safe
/// repairs and counts them in [`TetMesh::repairs`].
#[derive(Clone, Debug, Default)]
pub struct TetMesh {
    /// Node positions.
    pub nodes: Vec<DVec3>,
    /// Four node indices per tet.
    pub tets: Vec<[u32; 4]>,
    /// Order of the elements that the tets stand for: of order 2, each eight tets are the pieces of a
    /// ten-node tet (see [`TetMesh::with_mid_edge_nodes`]), and writers write ten-node tets.
    pub order: ElementOrder,
    /// Fields at the nodes and in the tets, by name.
    pub fields: Vec<Field>,
    /// Names of the regions by their value in the cell field `label`, if known.
    pub region_names: BTreeMap<i64, String>,
    /// Length of one unit of the mesh in metres, if known.
    pub length_unit: Option<f64>,
    /// Frame of reference of the coordinates, if known; readers convert LPS to RAS.
    pub frame: Option<AnatomicalFrame>,
    /// Repairs, drops and warnings from the construction of the mesh.
    pub repairs: RepairReport,
}

impl TetMesh {
    /// Returns the signed volume of tet `t`.
    pub fn tet_volume(&self, t: usize) -> f64 {
        signed_volume(self.tet_nodes(t))
    }

    /// Returns the four node positions of tet `t`.
    pub fn tet_nodes(&self, t: usize) -> [DVec3; 4] {
        self.tets[t].map(|v| self.nodes[v as usize])
    }

    /// Returns the sum of the signed volumes of all tets.
    pub fn volume(&self) -> f64 {
        (0..self.tets.len()).map(|t| self.tet_volume(t)).sum()
    }

    /// Returns every edge of the tets once, as (smaller, larger) node, sorted. Time O(n log n), in
    /// parallel.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let of_tet = |t: &[u32; 4]| TET_EDGES.map(|[a, b]| [t[a].min(t[b]), t[a].max(t[b])]);
        let mut edges: Vec<[u32; 2]> = self.tets.iter().flat_map(of_tet).collect();
        edges.par_sort_unstable();
        edges.dedup();
        edges
    }

    /// Returns the axis-aligned bounding box of the nodes: (lower corner, upper corner).
    pub fn bounds(&self) -> (DVec3, DVec3) {
        bounds(&self.nodes)
    }

    /// Returns the field `name` at `location`, if there is one.
    pub fn field(&self, name: &str, location: Location) -> Option<&Field> {
        self.fields
            .iter()
            .find(|f| f.name == name && f.location == location)
    }

    /// Averages a scalar of the tets to the nodes, weighted by volume.
    pub fn volume_weighted_node_means(&self, scalars: &[f64]) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); self.nodes.len()];
        for (t, (tet, value)) in self.tets.iter().zip(scalars).enumerate() {
            let weight = self.tet_volume(t);
            for v in tet {
                let sum = &mut sums[*v as usize];
                *sum = (sum.0 + weight * value, sum.1 + weight);
            }
        }
        // Nodes without tets, as in grids, are never visible.
        let unseen = scalars.first().copied().unwrap_or(0.0);
        sums.iter()
            .map(|(sum, weight)| if *weight > 0.0 { sum / weight } else { unseen })
            .collect()
    }

    /// Adds a field, replacing one of the same name and location.
    ///
    /// # Errors
    /// An error if the number of values does not match the mesh.
    pub fn set_field(&mut self, field: Field) -> Result<()> {
        let items = match field.location {
            Location::Node => self.nodes.len(),
            Location::Cell => self.tets.len(),
        };
        if field.components == 0 || field.values.len() != items * field.components {
            return Err(Error::Mesh(format!(
                "field \"{}\" has {} values, but {} {} of {} components require {}",
                field.name,
                field.values.len(),
                items,
                field.location,
                field.components,
                items * field.components
            )));
        }
        self.fields
            .retain(|f| f.name != field.name || f.location != field.location);
        self.fields.push(field);
        Ok(())
    }
}

/// Returns the volume of the tet with corners `v`, with the sign of det(v1−v0, v2−v0, v3−v0).
pub fn signed_volume(v: [DVec3; 4]) -> f64 {
    (v[1] - v[0]).cross(v[2] - v[0]).dot(v[3] - v[0]) / 6.0
}

/// Returns the axis-aligned bounding box of `points`; both corners are the origin if there are
/// none.
pub fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    if points.is_empty() {
        return (DVec3::ZERO, DVec3::ZERO);
    }
    points
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
            (low.min(*p), high.max(*p))
        })
}
