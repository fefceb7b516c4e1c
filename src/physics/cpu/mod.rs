//! Multithreaded CPU engine, generic over f32 and f64. Nodes are ordered by recursive bisection, so
//! that the nodes of a group are close in space and in memory.

mod aggregation;
mod body;
mod contact;
mod differences;
mod elements;
mod external_loads;
mod grid;
mod implicit;
mod linear;
mod node_constraints;
mod node_terms;
mod partition;
mod pressure;
mod rigid;
mod runtime;
mod scalar;
mod simd;
mod six_node_face;
mod springs;
mod term;
mod vectors;

#[cfg(feature = "rapier")]
pub(super) use body::tools::count_intersecting_faces;
pub(super) use contact::boundary_surface::BoundarySurface;
pub(super) use contact::parameters::face_stiffness_transpose;
pub(super) use contact::parameters::{
    STATIC_FRICTION_SPEED, check_contact, face_stiffnesses, tool_gap,
};
pub(super) use contact::reference::ReferenceToolContact;
#[cfg(any(test, feature = "rapier"))]
pub(super) use node_constraints::NodeConstraint;
#[cfg(feature = "rapier")]
pub(super) use node_constraints::check_attachments;
#[cfg(feature = "rapier")]
pub(super) use rigid::closest_rotation::closest_rotation;
pub(super) use runtime::energy_guard::StepFailure;
pub(super) use runtime::load_sync::step_load_update;
pub(super) use runtime::motion_adjoint::{
    MotionAdjoint, MotionState, StateAdjoint, StepLoads, StepParts,
};
#[cfg(test)]
pub(super) use runtime::static_adjoint::TangentParts;
pub(super) use runtime::static_adjoint::{AdjointSeed, AdjointSolution, StaticAdjoint};
pub(super) use runtime::steppable::LoadUpdate;
#[cfg(any(test, feature = "rapier"))]
pub(super) use runtime::steppable::Steppable;
#[cfg(test)]
pub(super) use runtime::steppable::TetBody;
#[cfg(feature = "rapier")]
pub(super) use runtime::steppable::ToolTarget;
pub(super) use runtime::threaded_simulator::BodyModel;
#[cfg(feature = "rapier")]
pub(super) use runtime::threaded_simulator::ThreadedSimulator;

#[cfg(test)]
pub(super) use body::CpuBody;
pub(crate) use body::tets::CpuState;
pub(super) use body::tets::CpuTetModel;
pub use body::tets::CpuTets;
pub use grid::simulator::CpuGrid;
pub(crate) use grid::simulator::CpuGridState;
pub use runtime::steppable::Precision;
pub(crate) use vectors::outer;
