//! The best settings of a study: none is both cheaper and more accurate.

/// Returns the Pareto front of `points` (cost, error), sorted by cost; those that are not finite are
/// left out.
pub(super) fn pareto_front(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let finite = points.iter().filter(|p| p.iter().all(|c| c.is_finite()));
    let mut sorted: Vec<[f64; 2]> = finite.copied().collect();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut best = f64::INFINITY;
    sorted.retain(|p| {
        let better = p[1] < best;
        best = best.min(p[1]);
        better
    });
    sorted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn front_holds_points_that_no_other_beats() {
        let points = [
            [3.0, 0.1],
            [1.0, 0.9],
            [2.0, 1.0],
            [f64::NAN, 0.0],
            [2.0, 0.5],
            [1.0, 0.8],
        ];
        assert_eq!(pareto_front(&points), [[1.0, 0.8], [2.0, 0.5], [3.0, 0.1]]);
    }
}
