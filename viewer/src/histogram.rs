//! Histogram of scalar values.

/// Number of bars.
const BARS: usize = 96;

/// Histogram of the scalars of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// Name of the field and version of its data: fields change as the body moves and as a series
    /// plays.
    pub of: (String, u64),
    /// The smallest and largest scalar.
    pub range: (f64, f64),
    /// Square roots of the counts relative to the maximum, from the smallest scalar on; the square
    /// root keeps rare values visible.
    pub bars: Vec<f32>,
}

impl Histogram {
    /// Counts the `values` in `range`.
    pub fn of(values: &[f64], range: (f64, f64), of: (String, u64)) -> Histogram {
        let span = (range.1 - range.0).max(f64::MIN_POSITIVE);
        let mut counts = vec![0u32; BARS];
        for value in values {
            let share = (value - range.0) / span;
            if (0.0..=1.0).contains(&share) {
                counts[((share * BARS as f64) as usize).min(BARS - 1)] += 1;
            }
        }
        let most = counts.iter().copied().max().unwrap_or(0).max(1);
        Histogram {
            of,
            range,
            bars: counts
                .iter()
                .map(|n| (*n as f32 / most as f32).sqrt())
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histogram_counts_values_per_bin() {
        let values = [0.0, 0.0, 0.0, 0.0, 1.0, 0.5, 7.0, f64::NAN];
        let histogram = Histogram::of(&values, (0.0, 1.0), (String::new(), 1));
        assert_eq!(histogram.bars[0], 1.0);
        assert_eq!(histogram.bars[BARS - 1], 0.5);
        assert_eq!(histogram.bars[BARS / 2], 0.5);
        assert_eq!(histogram.bars.iter().filter(|b| **b > 0.0).count(), 3);
        // A constant field has one bar.
        assert_eq!(
            Histogram::of(&[2.0], (2.0, 2.0), (String::new(), 0)).bars[0],
            1.0
        );
    }
}
