//! Physics on a real adapter (a software one suffices; without any, these tests fail), against the
//! float64 reference.

mod bar;
mod bodies;
mod chosen_steps;
mod common;
mod cuts;
mod derivatives;
mod element_motion;
mod element_truth;
mod elements;
mod extremes;
mod failures;
mod floors;
mod grabs;
mod gradients;
mod grids;
mod integrators;
mod invariance;
#[cfg(not(feature = "rapier"))]
mod no_rapier;
#[cfg(feature = "rapier")]
mod rapier;
#[cfg(feature = "rapier")]
mod rapier_rigid;
mod rigid;
mod rigid_gpu;
mod simulators;
pub mod statics;
mod steps;
mod stiffness_and_load;
mod together;
mod tools_gpu;
