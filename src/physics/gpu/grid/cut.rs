//! Cutting of grid bodies: erases springs and removes particles.

use super::body::GridBody;
use crate::Result;
use crate::gpu::Texel;
use crate::mesh::Blade;

/// Result of a cut of a grid body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct GridCut {
    /// Number of erased springs.
    pub springs: usize,
    /// Number of removed tets: those of cells that are no longer complete.
    pub tets: usize,
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
    /// As [`Gpu::read_array`](crate::gpu::Gpu::read_array); [`Error::Input`](crate::Error::Input) if no cell would be
    /// left.
    pub fn cut(&mut self, blade: &Blade) -> Result<GridCut> {
        let crossed = self.model.springs_crossing(blade, &self.positions()?);
        self.erase(&crossed)
    }

    /// Removes particles: all their springs are erased, and they stay where they are. Ignores empty
    /// grid points.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if no cell would be left.
    pub fn remove(&mut self, particles: &[u32]) -> Result<GridCut> {
        let offsets = self.model.shape.offsets();
        let mut erased = Vec::new();
        for i in particles.iter().map(|i| *i as usize) {
            let springs = self.model.springs.get(i).copied().unwrap_or(0);
            for (k, offset) in offsets.iter().enumerate() {
                if springs >> (2 * k) & 1 == 1 {
                    erased.push((i, k));
                }
                if springs >> (2 * k + 1) & 1 == 1 {
                    erased.push(((i as i64 - offset) as usize, k));
                }
            }
        }
        erased.sort_unstable();
        erased.dedup();
        let cut = self.erase(&erased)?;
        let there = |i: &u32| (*i as usize) < self.model.springs.len();
        let removed: Vec<u32> = particles.iter().copied().filter(there).collect();
        self.pin_nodes(&removed)?;
        Ok(cut)
    }

    /// Erases springs, each given as a particle and a forward kind.
    fn erase(&mut self, erased: &[(usize, usize)]) -> Result<GridCut> {
        if erased.is_empty() {
            return Ok(GridCut::default());
        }
        let mesh = self.model.erase(erased)?;
        let tets = self.mesh.tets.len() - mesh.tets.len();
        self.mesh = mesh;
        self.dirty = true;
        self.changes += 1;
        self.refresh_normals()?;
        Ok(GridCut {
            springs: erased.len(),
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
        let rest = self.gpu.array_of("rest positions", Texel::F32x4, &rest)?;
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
