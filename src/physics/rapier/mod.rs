//! The engine `rapier`: a body of tets stepped by the soft bodies of
//! [rapier](https://rapier.rs), implicit Euler with one linear solve a substep, in f32.
//!
//! Tools are kinematic bodies in the same world, rigid regions dynamic ones, which joints hold
//! together and to which particles are attached. rapier's vectors are of another glam than ours:
//! they are crossed by their numbers, in `scale.rs`.

mod balance;
mod body;
mod joints;
mod matter;
mod rigid;
mod scale;
mod shape;
mod simulator;
mod springs;
mod world;

pub use simulator::RapierTets;
