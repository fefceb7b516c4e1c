//! The model of a body: units, materials, springs and elements, rigid regions, joints, clamped ends
//! and the energy terms of nodes.

pub(super) mod clamped_end;
pub(super) mod discrete_model;
pub(super) mod discretisation;
pub(super) mod elements;
pub(super) mod energy;
pub(super) mod floor;
pub(super) mod joint;
pub(super) mod material;
mod model_builder;
pub(super) mod nodal_volume;
pub(super) mod node_term;
pub(super) mod quadratic;
pub(super) mod rigid_region;
pub(super) mod solver_kind;
pub(super) mod solver_settings;
pub(super) mod static_forces;
pub(super) mod stiffness_numbers;
pub(super) mod tissue;
pub(super) mod units;
