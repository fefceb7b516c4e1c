//! Bodies stepped on the CPU by threads, generic over f32 and f64; nodes in the order of a
//! recursive bisection, so that those of one group lie together in space and in memory.

#[cfg(test)]
mod acting_tests;
mod block_rows;
mod body;
mod cg;
mod cholesky;
mod closest_rotation;
mod coarse;
mod contact;
mod contact_blocks;
mod contact_hull;
mod contact_plain;
mod contact_way;
mod element_batches;
mod element_kernels;
mod element_svd;
mod element_term;
#[cfg(test)]
mod element_tests;
#[cfg(test)]
mod element_volume_tests;
mod element_volumes;
mod explicit;
mod grid;
mod guard;
mod guesses;
mod implicit;
mod lanes;
mod line_search;
mod loads;
mod muscle;
mod newton;
mod newton_contact;
mod newton_residual;
mod newton_step;
#[cfg(test)]
mod newton_tests;
mod node_terms;
mod order;
mod particle_forces;
mod particle_normals;
mod particle_step;
#[cfg(test)]
mod particle_tests;
mod particles;
mod pool;
mod pose;
mod potential;
mod preconditioner;
mod pressure;
mod real;
mod rigid;
mod rigid_body;
mod rigid_layout;
mod rigid_loads;
mod rigid_midpoint;
mod rigid_pose;
#[cfg(test)]
mod rigid_tests;
mod rules;
mod self_buried;
mod self_contact;
#[cfg(test)]
mod self_contact_rigid_tests;
#[cfg(test)]
mod self_contact_tests;
#[cfg(test)]
mod self_contact_ways_tests;
mod self_pairs;
mod sending;
mod simulator;
mod spring_blocks;
mod springs;
mod state;
mod step;
mod stepped;
mod sum;
mod terms;
#[cfg(test)]
mod tests;
mod tethers;
mod tied;
mod tools;
#[cfg(test)]
mod tools_tests;
mod vectors;
mod worker;

#[cfg(feature = "rapier")]
pub(super) use closest_rotation::closest_rotation;
pub(super) use contact_hull::BoundarySurface;
pub(super) use contact_plain::ReferenceToolContact;
#[cfg(feature = "rapier")]
pub(super) use guard::StepFailure;
#[cfg(feature = "rapier")]
pub(super) use loads::{NodeConstraint, check_attachments};
#[cfg(feature = "rapier")]
pub(super) use sending::send_loads;
#[cfg(feature = "rapier")]
pub(super) use stepped::{LoadUpdate, Steppable};
pub(super) use tools::{STATIC_FRICTION_SPEED, check_contact, face_stiffnesses, tool_gap};
#[cfg(feature = "rapier")]
pub(super) use tools::{ToolTarget, count_intersecting_faces};
#[cfg(feature = "rapier")]
pub(super) use worker::{Worker, WorkerCommand, WorkerError};

pub use grid::{CpuGrid, CpuGridState};
pub use simulator::{CpuState, CpuTets};
pub use stepped::Precision;
