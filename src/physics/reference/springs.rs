//! Spring forces, energies and Jacobians in float64: the reference of `shaders/physics`.
//!
//! All quantities are in SI units, positions in metres from the origin of the model.

use crate::physics::{Damping, DiscreteModel, Edge, NodeTerm};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::sync::Arc;

/// A model of springs with its state, external forces and pins.
#[derive(Clone, Debug)]
pub struct ReferenceSprings {
    /// The model, made of springs.
    pub model: DiscreteModel,
    /// Positions, m.
    pub x: Vec<DVec3>,
    /// Velocities, m/s.
    pub v: Vec<DVec3>,
    /// External force on each node, N.
    pub external: Vec<DVec3>,
    /// Gravity, m/s².
    pub gravity: DVec3,
    /// Pinned nodes, which do not move.
    pub pinned: Vec<bool>,
    /// Energy terms that act on each node separately.
    pub terms: Vec<Arc<dyn NodeTerm>>,
    /// The springs of every node.
    rows: Vec<Vec<u32>>,
}

impl ReferenceSprings {
    /// The model at rest.
    pub fn new(model: DiscreteModel) -> ReferenceSprings {
        let nodes = model.rest_positions.len();
        let mut rows = vec![Vec::new(); nodes];
        for (s, spring) in model.edges.iter().enumerate() {
            for v in spring.nodes {
                rows[v as usize].push(s as u32);
            }
        }
        ReferenceSprings {
            x: model.rest_positions.clone(),
            v: vec![DVec3::ZERO; nodes],
            external: vec![DVec3::ZERO; nodes],
            gravity: DVec3::ZERO,
            // A massless node has no equation of motion, so it is pinned.
            pinned: model.masses.iter().map(|m| *m <= 0.0).collect(),
            terms: Vec::new(),
            model,
            rows,
        }
    }

    /// The damped velocity component.
    fn damping_kind(&self) -> Damping {
        let springs = self.model.springs();
        springs.copied().unwrap_or_default().damping_kind
    }

    /// Sums `share(spring, other node)` over the springs of every node.
    fn accumulate(&self, share: impl Fn(usize, usize, &Edge) -> DVec3 + Sync) -> Vec<DVec3> {
        self.rows
            .par_iter()
            // Small bodies are summed serially: distributing the work would take longer.
            .with_min_len(256)
            .enumerate()
            .map(|(i, row)| {
                row.iter()
                    .map(|s| {
                        let spring = &self.model.edges[*s as usize];
                        let [a, b] = spring.nodes.map(|v| v as usize);
                        share(i, if a == i { b } else { a }, spring)
                    })
                    .sum()
            })
            .collect()
    }

    /// Returns the forces on all nodes, N: equations 2 and 3 of Tejada & Ertl, gravity and external
    /// forces.
    pub fn forces(&self) -> Vec<DVec3> {
        let mut f = self.accumulate(|i, j, s| {
            let d = self.x[j] - self.x[i];
            let w = self.v[j] - self.v[i];
            let n = d.normalize_or_zero();
            let braked = match self.damping_kind() {
                Damping::Axial => n * n.dot(w),
                Damping::Relative => w,
            };
            s.stiffness * (d.length() - s.length) * n + self.model.spring_damping(s) * braked
        });
        for (i, f) in f.iter_mut().enumerate() {
            let m = self.model.masses[i];
            *f += m * self.gravity + self.external[i];
            for term in &self.terms {
                *f += term.force(m, self.x[i]);
            }
        }
        f
    }

    /// Returns Σ κ(|x| + L) over the springs of each node, N: the scale for force errors.
    pub fn force_magnitude_sum(&self) -> Vec<f64> {
        self.accumulate(|i, j, s| {
            DVec3::splat(s.stiffness * (self.x[j].distance(self.x[i]) + s.length))
        })
        .iter()
        .map(|s| s.x)
        .collect()
    }

    /// Returns the energy of the springs, Σ ½κ(|x| − L)² (equation 1), and of the terms, J.
    pub fn elastic_energy(&self) -> f64 {
        let energy = |s: &Edge| {
            let [a, b] = s.nodes.map(|v| self.x[v as usize]);
            0.5 * s.stiffness * (a.distance(b) - s.length).powi(2)
        };
        let springs = self.model.edges.par_iter().with_min_len(1024);
        let of_nodes = self.terms.iter().map(|term| -> f64 {
            let nodes = self.model.masses.iter().zip(&self.x);
            nodes.map(|(m, x)| term.energy(*m, *x)).sum()
        });
        springs.map(energy).sum::<f64>() + of_nodes.sum::<f64>()
    }

    /// Returns the kinetic energy Σ ½mv², J.
    pub fn kinetic_energy(&self) -> f64 {
        let masses = self.model.masses.par_iter().with_min_len(1024);
        masses
            .zip(&self.v)
            .map(|(m, v)| 0.5 * m * v.length_squared())
            .sum()
    }

    /// Returns ∂f_i/∂x_j of one spring (equation 4). If `clamped`, omits the transverse term where
    /// it would be negative, as in K̃ of implicit Euler.
    fn stiffness_block(&self, i: usize, j: usize, s: &Edge, clamped: bool) -> DMat3 {
        let d = self.x[j] - self.x[i];
        let n = d.normalize_or_zero();
        let mut transverse = if d == DVec3::ZERO {
            // A collapsed spring has no direction; only one of rest length 0 resists, equally in
            // all directions.
            f64::from(u8::from(s.length == 0.0))
        } else {
            1.0 - s.length / d.length()
        };
        if clamped {
            transverse = transverse.max(0.0);
        }
        let along = DMat3::from_cols(n * n.x, n * n.y, n * n.z);
        s.stiffness * (along + transverse * (DMat3::IDENTITY - along))
    }

    /// Returns (∂f/∂x) p of the elastic spring forces, or K̃ p if `clamped`.
    pub fn stiffness_product(&self, p: &[DVec3], clamped: bool) -> Vec<DVec3> {
        let mut kp =
            self.accumulate(|i, j, s| self.stiffness_block(i, j, s, clamped) * (p[j] - p[i]));
        for term in &self.terms {
            for (i, kp) in kp.iter_mut().enumerate() {
                *kp -= term.hessian(self.model.masses[i], self.x[i]) * p[i];
            }
        }
        kp
    }

    /// Returns (∂f/∂v) p of the damping forces (equation 5).
    pub fn damping_product(&self, p: &[DVec3]) -> Vec<DVec3> {
        self.accumulate(|i, j, s| {
            let w = p[j] - p[i];
            let n = (self.x[j] - self.x[i]).normalize_or_zero();
            self.model.spring_damping(s)
                * match self.damping_kind() {
                    Damping::Axial => n * n.dot(w),
                    Damping::Relative => w,
                }
        })
    }

    /// Returns A p with A = M − h ∂f/∂v − h² K̃; rows of pinned nodes are zero.
    pub fn system_product(&self, h: f64, p: &[DVec3]) -> Vec<DVec3> {
        let stiffness = self.stiffness_product(p, true);
        let damping = self.damping_product(p);
        (0..p.len())
            .map(|i| {
                if self.pinned[i] {
                    DVec3::ZERO
                } else {
                    self.model.masses[i] * p[i] - h * damping[i] - h * h * stiffness[i]
                }
            })
            .collect()
    }

    /// Sums `share(node, other node, spring)` into the blocks of both ends of every spring.
    fn blocks(&self, share: impl Fn(usize, usize, &Edge) -> DMat3) -> Vec<DMat3> {
        let mut blocks = vec![DMat3::ZERO; self.x.len()];
        for s in &self.model.edges {
            let [i, j] = s.nodes.map(|v| v as usize);
            let block = share(i, j, s);
            blocks[i] += block;
            blocks[j] += block;
        }
        blocks
    }

    /// Returns the 3×3 diagonal blocks of A.
    pub fn system_blocks(&self, h: f64) -> Vec<DMat3> {
        let mut blocks = self.blocks(|i, j, s| {
            let n = (self.x[j] - self.x[i]).normalize_or_zero();
            let c = self.model.spring_damping(s)
                * match self.damping_kind() {
                    Damping::Axial => DMat3::from_cols(n * n.x, n * n.y, n * n.z),
                    Damping::Relative => DMat3::IDENTITY,
                };
            h * c + h * h * self.stiffness_block(i, j, s, true)
        });
        let nodes = self.model.masses.iter().zip(&self.x);
        for (block, (m, x)) in blocks.iter_mut().zip(nodes) {
            *block += DMat3::IDENTITY * *m;
            for term in &self.terms {
                *block += h * h * term.hessian(*m, *x);
            }
        }
        blocks
    }
}
