//! Conjugate gradients in float64 for systems with one vector per node.

use glam::{DMat3, DVec3};

/// Result of a conjugate gradient solve.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The solution; zero at constrained nodes.
    pub x: Vec<DVec3>,
    /// Number of iterations.
    pub iterations: u32,
    /// The relative residual √(rᵀD⁻¹r / bᵀD⁻¹b), D the diagonal blocks.
    pub residual: f64,
}

/// Solves A x = b by conjugate gradients with a block Jacobi preconditioner (the inverse diagonal
/// blocks), to the relative residual `tolerance` or for `most` iterations.
///
/// `product` computes A x with zero rows at constrained nodes, `blocks` are the 3×3 diagonal blocks
/// of A, and b is zero at constrained nodes, where x stays zero. A is symmetric and positive
/// definite over the other nodes.
pub fn conjugate_gradients(
    product: impl Fn(&[DVec3]) -> Vec<DVec3>,
    blocks: &[DMat3],
    held: &[bool],
    b: Vec<DVec3>,
    tolerance: f64,
    most: u32,
) -> Solution {
    let inverse: Vec<DMat3> = blocks
        .iter()
        .zip(held)
        .map(|(block, held)| if *held { DMat3::ZERO } else { block.inverse() })
        .collect();
    let precondition =
        |r: &[DVec3]| -> Vec<DVec3> { r.iter().zip(&inverse).map(|(r, m)| *m * *r).collect() };
    let mut x = vec![DVec3::ZERO; b.len()];
    let mut r = b;
    let mut z = precondition(&r);
    let mut direction = z.clone();
    let mut rz = dot(&r, &z);
    let start = rz;
    let mut iterations = 0;
    while rz > tolerance * tolerance * start && iterations < most {
        let q = product(&direction);
        let alpha = rz / dot(&direction, &q);
        for i in 0..x.len() {
            x[i] += alpha * direction[i];
            r[i] -= alpha * q[i];
        }
        z = precondition(&r);
        let next = dot(&r, &z);
        let beta = next / rz;
        rz = next;
        for i in 0..x.len() {
            direction[i] = z[i] + beta * direction[i];
        }
        iterations += 1;
    }
    let residual = if start > 0.0 {
        (rz / start).sqrt()
    } else {
        0.0
    };
    Solution {
        x,
        iterations,
        residual,
    }
}

fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}
