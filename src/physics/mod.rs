//! Deformable bodies: masses at the nodes of a mesh, with finite elements in its tets or springs
//! along its edges (Tejada & Ertl 2005, section 3), stepped on the GPU or the CPU behind one trait,
//! [`Simulator`].
//!
//! On the GPU a [`GpuBody`] is a mesh made of a [`Material`], moved by a [`Solver`]. A step is a
//! chain of passes: the solver proposes a candidate state, its forces and energies are computed,
//! one workgroup decides whether it is valid, and only then it is committed. Nothing waits for the
//! CPU; a failure preserves the last valid state until it is queried.

mod acting;
mod bodies;
mod body;
mod contact;
mod cpu;
mod cut;
mod element_volume;
mod elements;
mod engine;
mod explicit_euler;
mod fields;
#[cfg(test)]
mod fields_tests;
mod gpu_contact;
#[cfg(test)]
mod gpu_contact_tests;
mod gpu_elements;
mod gpu_rigid;
mod gpu_springs;
mod gpu_terms;
mod gpu_tets;
mod grab;
mod grab_lists;
pub mod grid;
mod guard;
mod hold;
mod implicit_contact;
mod implicit_euler;
mod implicit_rigid;
mod implicit_start;
pub mod integrator;
mod joint;
mod kind;
mod lanczos;
mod loads;
mod material;
mod moves;
mod network;
mod nodes;
pub mod plain;
#[cfg(feature = "rapier")]
mod rapier;
mod reactions;
mod report;
mod rigid;
mod rows;
mod simulator;
mod simulator_tools;
mod solver;
pub mod spectrum;
mod stability;
mod state;
mod step;
mod stepper;
mod symplectic_euler;
mod terms;
mod tissue;
#[cfg(test)]
mod twin_tests;
mod units;
mod velocity_verlet;
mod verlet;

pub use acting::{AmplitudeId, Muscle, ScaledLoad};
pub use bodies::{BodiesState, Member, MemberReport, MultiBody};
pub use body::GpuBody;
#[cfg(test)]
pub(crate) use contact::pseudo_random_points;
pub use contact::{
    DistanceField, InitialPenetration, SelfContactSettings, Shape, SurfaceDistance, Tool, ToolId,
    ToolPose,
};
pub use cpu::{CpuGrid, CpuGridState, CpuState, CpuTets, Precision};
pub use element_volume::VolumetricFormulation;
pub(crate) use elements::eigen;
pub use elements::{ConstitutiveModel, Element, ElementHessian, Elements, NewtonSettings};
pub use engine::{Engine, EngineChoice};
pub use fields::BodyField;
pub use gpu_tets::{GpuTets, TetState};
pub use grab::{GrabId, GrabMode};
pub use grid::{GpuGrid, GridState};
use guard::time_step_advice;
pub use guard::{StepProgress, StepRecord};
pub use hold::ClampedEnd;
pub use implicit_euler::CgSettings;
pub use joint::{Joint, JointKind};
pub use kind::SolverKind;
pub use loads::{Loads, PrescribedMotionId};
pub use material::{Damping, Material, MaterialModel, RegionMaterial, Stiffness};
pub use network::{DiscreteModel, Spring};
pub use nodes::NodePositions;
#[cfg(feature = "rapier")]
pub use rapier::RapierTets;
pub use reactions::{GrabbedNode, NodalForces, Reaction};
pub use report::{Energy, Report};
pub use rigid::RigidBody;
pub use simulator::{ExactPositions, Simulator, SimulatorState, StepCallback, TopologyChange};
pub use solver::Solver;
pub use stability::largest_stable_step;
use stability::limit_with_terms;
pub use state::{BodyState, SolverState};
pub use stepper::Stepper;
pub use terms::{Floor, NodeTerm};
pub use tissue::{TISSUES, Tissue};
pub use units::LocalUnits;

/// Explicit Euler: x' = x + h v, v' = v + h a. Never stable without damping.
pub type ExplicitEuler = Stepper<explicit_euler::Scheme>;
/// Symplectic Euler: v' = v + h a, x' = x + h v'.
pub type SymplecticEuler = Stepper<symplectic_euler::Scheme>;
/// Verlet: x' = 2x − x₋₁ + h² a, started with x₋₁ = x₀ − h v₀ + ½h² a₀. Damping acts on the
/// velocity half a step earlier: second order without damping, first order with it.
pub type Verlet = Stepper<verlet::Scheme>;
/// Velocity Verlet: x' = x + h (v + ½h a), v' = v + ½h (a + a'), a' = a(x', v + h a): second order
/// with damping too.
pub type VelocityVerlet = Stepper<velocity_verlet::Scheme>;
/// Implicit Euler after Baraff & Witkin: (M − h ∂f/∂v − h² K̃) Δv = h(f + h K̃ v).
pub type ImplicitEuler = Stepper<implicit_euler::ImplicitEulerScheme>;
