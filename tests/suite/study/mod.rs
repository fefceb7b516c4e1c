//! Studies: what they measure is kept, gone on from, and drawn.

mod frame;
mod motion;
mod pictures;
mod scaling;
mod scan;
mod stability;
