//! Bodies stepped on the CPU by threads, generic over f32 and f64; nodes in the order of a
//! recursive bisection, so that those of one group lie together in space and in memory.

mod body;
mod cg;
mod cholesky;
mod coarse;
mod explicit;
mod grid;
mod guard;
mod implicit;
mod loads;
mod node_terms;
mod order;
mod particle_forces;
mod particle_normals;
mod particle_step;
#[cfg(test)]
mod particle_tests;
mod particles;
mod pool;
mod pose;
mod real;
mod sending;
mod simulator;
mod spring_blocks;
mod springs;
mod state;
mod step;
mod sum;
mod terms;
#[cfg(test)]
mod tests;
mod vectors;
mod worker;

pub use grid::{CpuGrid, CpuGridState};
pub use real::Real;
pub use simulator::{CpuState, CpuTets};
