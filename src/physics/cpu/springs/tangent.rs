//! The exact tangent of springs under compression.

use super::term::Springs;
use crate::physics::cpu::vectors::{V4, outer, sub};
use glam::{DMat3, DVec3};

impl Springs<f64> {
    /// Returns for each compressed spring its nodes and the difference between its exact block at
    /// the displacements `u` and the one of `linearise`, which is positive semidefinite:
    /// κ s (I − n nᵀ) with the relative stretch s < 0.
    pub fn tangent_corrections(&self, u: &[V4<f64>]) -> Vec<([u32; 2], DMat3)> {
        let mut corrections = Vec::new();
        for chunk in &self.chunks {
            let first = chunk.nodes.start as u32;
            for (list, base) in [(&chunk.inner, first), (&chunk.outer, 0)] {
                for block in &list.blocks {
                    for n in 0..block.count {
                        let [i, j] = [block.i[n] + first, block.j[n] + base];
                        // Springs between chunks are stored twice.
                        if i > j {
                            continue;
                        }
                        let e = sub(u[j as usize], u[i as usize]);
                        let (d, square, over, gain) = block.lengths(n, e);
                        let stretch = (gain * over).min(0.0) * block.stiffness[n];
                        if stretch < 0.0 {
                            let d = DVec3::from(d);
                            let across = DMat3::IDENTITY - outer(d, d) * (1.0 / square);
                            corrections.push(([i, j], across * stretch));
                        }
                    }
                }
            }
        }
        corrections
    }
}
