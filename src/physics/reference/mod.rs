//! Reference implementation of tetrahedral bodies in float64, which the engines are tested against.

pub mod integrators;
pub mod linear;
pub mod springs;
