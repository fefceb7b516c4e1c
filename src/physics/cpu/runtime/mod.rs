//! The worker thread that steps a body, its traits, load updates and step checks.

pub(super) mod energy_guard;
pub(super) mod inversion;
pub(super) mod load_sync;
pub(super) mod steppable;
pub(super) mod worker;
