//! The grid body's implementation of the worker's traits.

use super::body::CpuGridBody;
use crate::Result;
use crate::physics::StepRecord;
use crate::physics::cpu::runtime::energy_guard::StepFailure;
use crate::physics::cpu::runtime::steppable::{
    GridParticles, LoadUpdate, Precision, Resumable, Steppable, pack, unpack,
};
use crate::physics::cpu::scalar::Real;
use crate::physics::grid::GridModel;
use glam::DVec3;

impl Precision {
    /// Creates the particles of `model`, partitioned into `parts` slabs, or a suitable number.
    pub(in crate::physics::cpu) fn grid(
        self,
        model: &GridModel,
        parts: Option<usize>,
    ) -> Box<dyn GridParticles> {
        fn build<T: Real>(model: &GridModel, parts: Option<usize>) -> Box<dyn GridParticles> {
            Box::new(match parts {
                Some(parts) => CpuGridBody::<T>::with_slabs(model, parts),
                None => CpuGridBody::<T>::new(model),
            })
        }
        match self {
            Precision::Single => build::<f32>(model, parts),
            Precision::Double => build::<f64>(model, parts),
        }
    }
}

impl<T: Real> Steppable for CpuGridBody<T> {
    fn has_long_steps(&self) -> bool {
        false
    }

    fn run(&mut self, steps: u32, dt: f64) -> std::result::Result<StepRecord, StepFailure> {
        CpuGridBody::run(self, steps, dt)?;
        Ok(StepRecord {
            kinetic: self.kinetic_energy(),
            ..StepRecord::default()
        })
    }

    fn steps(&self) -> u64 {
        CpuGridBody::steps(self)
    }

    fn positions(&self) -> Vec<DVec3> {
        CpuGridBody::positions(self)
    }

    fn velocities(&self) -> Vec<DVec3> {
        CpuGridBody::velocities(self)
    }

    fn set_state(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        CpuGridBody::set_state(self, positions, velocities)
    }

    fn apply_loads(&mut self, change: LoadUpdate) -> Result<()> {
        self.set_gravity(change.gravity);
        if let Some(pinned) = change.pinned {
            self.set_pinned(&pinned)?;
        }
        if let Some(forces) = change.forces {
            self.set_forces(&forces)?;
        }
        match change.attachments {
            Some(attachments) => self.set_node_constraints(&attachments),
            None => Ok(()),
        }
    }
}

impl<T: Real> Resumable for CpuGridBody<T> {
    fn parts(&self) -> usize {
        CpuGridBody::parts(self)
    }

    fn serialise_state(&self) -> Result<Vec<u8>> {
        pack(&self.state())
    }

    fn resume(&mut self, packed: &[u8]) -> Result<()> {
        CpuGridBody::resume(self, &unpack(packed)?)
    }
}

impl<T: Real> GridParticles for CpuGridBody<T> {
    fn set_springs(&mut self, springs: &[u32]) -> Result<()> {
        CpuGridBody::set_springs(self, springs)
    }

    fn normals(&self) -> Vec<DVec3> {
        CpuGridBody::normals(self)
    }
}
