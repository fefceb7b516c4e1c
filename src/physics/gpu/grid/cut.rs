//! Cutting a grid body: springs are erased, down to a single one; particles are taken out.

use super::body::GridBody;
use crate::gpu::Texel;
use crate::mesh::{Blade, Location, TetCut, TetMesh, Topology};
use crate::parallel;
use crate::physics::grid::model::GridModel;
use crate::physics::grid::shape::SPRING_KINDS;
use crate::{Error, Result};
use glam::DVec3;

/// What a cut of a grid body has changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct GridCut {
    /// Springs that were erased.
    pub springs: usize,
    /// Tets of cells that are no longer whole: they are not drawn any more.
    pub tets: usize,
}

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

impl GridBody {
    /// Erases every spring that `blade` (file units) crosses where the body stands now. Reads
    /// the positions back. Masses and velocities stay what they are; a blade that hits nothing
    /// changes nothing.
    ///
    /// Cells that lose a spring are left out of [`GridBody::mesh`]: whoever draws it has to be
    /// made anew.
    ///
    /// # Errors
    /// As [`Gpu::read_array`](crate::gpu::Gpu::read_array); [`Error::Input`] when no cell would
    /// be left.
    pub fn cut(&mut self, blade: &Blade) -> Result<GridCut> {
        let crossed = self.model.springs_crossing(blade, &self.positions()?);
        self.erase(&crossed)
    }

    /// Takes particles out of the body: all their springs are erased, and they stay where they
    /// are. Numbers that the body has not are passed over.
    ///
    /// # Errors
    /// [`Error::Input`] when no cell would be left.
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

    /// Erases springs, each given by its particle and its kind forward.
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

    /// The approximate normals at rest with the springs there are, packed: bit for bit as the GPU
    /// makes them in a step. Reads back.
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
