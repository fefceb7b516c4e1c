//! Bodies on worker threads: the simulator that their models share, the worker and its traits, load
//! updates and step checks.

pub(super) mod checkpoint;
pub(super) mod energy_guard;
pub(super) mod inversion;
pub(super) mod load_sync;
pub(in crate::physics) mod motion_adjoint;
mod simulator;
pub(in crate::physics) mod static_adjoint;
pub(super) mod steppable;
pub(super) mod threaded_simulator;
pub(super) mod worker;
