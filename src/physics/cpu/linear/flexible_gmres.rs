//! Flexible GMRES (Saad 1993, "A flexible inner-outer preconditioned GMRES algorithm", algorithm
//! 2.2), for systems whose matrix is not symmetric, preconditioned by solves that may differ.

/// Number of directions after which the iteration restarts.
const RESTART: usize = 40;

/// Result of a solve.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::physics::cpu) struct GmresResult {
    /// x.
    pub solution: Vec<f64>,
    /// |b − A x| / |b|; 0 for b = 0.
    pub residual: f64,
}

/// Solves A x = b to the relative residual `tolerance` in at most `max_iterations` products with A.
/// `multiply` returns A p, `precondition` approximates A⁻¹ r. Returns the best x found; `None` if
/// `precondition` fails.
pub(in crate::physics::cpu) fn flexible_gmres(
    mut multiply: impl FnMut(&[f64]) -> Vec<f64>,
    mut precondition: impl FnMut(&[f64]) -> Option<Vec<f64>>,
    b: &[f64],
    (tolerance, max_iterations): (f64, usize),
) -> Option<GmresResult> {
    let scale = norm(b);
    let mut x = vec![0.0; b.len()];
    let mut residual = b.to_vec();
    let mut best = GmresResult {
        solution: x.clone(),
        residual: if scale > 0.0 { 1.0 } else { 0.0 },
    };
    let mut left = max_iterations;
    while best.residual > tolerance && left > 0 {
        let steps = left.min(RESTART);
        let goal = 0.5 * tolerance * scale;
        let (by, used) = cycle(&mut multiply, &mut precondition, &residual, (goal, steps))?;
        left -= used;
        add_scaled(&mut x, 1.0, &by);
        residual.copy_from_slice(b);
        add_scaled(&mut residual, -1.0, &multiply(&x));
        let now = norm(&residual) / scale;
        // A cycle reduces the residual, except for rounding.
        if now.is_nan() || now >= best.residual {
            break;
        }
        best = GmresResult {
            solution: x.clone(),
            residual: now,
        };
    }
    Some(best)
}

/// One cycle from the residual `r` towards a residual of the norm `goal`, in at most `steps`
/// products. Returns the change of x and the number of products.
fn cycle(
    multiply: &mut impl FnMut(&[f64]) -> Vec<f64>,
    precondition: &mut impl FnMut(&[f64]) -> Option<Vec<f64>>,
    r: &[f64],
    (goal, steps): (f64, usize),
) -> Option<(Vec<f64>, usize)> {
    let start = norm(r);
    let mut basis = vec![scaled(1.0 / start, r)];
    let (mut directions, mut columns) = (Vec::new(), Vec::<Vec<f64>>::new());
    // Givens rotations, and the right-hand side of the least-squares problem.
    let (mut rotations, mut rhs) = (Vec::<[f64; 2]>::new(), vec![start]);
    for k in 0..steps {
        let direction = precondition(&basis[k])?;
        let mut w = multiply(&direction);
        directions.push(direction);
        let mut column = Vec::with_capacity(k + 2);
        // Twice: modified Gram–Schmidt loses orthogonality near convergence.
        for pass in 0..2 {
            for (i, v) in basis.iter().enumerate() {
                let along = dot(&w, v);
                add_scaled(&mut w, -along, v);
                match pass {
                    0 => column.push(along),
                    _ => column[i] += along,
                }
            }
        }
        let length = norm(&w);
        for (i, [c, s]) in rotations.iter().enumerate() {
            let (a, b) = (column[i], column[i + 1]);
            (column[i], column[i + 1]) = (c * a + s * b, c * b - s * a);
        }
        let radius = column[k].hypot(length);
        if radius == 0.0 || !radius.is_finite() {
            directions.pop();
            break;
        }
        let [c, s] = [column[k] / radius, length / radius];
        column[k] = radius;
        rotations.push([c, s]);
        columns.push(column);
        let last = rhs[k];
        rhs[k] = c * last;
        rhs.push(-s * last);
        if rhs[k + 1].abs() <= goal || length == 0.0 {
            break;
        }
        basis.push(scaled(1.0 / length, &w));
    }
    let used = directions.len();
    let mut y = rhs[..used].to_vec();
    for k in (0..used).rev() {
        y[k] /= columns[k][k];
        let (before, rest) = y.split_at_mut(k);
        for (y, c) in before.iter_mut().zip(&columns[k]) {
            *y -= c * rest[0];
        }
    }
    let mut change = vec![0.0; r.len()];
    for (y, direction) in y.iter().zip(&directions) {
        add_scaled(&mut change, *y, direction);
    }
    Some((change, used.max(1)))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

fn scaled(by: f64, a: &[f64]) -> Vec<f64> {
    a.iter().map(|a| by * a).collect()
}

fn add_scaled(to: &mut [f64], by: f64, a: &[f64]) {
    for (to, a) in to.iter_mut().zip(a) {
        *to += by * a;
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// A matrix that is not symmetric, times p.
    fn product(p: &[f64]) -> Vec<f64> {
        let n = p.len();
        let row = |i: usize| {
            let (left, right) = (p[(i + n - 1) % n], p[(i + 1) % n]);
            (3.0 + (i % 7) as f64) * p[i] - 1.5 * left + 0.4 * right
        };
        (0..n).map(row).collect()
    }

    #[test]
    fn gmres_solves_unsymmetric_system() {
        let b: Vec<f64> = (0..60).map(|i| f64::from(i % 11) - 4.0).collect();
        let found = flexible_gmres(product, |r| Some(r.to_vec()), &b, (1e-12, 200)).unwrap();
        assert!(found.residual <= 1e-12, "{}", found.residual);
        let mut residual = product(&found.solution);
        add_scaled(&mut residual, -1.0, &b);
        assert!(norm(&residual) <= 2e-12 * norm(&b));
        // Three products do not suffice.
        let early = flexible_gmres(product, |r| Some(r.to_vec()), &b, (1e-12, 3)).unwrap();
        assert!(early.residual > 1e-6);
        // A preconditioner that changes is allowed.
        let mut turn = 0;
        let changing = |r: &[f64]| {
            turn += 1;
            Some(scaled(if turn % 2 == 0 { 0.3 } else { 0.1 }, r))
        };
        let found = flexible_gmres(product, changing, &b, (1e-12, 200)).unwrap();
        assert!(found.residual <= 1e-12, "{}", found.residual);
        assert!(flexible_gmres(product, |_| None, &b, (1e-12, 9)).is_none());
        let none = flexible_gmres(product, |r| Some(r.to_vec()), &[0.0; 4], (1e-12, 9)).unwrap();
        assert_eq!((none.residual, none.solution), (0.0, vec![0.0; 4]));
    }
}
