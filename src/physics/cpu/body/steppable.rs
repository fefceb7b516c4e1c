//! The tetrahedral body's implementation of the worker's traits.

use super::CpuBody;
use crate::Result;
use crate::physics::cpu::node_terms::NodeTerms;
use crate::physics::cpu::pressure::LoadedFace;
use crate::physics::cpu::runtime::energy_guard::StepFailure;
use crate::physics::cpu::runtime::motion_adjoint::MotionAdjoint;
use crate::physics::cpu::runtime::static_adjoint::StaticAdjoint;
use crate::physics::cpu::runtime::steppable::{
    LoadUpdate, Precision, Resumable, Steppable, TetBody, pack, unpack,
};
use crate::physics::cpu::scalar::Real;
use crate::physics::{
    CgSettings, DiscreteModel, ForceBalance, Muscle, NodeTerm, SelfContactSettings, SolverKind,
    StepRecord, Tool,
};
use glam::DVec3;
use std::any::Any;
use std::sync::Arc;

impl Precision {
    /// Creates the body of `network`, partitioned into `parts` chunks, or a suitable number.
    pub(in crate::physics::cpu) fn tets(
        self,
        network: &DiscreteModel,
        (kind, settings): (SolverKind, CgSettings),
        parts: Option<usize>,
    ) -> Result<Box<dyn TetBody>> {
        Ok(match self {
            Precision::Single => Box::new(CpuBody::<f32>::new(network, kind, settings, parts)?),
            Precision::Double => Box::new(CpuBody::<f64>::new(network, kind, settings, parts)?),
        })
    }
}

impl<T: Real> Steppable for CpuBody<T> {
    fn has_long_steps(&self) -> bool {
        self.kind().is_implicit()
    }

    fn run(&mut self, steps: u32, dt: f64) -> std::result::Result<StepRecord, StepFailure> {
        CpuBody::run(self, steps, dt)
    }

    fn steps(&self) -> u64 {
        CpuBody::steps(self)
    }

    fn positions(&self) -> Vec<DVec3> {
        CpuBody::positions(self)
    }

    fn velocities(&self) -> Vec<DVec3> {
        CpuBody::velocities(self)
    }

    fn set_state(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        CpuBody::set_state(self, positions, velocities)
    }

    fn apply_loads(&mut self, change: LoadUpdate) -> Result<()> {
        self.set_gravity(change.gravity);
        if let Some(levels) = change.levels {
            self.set_levels(&levels);
        }
        if let Some(pinned) = change.pinned {
            self.set_pinned(&pinned)?;
        }
        if let Some(forces) = change.forces {
            self.set_forces(&forces)?;
        }
        if let Some(tools) = change.tools {
            self.set_tool_targets(&tools)?;
        }
        match change.attachments {
            Some(attachments) => self.set_node_constraints(&attachments),
            None => Ok(()),
        }
    }
}

impl<T: Real> Resumable for CpuBody<T> {
    fn parts(&self) -> usize {
        CpuBody::chunk_count(self)
    }

    fn serialise_state(&self) -> Result<Vec<u8>> {
        pack(&self.state())
    }

    fn resume(&mut self, packed: &[u8]) -> Result<()> {
        CpuBody::resume(self, &unpack(packed)?)
    }
}

impl<T: Real> TetBody for CpuBody<T> {
    fn add_node_term(&mut self, term: Arc<dyn NodeTerm>, network: &DiscreteModel) {
        let own = NodeTerms::new(term, network, self.layout());
        self.add_term(Box::new(own));
    }

    fn add_pressure(&mut self, faces: &[LoadedFace], level: usize) {
        CpuBody::add_pressure(self, faces, level);
    }

    fn add_muscle(&mut self, muscle: &Muscle, level: usize, of: (&DiscreteModel, &[[u32; 4]])) {
        CpuBody::add_muscle(self, muscle, level, of);
    }

    fn add_tool(&mut self, tool: &Tool, faces: &[[u32; 3]], network: &DiscreteModel) {
        CpuBody::add_tool(self, tool, faces, network);
    }

    fn set_self_contact(
        &mut self,
        wanted: &SelfContactSettings,
        faces: &[[u32; 3]],
        network: &DiscreteModel,
    ) -> usize {
        CpuBody::set_self_contact(self, wanted, faces, network)
    }

    fn tool_forces(&self) -> Vec<[DVec3; 2]> {
        CpuBody::tool_forces(self)
    }

    fn rigid_forces(&self) -> Vec<[DVec3; 2]> {
        CpuBody::rigid_forces(self)
    }

    fn forces(&self) -> Vec<DVec3> {
        CpuBody::forces(self)
    }

    fn force_balance(&self, stiffness: &[f64]) -> ForceBalance {
        CpuBody::force_balance(self, stiffness)
    }

    fn static_adjoint(&mut self) -> Option<&mut dyn StaticAdjoint> {
        let body: &mut dyn Any = self;
        let body = body.downcast_mut::<CpuBody<f64>>()?;
        Some(body)
    }

    fn motion_adjoint(&mut self) -> Option<&mut dyn MotionAdjoint> {
        let body: &mut dyn Any = self;
        let body = body.downcast_mut::<CpuBody<f64>>()?;
        Some(body)
    }

    fn set_inversion_allowed(&mut self, allowed: bool) {
        CpuBody::set_inversion_allowed(self, allowed);
    }

    fn displacements(&self) -> Vec<[f64; 3]> {
        CpuBody::displacements(self)
    }

    fn set_displacements(&mut self, displacements: &[[f64; 3]]) -> Result<()> {
        CpuBody::set_displacements(self, displacements)
    }
}
