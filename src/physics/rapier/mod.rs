//! The engine `rapier`: tetrahedral bodies stepped by the soft bodies of
//! [rapier](https://rapier.rs), implicit Euler with one linear solve per substep, in f32.
//!
//! Tools are kinematic bodies in the same world. Rigid regions are dynamic bodies, connected by
//! joints, to which particles are attached. rapier uses another version of glam, so `scale.rs`
//! converts vectors component by component.

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

pub(crate) use simulator::RapierTets;
