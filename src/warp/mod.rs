//! Image warping: maps scans and positions between a body at rest and its deformed state.
//!
//! Inside a tetrahedron the mapping is affine: a point with barycentric weights w in the deformed
//! tetrahedron has the same weights in the tetrahedron at rest. [`Warp`] finds the tetrahedron of
//! every voxel of a grid and computes
//!
//! - the scan in the deformed body ([`Warp::image`]): each voxel takes the scan's value at its rest
//!   position, by trilinear interpolation, or the nearest one for labels;
//! - displacement fields in mm on a grid: [`Warp::displacement`] from rest to the deformed state,
//!   [`Warp::inverse`] from the deformed state to rest, as used by image resampling tools.
//!
//! [`Warp::write`] writes them to files plane by plane; memory holds only the scan and a few
//! planes. All lengths are in mm and all positions in the scan's world, RAS, as in
//! [`crate::volume`]; meshes that `palpate mesh` generates from a scan use the same coordinates.
//!
//! A point on a face shared by two tetrahedra is not an overlap. If a point lies strictly inside
//! several tetrahedra, as in a self-intersecting body, the one with the lowest index is used and
//! the overlap is counted ([`Coverage::overlapping`]). Tetrahedra that are inverted in the deformed
//! body contain no point there ([`Warp::inverted`]). Outside of all tetrahedra the mapping is
//! undefined: images take the background, fields 0.

mod field;
mod files;
mod image;
mod point_map;
mod tet;
mod voxel_cover;

pub use field::DisplacementField;
pub use files::{WarpFiles, WarpReport};
pub use image::{WarpOptions, WarpedImage};

use crate::mesh::{Bvh, TetMesh, bounds};
use crate::volume::Grid;
use crate::{Error, Result, parallel};
use glam::DVec3;
use std::sync::OnceLock;
use tet::has_volume;

/// A body at rest and in the deformed state, and the mapping between the two.
#[derive(Debug)]
pub struct Warp<'a> {
    tets: &'a [[u32; 4]],
    /// Nodes at rest, and deformed.
    nodes: [&'a [DVec3]; 2],
    /// Whether each tetrahedron is neither degenerate nor inverted, at rest and deformed.
    upright: [Vec<bool>; 2],
    /// Search structures for single points; built on first use.
    search: [OnceLock<Bvh>; 2],
}

/// One direction of a [`Warp`]: from positions in one state to those in the other.
#[derive(Clone, Copy)]
struct MapDirection<'a> {
    tets: &'a [[u32; 4]],
    from: &'a [DVec3],
    to: &'a [DVec3],
    upright: &'a [bool],
}

/// Coverage of a voxel grid by a body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Coverage {
    /// All voxels of the grid.
    pub voxels: usize,
    /// Voxels whose centre lies in no tetrahedron.
    pub uncovered: usize,
    /// Voxels whose centre lies strictly inside more than one tetrahedron, each counted once.
    pub overlapping: usize,
    /// Voxels in a tetrahedron whose rest position is more than half a voxel outside of the scan's
    /// outermost centres: they take the background too.
    pub beyond: usize,
}

impl<'a> Warp<'a> {
    /// Creates the mapping from `rest` to the same tetrahedra with their nodes at `bent`; both in
    /// the scan's world, in mm. Ignores the fields of `rest`.
    ///
    /// # Errors
    /// [`Error::Mesh`] if the number of positions differs from that of nodes, one of them is not
    /// finite, or all tetrahedra are degenerate or inverted in the deformed body.
    pub fn new(rest: &'a TetMesh, bent: &'a [DVec3]) -> Result<Warp<'a>> {
        if bent.len() != rest.nodes.len() {
            return Err(Error::Mesh(format!(
                "the deformed body must have the nodes of the mesh at rest, got {} and {}; give the same mesh with moved nodes",
                bent.len(),
                rest.nodes.len()
            )));
        }
        for (nodes, which) in [(rest.nodes.as_slice(), "rest"), (bent, "deformed")] {
            if let Some(v) = nodes.iter().position(|p| !p.is_finite()) {
                return Err(Error::Mesh(format!(
                    "node {v} (counted from 0) has non-finite coordinates {} in the {which} mesh",
                    nodes[v]
                )));
            }
        }
        let nodes = [rest.nodes.as_slice(), bent];
        let upright = nodes.map(|nodes| {
            let corners = |t: usize| rest.tets[t].map(|v| nodes[v as usize]);
            parallel::map(rest.tets.len(), |t| has_volume(corners(t)))
        });
        if !upright[1].contains(&true) {
            return Err(Error::Mesh(
                "all tets of the deformed body are degenerate or inverted; at least one must have a positive volume".into(),
            ));
        }
        Ok(Warp {
            tets: &rest.tets,
            nodes,
            upright,
            search: Default::default(),
        })
    }

    /// Returns the number of degenerate or inverted tetrahedra in the deformed body, which contain
    /// no point there.
    pub fn inverted(&self) -> usize {
        self.upright[1].iter().filter(|upright| !**upright).count()
    }

    /// Maps a point of the body at rest to the deformed body; `None` outside of all tetrahedra.
    pub fn map_forward(&self, p: DVec3) -> Option<DVec3> {
        self.map_point(0, p)
    }

    /// Maps a point of the deformed body to the body at rest; `None` outside of all tetrahedra.
    pub fn map_inverse(&self, p: DVec3) -> Option<DVec3> {
        self.map_point(1, p)
    }

    /// The mapping from rest to the deformed state.
    fn forward(&self) -> MapDirection<'_> {
        self.direction(0)
    }

    /// The mapping from the deformed state to rest.
    fn backward(&self) -> MapDirection<'_> {
        self.direction(1)
    }

    fn direction(&self, from: usize) -> MapDirection<'_> {
        MapDirection {
            tets: self.tets,
            from: self.nodes[from],
            to: self.nodes[1 - from],
            upright: &self.upright[from],
        }
    }
}

impl Coverage {
    /// Adds the counts of another plane.
    fn add(&mut self, other: Coverage) {
        self.voxels += other.voxels;
        self.uncovered += other.uncovered;
        self.overlapping += other.overlapping;
        self.beyond += other.beyond;
    }

    /// Rejects a grid without a voxel in the body in the source state of `direction`.
    fn require_any(&self, direction: &MapDirection, grid: &Grid) -> Result<()> {
        if self.uncovered < self.voxels {
            return Ok(());
        }
        let box_of = |(low, high): (DVec3, DVec3)| {
            format!(
                "{:.1}, {:.1}, {:.1} to {:.1}, {:.1}, {:.1}",
                low.x, low.y, low.z, high.x, high.y, high.z
            )
        };
        Err(Error::Input(format!(
            "no voxel is inside the body: voxels span {} mm, the body {} mm; both must be in the scan's world coordinates (RAS, mm), as meshes that `palpate mesh` generates from the scan",
            box_of(grid.bounds()),
            box_of(bounds(direction.from))
        )))
    }
}
