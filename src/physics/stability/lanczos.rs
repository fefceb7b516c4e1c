//! The largest eigenvalue of a symmetric operator, by restarted Lanczos iteration.

use glam::DVec3;

/// Dimension of the Krylov space between restarts.
const KRYLOV_DIMENSION: usize = 24;

/// An eigenvalue and its unit eigenvector.
#[derive(Clone, Debug)]
pub struct Eigenpair {
    /// The eigenvalue.
    pub value: f64,
    /// The eigenvector: one vector per node.
    pub vector: Vec<DVec3>,
}

/// Computes the largest eigenpair of the positive semidefinite `operator` from `start`, to the
/// relative residual `tolerance` (the eigenvalue then has a relative error of about its square),
/// with at most `restarts` times 24 products.
///
/// Each restart begins with the best vector of the Krylov space.
pub fn largest_eigenpair(
    operator: impl Fn(&[DVec3]) -> Vec<DVec3>,
    start: Vec<DVec3>,
    tolerance: f64,
    restarts: usize,
) -> Eigenpair {
    let mut best = Eigenpair {
        value: 0.0,
        vector: start,
    };
    for _ in 0..restarts {
        if !normalise(&mut best.vector) {
            break;
        }
        let (next, residual) = lanczos_cycle(&operator, &best.vector);
        best = next;
        if residual <= tolerance * best.value {
            break;
        }
    }
    normalise(&mut best.vector);
    best
}

/// A start vector with a component in every mode: a Weyl sequence, always the same.
pub fn start_vector(nodes: usize) -> Vec<DVec3> {
    (0..nodes)
        .map(|i| (DVec3::new(0.5545497, 0.308517, 0.7548777) * (i + 1) as f64).fract() - 0.5)
        .collect()
}

/// Returns the best unit vector in the Krylov space of `start`, and the norm of its residual.
fn lanczos_cycle(operator: &impl Fn(&[DVec3]) -> Vec<DVec3>, start: &[DVec3]) -> (Eigenpair, f64) {
    let mut basis = vec![start.to_vec()];
    // The operator in that basis is tridiagonal.
    let (mut diagonal, mut beside) = (Vec::new(), Vec::new());
    loop {
        let last = &basis[basis.len() - 1];
        let mut next = operator(last);
        diagonal.push(dot(last, &next));
        // Reorthogonalising twice gives orthogonality up to rounding.
        for _ in 0..2 {
            for q in &basis {
                let along = dot(q, &next);
                for (x, q) in next.iter_mut().zip(q) {
                    *x -= along * *q;
                }
            }
        }
        let length = dot(&next, &next).sqrt();
        let size = diagonal.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        beside.push(length);
        if basis.len() == KRYLOV_DIMENSION || length <= 1e-14 * size || !length.is_finite() {
            break;
        }
        next.iter_mut().for_each(|x| *x /= length);
        basis.push(next);
    }
    let (value, weights) = largest_of_tridiagonal(&diagonal, &beside[..diagonal.len() - 1]);
    let mut vector = vec![DVec3::ZERO; start.len()];
    for (q, w) in basis.iter().zip(&weights) {
        for (x, q) in vector.iter_mut().zip(q) {
            *x += *w * *q;
        }
    }
    let residual = beside[diagonal.len() - 1] * weights[weights.len() - 1].abs();
    (Eigenpair { value, vector }, residual)
}

/// The largest eigenvalue and its eigenvector of the symmetric tridiagonal matrix with these
/// diagonal and off-diagonal entries.
fn largest_of_tridiagonal(diagonal: &[f64], beside: &[f64]) -> (f64, Vec<f64>) {
    let n = diagonal.len();
    let off = |i: usize| if i < n - 1 { beside[i].abs() } else { 0.0 };
    // Gershgorin's discs bound the eigenvalue; bisection on the signs of the pivots of T − σ finds
    // it.
    let radius = |i: usize| off(i) + if i > 0 { off(i - 1) } else { 0.0 };
    let mut high = (0..n)
        .map(|i| diagonal[i] + radius(i))
        .fold(f64::MIN, f64::max);
    let mut low = diagonal.iter().copied().fold(f64::MIN, f64::max);
    let pivots = |shift: f64| -> Vec<f64> {
        let mut d: Vec<f64> = Vec::with_capacity(n);
        for i in 0..n {
            let before = d.last().map_or(0.0, |p| beside[i - 1].powi(2) / p);
            d.push(diagonal[i] - shift - before);
        }
        d
    };
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        match pivots(middle).iter().all(|p| *p < 0.0) {
            true => high = middle,
            false => low = middle,
        }
    }
    // Inverse iteration just above the eigenvalue, where all pivots are negative and no pivoting is
    // needed.
    let shift = high + 1e-14 * high.abs().max(f64::MIN_POSITIVE);
    let d = pivots(shift);
    let mut x = vec![1.0; n];
    for _ in 0..3 {
        for i in 1..n {
            x[i] -= beside[i - 1] / d[i - 1] * x[i - 1];
        }
        for i in (0..n).rev() {
            let after = if i + 1 < n { beside[i] * x[i + 1] } else { 0.0 };
            x[i] = (x[i] - after) / d[i];
        }
        let length = x.iter().map(|x| x * x).sum::<f64>().sqrt();
        x.iter_mut().for_each(|x| *x /= length);
    }
    (high, x)
}

/// Scales to unit length. Returns whether the length was positive.
fn normalise(v: &mut [DVec3]) -> bool {
    let length = dot(v, v).sqrt();
    let sound = length.is_finite() && length > 0.0;
    if sound {
        v.iter_mut().for_each(|x| *x /= length);
    }
    sound
}

/// The inner product of two vectors with one entry per node.
pub fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// −d²/dx² on a chain of 3n points with fixed ends: eigenvalues 2 − 2 cos(kπ/(3n + 1)).
    fn chain(y: &[DVec3]) -> Vec<DVec3> {
        let flat: Vec<f64> = y.iter().flat_map(|v| v.to_array()).collect();
        let at = |i: i64| flat.get(i as usize).copied().unwrap_or(0.0);
        let bent: Vec<f64> = (0..flat.len() as i64)
            .map(|i| 2.0 * at(i) - at(i - 1) - at(i + 1))
            .collect();
        bent.chunks(3).map(DVec3::from_slice).collect()
    }

    #[test]
    fn largest_eigenpair_of_chain_is_exact() {
        for nodes in [1usize, 2, 5, 40] {
            let found = largest_eigenpair(chain, start_vector(nodes), 1e-9, 400);
            let n = (3 * nodes) as f64;
            let exact = 2.0 + 2.0 * (std::f64::consts::PI / (n + 1.0)).cos();
            assert!((found.value / exact - 1.0).abs() < 1e-12, "{nodes} nodes");
            let product = chain(&found.vector);
            let off: f64 = product
                .iter()
                .zip(&found.vector)
                .map(|(a, v)| a.distance(found.value * *v))
                .fold(0.0, f64::max);
            assert!(off < 1e-8, "{nodes} nodes: {off}");
        }
    }

    #[test]
    fn zero_operator_and_zero_vector_give_eigenvalue_zero() {
        let found = largest_eigenpair(|y| vec![DVec3::ZERO; y.len()], start_vector(4), 1e-9, 10);
        assert_eq!(found.value, 0.0);
        assert!(largest_eigenpair(chain, vec![DVec3::ZERO; 3], 1e-9, 10).value == 0.0);
    }
}
