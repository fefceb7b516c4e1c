//! How a point of a body swings: its lowest points, their period and decay.

use glam::DVec3;

/// Lowest points that are compared: five periods.
const MAX_LOWS: usize = 6;
/// Smallest amplitude that is compared, relative to the first.
const LEAST_AMPLITUDE: f64 = 0.1;

/// The swing of a point from its first lowest point on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Swing {
    /// Direction from the rest position to the lowest point.
    pub direction: DVec3,
    /// Distance from the rest position along it at the first lowest point.
    pub amplitude: f64,
    /// Number of periods that are compared.
    pub periods: usize,
    /// Their mean, s.
    pub period: f64,
    /// Each amplitude over the one a period before.
    pub ratio: f64,
    /// Time between two positions, s.
    pub interval: f64,
}

/// A largest value of a motion about zero: the vertex of the parabola through the value of a row and its
/// neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LowestPoint {
    pub time: f64,
    pub depth: f64,
    pub row: usize,
}

/// Returns the swing of a point whose positions relative to its rest position are `track`, after it was
/// released at row `released` and fell by about `drop`; `None` if it has no two lowest points.
pub(super) fn extremes_from_first(
    (times, track): (&[f64], &[DVec3]),
    released: usize,
    drop: DVec3,
) -> Option<Swing> {
    let direction = drop.normalize_or_zero();
    let depths: Vec<f64> = track
        .iter()
        .skip(released)
        .map(|p| p.dot(direction))
        .collect();
    let times = times.get(released..)?;
    let lows = lowest_points(times, &depths, drop.length() * LEAST_AMPLITUDE);
    let first = *lows.first()?;
    let kept: Vec<[f64; 2]> = lows
        .into_iter()
        .take(MAX_LOWS)
        .take_while(|low| low.depth >= LEAST_AMPLITUDE * first.depth)
        .map(|low| [low.time, low.depth])
        .collect();
    swing_of(
        &kept,
        direction,
        (times.last()? - times.first()?) / (times.len() - 1) as f64,
    )
}

/// Returns the swing of lowest points, each with its time and depth.
pub(super) fn swing_of(lows: &[[f64; 2]], direction: DVec3, interval: f64) -> Option<Swing> {
    let ([first, .., last], periods) = (lows, lows.len().checked_sub(1)?) else {
        return None;
    };
    Some(Swing {
        direction,
        amplitude: first[1],
        periods,
        period: (last[0] - first[0]) / periods as f64,
        ratio: (last[1] / first[1]).powf(1.0 / periods as f64),
        interval,
    })
}

/// Returns the largest values of a motion about zero, one of each period: between them it falls below
/// `-least`, so that noise adds none.
pub(super) fn lowest_points(times: &[f64], depths: &[f64], least: f64) -> Vec<LowestPoint> {
    let mut found = Vec::new();
    // The largest of the present half period.
    let mut best: Option<usize> = None;
    for (k, depth) in depths.iter().enumerate() {
        if *depth > 0.0 && best.is_none_or(|b| *depth > depths[b]) && *depth > least {
            best = Some(k);
        }
        if *depth < -least.min(0.5 * best.map_or(least, |b| depths[b]))
            && let Some(b) = best.take()
        {
            found.extend(refined(times, depths, b));
        }
    }
    found
}

/// Returns the vertex of the parabola through a value and its neighbours; `None` at the ends.
fn refined(times: &[f64], depths: &[f64], k: usize) -> Option<LowestPoint> {
    let [a, b, c] = around(depths, k)?;
    let (_, offset) = parabola([a, b, c]);
    let step = 0.5 * (times.get(k + 1)? - times.get(k - 1)?);
    Some(LowestPoint {
        time: times[k] + offset * step,
        depth: b - 0.25 * (a - c) * offset,
        row: k,
    })
}

/// Returns the value of a row between those of its neighbours.
fn around(depths: &[f64], row: usize) -> Option<[f64; 3]> {
    depths.get(row.checked_sub(1)?..row + 2)?.try_into().ok()
}

/// Returns the second difference of three values, and where between them their parabola has its vertex, in
/// intervals from the middle.
fn parabola([a, b, c]: [f64; 3]) -> (f64, f64) {
    let bend = a - 2.0 * b + c;
    match bend < 0.0 {
        true => (bend, 0.5 * (a - c) / bend),
        false => (bend, 0.0),
    }
}

impl LowestPoint {
    /// Returns the derivatives of its time and of its depth by the values of the rows before it, of it and
    /// after it; rows are `step` seconds apart.
    pub fn slopes(&self, depths: &[f64], step: f64) -> Option<[[f64; 3]; 2]> {
        let (bend, offset) = parabola(around(depths, self.row)?);
        if bend >= 0.0 {
            return Some([[0.0; 3], [0.0, 1.0, 0.0]]);
        }
        let by_time = [0.5 - offset, 2.0 * offset, -0.5 - offset].map(|by| step * by / bend);
        // At the vertex its place changes nothing: Lagrange's polynomials there.
        let by_depth = [
            0.5 * offset * (offset - 1.0),
            1.0 - offset * offset,
            0.5 * offset * (offset + 1.0),
        ];
        Some([by_time, by_depth])
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Slopes of time and depth of a lowest point are those of differences.
    #[test]
    fn slopes_of_lowest_point_match_differences() {
        let times: Vec<f64> = (0..60).map(|k| 0.01 * f64::from(k)).collect();
        let depths: Vec<f64> = times.iter().map(|t| (17.0 * t).sin()).collect();
        let low = |depths: &[f64]| lowest_points(&times, depths, 0.1)[0];
        let found = low(&depths);
        let slopes = found.slopes(&depths, 0.01).unwrap();
        for (k, row) in (found.row - 1..=found.row + 1).enumerate() {
            let at = |by: f64| {
                let mut other = depths.clone();
                other[row] += by;
                low(&other)
            };
            let (up, down) = (at(1e-6), at(-1e-6));
            let time = (up.time - down.time) / 2e-6;
            let depth = (up.depth - down.depth) / 2e-6;
            assert!(
                (slopes[0][k] / time - 1.0).abs() < 1e-6,
                "{slopes:?} {time}"
            );
            assert!((slopes[1][k] - depth).abs() < 1e-6, "{slopes:?} {depth}");
        }
    }

    /// Period and decay of a damped oscillation with noise are found.
    #[test]
    fn damped_oscillation_is_measured() {
        let times: Vec<f64> = (0..400).map(|k| 0.01 * f64::from(k)).collect();
        let track: Vec<DVec3> = times
            .iter()
            .enumerate()
            .map(|(k, t)| {
                let noise = 1e-3 * ((k * 7919 % 101) as f64 / 101.0 - 0.5);
                let fallen = (t - 0.3).max(0.0);
                let depth = -(-1.5 * fallen).exp() * (std::f64::consts::TAU * fallen / 0.23).cos();
                DVec3::new(0.0, 0.0, -(depth + noise))
            })
            .collect();
        let swing = extremes_from_first((&times, &track), 31, DVec3::NEG_Z).unwrap();
        println!("{swing:?}");
        assert!((swing.period / 0.23 - 1.0).abs() < 3e-3);
        assert!((swing.ratio / (-1.5f64 * 0.23).exp() - 1.0).abs() < 0.01);
        assert_eq!((swing.periods, swing.interval), (5, swing.interval));
        let still = vec![DVec3::ZERO; 400];
        assert!(extremes_from_first((&times, &still), 31, DVec3::NEG_Z).is_none());
    }
}
