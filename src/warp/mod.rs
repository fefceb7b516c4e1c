//! Scans that follow the body: where each place of a bent body was at rest, and a scan brought to
//! where its matter went.
//!
//! A body that bends carries its scan with it. Inside a tet the way is affine: a place with
//! barycentric weights w in the bent tet was at the same weights of the tet at rest. [`Warp`] finds
//! the tet of every voxel of a grid and from it
//!
//! - the scan in the bent body ([`Warp::image`]): each voxel takes the scan's value at its place at
//!   rest, trilinear, or of labels the nearest one;
//! - the motion itself as vectors in mm on a grid: [`Warp::displacement`] from rest to bent,
//!   [`Warp::inverse`] from bent to rest, which is what programs resample images by.
//!
//! [`Warp::write`] makes files of them plane by plane, in the memory of the scan and a few planes.
//! All lengths are in mm and all places in the scan's world, RAS, as [`crate::volume`] has them; a
//! mesh that `palpate mesh` makes of a scan is there already.
//!
//! Two tets that meet in a face, and a place on that face, are no overlap; where two tets both hold
//! a place inside, as where a body goes through itself, the one of the least index has it, and it
//! is counted ([`Coverage::overlapping`]). Tets that are turned inside out in the bent body hold no
//! place there ([`Warp::inverted`]). Where no tet is, there is no motion: images have their
//! background, fields 0.

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

/// A body at rest and bent, and so the motion between the two.
#[derive(Debug)]
pub struct Warp<'a> {
    tets: &'a [[u32; 4]],
    /// Nodes at rest, and bent.
    nodes: [&'a [DVec3]; 2],
    /// Which tets have a volume, and not that of their mirror image, at rest and bent.
    upright: [Vec<bool>; 2],
    /// For single points; made when first asked.
    search: [OnceLock<Bvh>; 2],
}

/// A way through a [`Warp`]: from places of one state to those of the other.
#[derive(Clone, Copy)]
struct MapDirection<'a> {
    tets: &'a [[u32; 4]],
    from: &'a [DVec3],
    to: &'a [DVec3],
    upright: &'a [bool],
}

/// How the voxels of a grid lie in a body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Coverage {
    /// All voxels of the grid.
    pub voxels: usize,
    /// Those whose centre lies in no tet.
    pub uncovered: usize,
    /// Those whose centre lies inside more than one tet, each of which counts once.
    pub overlapping: usize,
    /// Those that lie in a tet, but whose place at rest is more than half a voxel outside of the
    /// scan's outermost centres: background too.
    pub beyond: usize,
}

impl<'a> Warp<'a> {
    /// The motion from `rest` to the same tets with their nodes at `bent`; both in the scan's
    /// world, in mm. The fields of `rest` do not matter.
    ///
    /// # Errors
    /// [`Error::Mesh`] when there are not as many places as nodes, one of them is no finite number,
    /// or no tet has a volume in the bent body.
    pub fn new(rest: &'a TetMesh, bent: &'a [DVec3]) -> Result<Warp<'a>> {
        if bent.len() != rest.nodes.len() {
            return Err(Error::Mesh(format!(
                "the bent body has {} nodes, but the mesh at rest has {}; give the same mesh with its nodes moved",
                bent.len(),
                rest.nodes.len()
            )));
        }
        for (nodes, which) in [(rest.nodes.as_slice(), "at rest"), (bent, "bent")] {
            if let Some(v) = nodes.iter().position(|p| !p.is_finite()) {
                return Err(Error::Mesh(format!(
                    "node {v} (counted from 0) lies at {} in the mesh {which}, which is no place",
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
                "no tet of the bent body has a volume: all are flat or turned inside out".into(),
            ));
        }
        Ok(Warp {
            tets: &rest.tets,
            nodes,
            upright,
            search: Default::default(),
        })
    }

    /// How many tets are flat or turned inside out in the bent body: these hold no place there.
    pub fn inverted(&self) -> usize {
        self.upright[1].iter().filter(|upright| !**upright).count()
    }

    /// Where the matter at `p` of the body at rest is in the bent one; none where no tet is.
    pub fn map_forward(&self, p: DVec3) -> Option<DVec3> {
        self.map_point(0, p)
    }

    /// Where the matter at `p` of the bent body was at rest; none where no tet is.
    pub fn map_inverse(&self, p: DVec3) -> Option<DVec3> {
        self.map_point(1, p)
    }

    /// From rest to bent.
    fn forward(&self) -> MapDirection<'_> {
        self.way(0)
    }

    /// From bent to rest.
    fn backward(&self) -> MapDirection<'_> {
        self.way(1)
    }

    fn way(&self, from: usize) -> MapDirection<'_> {
        MapDirection {
            tets: self.tets,
            from: self.nodes[from],
            to: self.nodes[1 - from],
            upright: &self.upright[from],
        }
    }
}

impl Coverage {
    /// Of one plane and others.
    fn add(&mut self, other: Coverage) {
        self.voxels += other.voxels;
        self.uncovered += other.uncovered;
        self.overlapping += other.overlapping;
        self.beyond += other.beyond;
    }

    /// Refuses a grid of which nothing lies in the body that `way` starts from.
    fn require_any(&self, way: &MapDirection, grid: &Grid) -> Result<()> {
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
            "no voxel lies in the body: the voxels reach from {} mm, the body from {}; both must be in the scan's world (RAS, mm), as meshes are that `palpate mesh` makes of the scan",
            box_of(grid.bounds()),
            box_of(bounds(way.from))
        )))
    }
}
