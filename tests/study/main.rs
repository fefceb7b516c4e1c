//! Studies: what they measure is kept, gone on from, and drawn.

#![allow(clippy::unwrap_used)]

mod frame;
mod motion;
mod pictures;
mod scaling;
mod stability;

use palpate::gpu::Gpu;
use std::sync::OnceLock;

/// The one device of these tests.
fn gpu() -> Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    GPU.get_or_init(|| Gpu::new().unwrap()).clone()
}
