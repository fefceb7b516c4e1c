//! Bodies of tets in float64, written plainly: what every engine is held against.

pub mod integrators;
pub mod linear;
pub mod springs;
