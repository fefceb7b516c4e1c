//! The thread that steps a body, the trait by which it does, the loads sent to it and its checks.

pub(super) mod energy_guard;
pub(super) mod load_sync;
pub(super) mod steppable;
pub(super) mod worker;
