//! Cutting of grid bodies: erases springs and removes particles.

use super::body::GridBody;
use super::model::GridModel;
use super::shape::SPRING_KINDS;
use crate::gpu::Texel;
use crate::mesh::{Blade, Location, TetCut, TetMesh, Topology};
use crate::parallel;
use crate::{Error, Result};
use glam::DVec3;

/// Result of a cut of a grid body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct GridCut {
    /// Number of erased springs.
    pub springs: usize,
    /// Number of removed tets: those of cells that are no longer complete.
    pub tets: usize,
}

impl GridModel {
    /// Returns the springs that `blade` (file units) intersects with the particles at `positions`,
    /// each as a particle and a forward kind.
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

    /// Erases springs. Returns the mesh of the cells that are still complete.
    ///
    /// # Errors
    /// [`Error::Input`] if no cell would be left; nothing is erased then.
    pub(crate) fn erase(&mut self, gone: &[(usize, usize)]) -> Result<TetMesh> {
        let offsets = self.shape.offsets();
        let mut springs = self.springs.clone();
        for (i, k) in gone {
            springs[*i] &= !(1 << (2 * k));
            springs[(*i as i64 + offsets[*k]) as usize] &= !(1 << (2 * k + 1));
        }
        let mesh = self.shape.mesh(&springs).map_err(|_| {
            Error::Input("the cut would leave no whole cell of the grid; nothing was cut".into())
        })?;
        self.springs = springs;
        Ok(mesh)
    }
}

/// Removes the tets that are not in `left` from `mesh` and its fields; `left` is in the order of
/// the mesh.
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

impl GridBody {
    /// Erases every spring that `blade` (file units) intersects in the present configuration. Reads
    /// the positions back. Masses and velocities are preserved; a blade that hits nothing changes
    /// nothing.
    ///
    /// Cells that lose a spring are removed from [`GridBody::mesh`], so its geometry for drawing
    /// must be rebuilt.
    ///
    /// # Errors
    /// As [`Gpu::read_array`](crate::gpu::Gpu::read_array); [`Error::Input`] if no cell would be
    /// left.
    pub fn cut(&mut self, blade: &Blade) -> Result<GridCut> {
        let crossed = self.model.springs_crossing(blade, &self.positions()?);
        self.erase(&crossed)
    }

    /// Removes particles: all their springs are erased, and they stay where they are. Ignores empty
    /// grid points.
    ///
    /// # Errors
    /// [`Error::Input`] if no cell would be left.
    pub fn remove(&mut self, particles: &[u32]) -> Result<GridCut> {
        let offsets = self.model.shape.offsets();
        let mut gone = Vec::new();
        for i in particles.iter().map(|i| *i as usize) {
            let springs = self.model.springs.get(i).copied().unwrap_or(0);
            for (k, offset) in offsets.iter().enumerate() {
                if springs >> (2 * k) & 1 == 1 {
                    gone.push((i, k));
                }
                if springs >> (2 * k + 1) & 1 == 1 {
                    gone.push(((i as i64 - offset) as usize, k));
                }
            }
        }
        gone.sort_unstable();
        gone.dedup();
        let cut = self.erase(&gone)?;
        let there = |i: &u32| (*i as usize) < self.model.springs.len();
        let gone: Vec<u32> = particles.iter().copied().filter(there).collect();
        self.pin_nodes(&gone)?;
        Ok(cut)
    }

    /// Erases springs, each given as a particle and a forward kind.
    fn erase(&mut self, gone: &[(usize, usize)]) -> Result<GridCut> {
        if gone.is_empty() {
            return Ok(GridCut::default());
        }
        let mesh = self.model.erase(gone)?;
        let tets = self.mesh.tets.len() - mesh.tets.len();
        self.mesh = mesh;
        self.dirty = true;
        self.changes += 1;
        self.refresh_normals()?;
        Ok(GridCut {
            springs: gone.len(),
            tets,
        })
    }

    /// Computes and reads back the approximate normals at rest with the present springs, packed;
    /// bitwise equal to those of a GPU step.
    ///
    /// # Errors
    /// As [`Gpu::array`](crate::gpu::Gpu::array) and
    /// [`Gpu::read_array`](crate::gpu::Gpu::read_array).
    pub fn rest_normals(&mut self) -> Result<Vec<u32>> {
        self.upload_changes()?;
        let rest = self.rest();
        let rest = self
            .gpu
            .array_of("positions at rest", Texel::F32x4, &rest)?;
        let unused = self
            .gpu
            .array("unused", Texel::F32x4, rest.len() as usize)?;
        let normals = self.undefined_normals()?;
        let mut work = self.gpu.start_recording();
        self.normals_pass(&rest, &unused, &normals)?
            .record(&mut work);
        work.submit()?;
        self.gpu.read_array(&normals)
    }
}
