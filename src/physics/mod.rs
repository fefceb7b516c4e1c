//! Deformable bodies: masses at the nodes of a mesh, with finite elements in its tets or springs
//! along its edges (Tejada & Ertl 2005, section 3), stepped on the GPU or the CPU behind one trait,
//! [`Simulator`].
//!
//! On the GPU a [`GpuBody`] is a mesh made of a [`Material`], moved by a [`Solver`]. A step is a
//! chain of passes: the solver proposes a candidate state, its forces and energies are computed,
//! one workgroup decides whether it is valid, and only then it is committed. Nothing waits for the
//! CPU; a failure preserves the last valid state until it is queried.

mod adjoint;
mod bodies;
mod contact;
mod cpu;
mod engine_choice;
mod fields;
#[cfg(test)]
mod fields_tests;
mod gpu;
pub mod grid;
mod loads;
mod model;
mod nodal_forces;
#[cfg(feature = "rapier")]
mod rapier;
pub mod reference;
mod simulator;
mod stability;
mod state_format;

pub(crate) use bodies::BodiesState;
pub use bodies::MultiBody;
#[cfg(test)]
pub(crate) use contact::pseudo_random_points;
pub use contact::{DistanceField, SelfContactSettings, Shape, Tool, ToolId, ToolPose};
pub use cpu::{CpuGrid, CpuTets, Precision};
pub(crate) use cpu::{CpuGridState, CpuState, outer};
pub use engine_choice::EngineChoice;
pub use fields::BodyField;
pub(crate) use gpu::ExplicitEuler;
pub use gpu::body::GpuBody;
pub use gpu::grid::body::GridBody;
pub use gpu::grid::cut::GridCut;
pub use gpu::grid::simulator::GpuGrid;
pub(crate) use gpu::grid::state::GridState;
pub use gpu::simulator::GpuTets;
pub(crate) use gpu::simulator::TetState;
pub use gpu::solver::Solver;
pub(crate) use gpu::state::{BodyState, SolverState};
pub use gpu::stepper::Stepper;
pub use gpu::{ImplicitEuler, SymplecticEuler, VelocityVerlet, Verlet, integrator};
pub use loads::Loads;
pub use loads::force_balance::ForceBalance;
pub use loads::grab::{GrabId, GrabMode};
pub use loads::prescribed_motion::PrescribedMotionId;
pub use loads::reactions::{GrabbedNode, Reaction};
pub use loads::scaled_load::{AmplitudeId, Muscle, ScaledLoad};
pub(crate) use model::clamped_end::ClampedEnd;
pub use model::discrete_model::DiscreteModel;
pub use model::discretisation::{Discretisation, Edge, SpringNetwork};
pub use model::elements::{ConstitutiveModel, Element, Elements};
pub(crate) use model::elements::{NewtonSettings, eigen};
pub use model::energy::Energy;
pub use model::floor::Floor;
pub use model::joint::{Joint, JointKind};
pub use model::material::{Damping, Material, MaterialModel, RegionMaterial, Stiffness};
pub use model::nodal_volume::VolumetricFormulation;
pub use model::node_term::NodeTerm;
pub use model::rigid_region::RigidBody;
pub use model::solver_kind::SolverKind;
pub use model::solver_settings::CgSettings;
pub use model::tissue::{TISSUES, Tissue};
pub use model::units::LocalUnits;
pub(crate) use nodal_forces::NodalForces;
#[cfg(feature = "rapier")]
pub(crate) use rapier::RapierTets;
pub use simulator::capability::Capability;
pub use simulator::checkpoint::Checkpointing;
pub use simulator::contact::Contact;
pub use simulator::engine::Engine;
pub use simulator::gradients::{Gradient, Gradients, Parameter, Quantity};
pub(crate) use simulator::gradients::{LoadSchedule, SeriesReader};
pub use simulator::joints::Joints;
pub use simulator::member::{Member, MemberReport};
pub use simulator::node_positions::NodePositions;
pub use simulator::progress::{StepProgress, StepRecord};
pub use simulator::reactions::Reactions;
pub use simulator::report::Report;
pub use simulator::scaled_loads::ScaledLoads;
pub use simulator::state::SimulatorState;
pub use simulator::{ExactPositions, Simulator, StepCallback, TopologyChange};
pub(crate) use stability::advice::safe_step_ratio;
use stability::advice::time_step_advice;
pub use stability::linearised_model;
pub use stability::step_limit::largest_stable_step;
use stability::step_limit::limit_with_terms;
