//! Contact with tools and self-contact: candidates, energy and continuous collision detection.

pub(super) mod boundary_surface;
pub(super) mod candidates;
pub(super) mod ccd;
pub(super) mod contact_derivatives;
pub(super) mod enclosed_components;
pub(super) mod friction_derivatives;
pub(super) mod pair_friction;
pub(super) mod parameters;
pub(super) mod reference;
pub(super) mod self_contact;
#[cfg(test)]
pub(super) mod self_contact_ccd_tests;
#[cfg(test)]
pub(super) mod self_contact_rigid_tests;
#[cfg(test)]
pub(super) mod self_contact_tests;
pub(super) mod tool_contact;
#[cfg(test)]
pub(super) mod tool_tests;
