//! The engine `rapier`: a body of tets stepped by the soft bodies of
//! [rapier](https://rapier.rs), implicit Euler with one linear solve a substep, in f32.
//!
//! Tools are kinematic bodies in the same world, rigid regions dynamic ones, which joints hold
//! together and to which particles are attached. rapier's vectors are of another glam than ours:
//! they are crossed by their numbers, in `units.rs`.

mod body;
mod collider;
mod internal_forces;
mod joints;
mod rigid_region;
mod simulator;
mod soft_body_model;
mod target_springs;
mod units;
mod world;

pub use simulator::RapierTets;
