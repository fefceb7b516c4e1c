//! Solids given by a function, filled by the mesher with tets of even size.

use crate::Result;
use crate::mesher::{Domain, Filling, MeshOptions, Spacing, fill};
use glam::DVec3;

/// A solid in lattice units: {p : inside(p) > 0} in the box from the origin to `size`.
struct Solid<F> {
    size: DVec3,
    inside: F,
}

impl<F: Fn(DVec3) -> f64 + Sync> Domain for Solid<F> {
    fn bounds(&self) -> (DVec3, DVec3) {
        (DVec3::ZERO, self.size)
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        weights.push((1, (self.inside)(p)));
    }
}

/// Fills {p : inside(p) > 0}, which lies in the box from the origin to `size`, with tets of
/// edges of about 1. Pieces smaller than `least` are left out.
pub(super) fn fill_solid(
    size: DVec3,
    least: f64,
    inside: impl Fn(DVec3) -> f64 + Sync,
) -> Result<Filling> {
    let options = MeshOptions {
        spacing: Spacing::Edge(1.0),
        grading: 1.0,
        min_island: least,
        ..MeshOptions::default()
    };
    fill(&Solid { size, inside }, &options, &|_, _| {})
}
