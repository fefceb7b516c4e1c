//! Removal of springs from a grid, and of incomplete cells from its mesh.

use super::model::GridModel;
use super::shape::SPRING_KINDS;
use crate::mesh::{Blade, Location, TetCut, TetMesh, Topology};
use crate::parallel;
use crate::{Error, Result};
use glam::DVec3;

impl GridModel {
    /// The springs that `blade` (file units) crosses where the particles stand at `positions`,
    /// each by its particle and its kind forward.
    pub(crate) fn springs_crossing(
        &self,
        blade: &Blade,
        positions: &[DVec3],
    ) -> Vec<(usize, usize)> {
        let offsets = self.shape.offsets();
        let springs = &self.springs;
        let particles: Vec<usize> = self.shape.particles().collect();
        parallel::collect(particles.len(), |range, crossed| {
            for i in &particles[range] {
                let kinds = (0..SPRING_KINDS).filter(|k| springs[*i] >> (2 * k) & 1 == 1);
                let j = |k: usize| (*i as i64 + offsets[k]) as usize;
                let crossing = kinds.filter(|k| blade.separates(positions[*i], positions[j(*k)]));
                crossed.extend(crossing.map(|k| (*i, k)));
            }
        })
    }

    /// Erases springs. Returns the mesh over the cells that are still whole.
    ///
    /// # Errors
    /// [`Error::Input`] when there would be none; nothing is erased then.
    pub(crate) fn erase(&mut self, erased: &[(usize, usize)]) -> Result<TetMesh> {
        let offsets = self.shape.offsets();
        let mut springs = self.springs.clone();
        for (i, k) in erased {
            springs[*i] &= !(1 << (2 * k));
            springs[(*i as i64 + offsets[*k]) as usize] &= !(1 << (2 * k + 1));
        }
        let mesh = self.shape.mesh(&springs).map_err(|_| {
            Error::Input("the cut would leave no complete grid cell; the body was not cut".into())
        })?;
        self.springs = springs;
        Ok(mesh)
    }
}

/// Leaves out of `mesh`, and of its fields, the tets that are not among those `left`, which are in
/// its order.
pub(crate) fn retain_tets(
    mesh: &mut TetMesh,
    topology: &mut Topology,
    left: &[[u32; 4]],
) -> TetCut {
    let mut left = left.iter().peekable();
    let tets = mesh.tets.iter();
    let stays: Vec<bool> = tets
        .map(|tet| left.next_if(|next| *next == tet).is_some())
        .collect();
    let gone = (0u32..).zip(&stays).filter(|(_, stays)| !**stays);
    let removed: Vec<u32> = gone.map(|(t, _)| t).collect();
    if removed.is_empty() {
        return TetCut::default();
    }
    let mut kept = stays.iter();
    mesh.tets.retain(|_| kept.next() == Some(&true));
    for field in &mut mesh.fields {
        if field.location == Location::Cell {
            let (n, mut k) = (field.components, 0);
            field.values.retain(|_| {
                k += 1;
                stays[(k - 1) / n]
            });
        }
    }
    *topology = Topology::new(mesh);
    TetCut {
        removed,
        ..TetCut::default()
    }
}
