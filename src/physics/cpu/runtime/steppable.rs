//! Bodies as their workers and simulators see them, whatever numbers they compute in: code that is
//! generic over these would be compiled again by every program that uses the library.

use super::energy_guard::StepFailure;
use crate::physics::cpu::body::CpuBody;
use crate::physics::cpu::body::tools::ToolTarget;
use crate::physics::cpu::grid::body::CpuGridBody;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::node_terms::NodeTerms;
use crate::physics::cpu::scalar::Real;
use crate::physics::grid::GridModel;
use crate::physics::{
    CgSettings, DiscreteModel, Muscle, NodeTerm, SelfContactSettings, SolverKind, StepRecord, Tool,
};
use crate::{Error, Result};
use glam::DVec3;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;

/// The numbers that the CPU engine computes in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// f32: for speed.
    #[default]
    Single,
    /// f64: for truth.
    Double,
}

/// The loads that have changed.
#[derive(Debug, Default)]
pub(in crate::physics) struct LoadUpdate {
    pub gravity: DVec3,
    pub pinned: Option<Vec<bool>>,
    pub forces: Option<Vec<DVec3>>,
    pub attachments: Option<Vec<NodeConstraint>>,
    pub levels: Option<Vec<f64>>,
    pub tools: Option<Vec<ToolTarget>>,
}

/// What a worker steps.
pub(in crate::physics) trait Steppable: Send + 'static {
    /// Whether its steps are long and take iterations, each to be told of.
    fn has_long_steps(&self) -> bool;

    /// Takes steps of so many seconds; what is noted of the last.
    fn run(&mut self, steps: u32, dt: f64) -> std::result::Result<StepRecord, StepFailure>;

    /// Steps taken.
    fn steps(&self) -> u64;

    /// Positions, m.
    fn positions(&self) -> Vec<DVec3>;

    /// Velocities, m/s.
    fn velocities(&self) -> Vec<DVec3>;

    /// Puts the nodes at positions (m) with velocities (m/s).
    fn set_state(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()>;

    /// Takes over loads.
    fn apply_loads(&mut self, change: LoadUpdate) -> Result<()>;

    /// In how many parts its nodes are shared out.
    fn parts(&self) -> usize;

    /// The whole state, packed.
    fn serialise_state(&self) -> Result<Vec<u8>>;

    /// Goes on from a state that [`Steppable::serialise_state`] gave of a body made in the same way.
    fn resume(&mut self, packed: &[u8]) -> Result<()>;
}

/// A body of tets.
pub(in crate::physics::cpu) trait TetBody: Steppable {
    /// Adds a term on the nodes of `network`, which this body is.
    fn add_node_term(&mut self, term: Arc<dyn NodeTerm>, network: &DiscreteModel);

    /// Adds pressure on faces, three nodes each, at the level of this number.
    fn add_pressure(&mut self, faces: &[[u32; 3]], level: usize);

    /// Adds a muscle of `network`, which this body is, and its tets, at the level of this number.
    fn add_muscle(&mut self, muscle: &Muscle, level: usize, of: (&DiscreteModel, &[[u32; 4]]));

    /// Adds a tool that presses on the boundary faces of `network`, which this body is.
    fn add_tool(&mut self, tool: &Tool, faces: &[[u32; 3]], network: &DiscreteModel);

    /// Has the body feel itself at the boundary faces of `network`, which it is; how many of these go
    /// through others.
    fn set_self_contact(
        &mut self,
        wanted: &SelfContactSettings,
        faces: &[[u32; 3]],
        network: &DiscreteModel,
    ) -> usize;

    /// The force on each tool, N, and its moment about the origin of the tool's shape, N·m.
    fn tool_forces(&self) -> Vec<[DVec3; 2]>;

    /// What all else of it exerts on each rigid body, N, and its moment about the centre of mass, N·m.
    fn rigid_forces(&self) -> Vec<[DVec3; 2]>;

    /// The sum of all forces on every node, N.
    fn forces(&self) -> Vec<DVec3>;

    /// Displacements from rest in the numbers that the body computes in.
    fn displacements(&self) -> Vec<[f64; 3]>;

    /// Puts the nodes where [`TetBody::displacements`] found them.
    fn set_displacements(&mut self, displacements: &[[f64; 3]]) -> Result<()>;
}

/// The particles of a grid.
pub(in crate::physics::cpu) trait GridParticles: Steppable {
    /// Takes over which springs there are.
    fn set_springs(&mut self, springs: &[u32]) -> Result<()>;

    /// The approximate normals of all particles, 0 where there is none.
    fn normals(&self) -> Vec<DVec3>;
}

impl Precision {
    /// The body that `network` is, in so many parts, or as many as suit it.
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

    /// The particles of `model`, in so many parts, or as many as suit them.
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

fn pack(state: &impl Serialize) -> Result<Vec<u8>> {
    postcard::to_stdvec(state).map_err(|e| Error::Input(format!("the state cannot be packed: {e}")))
}

fn unpack<S: DeserializeOwned>(packed: &[u8]) -> Result<S> {
    postcard::from_bytes(packed)
        .map_err(|_| Error::Input("the state of a body of other numbers, or a damaged one".into()))
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
            Some(attachments) => self.set_attachments(&attachments),
            None => Ok(()),
        }
    }

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

    fn add_pressure(&mut self, faces: &[[u32; 3]], level: usize) {
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

    fn displacements(&self) -> Vec<[f64; 3]> {
        CpuBody::displacements(self)
    }

    fn set_displacements(&mut self, displacements: &[[f64; 3]]) -> Result<()> {
        CpuBody::set_displacements(self, displacements)
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
            Some(attachments) => self.set_attachments(&attachments),
            None => Ok(()),
        }
    }

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
