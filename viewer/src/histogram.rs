//! How often each scalar occurs.

/// Bars of a histogram.
const BARS: usize = 96;

/// How often the scalars of a body occur.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// The name of the field, and the number of tets, that it was counted for.
    pub of: (String, usize),
    /// The smallest and largest scalar.
    pub range: (f64, f64),
    /// From the smallest scalar on, how often each occurs, over the most; as a square root, so that
    /// what is rare is seen too.
    pub bars: Vec<f32>,
}

impl Histogram {
    /// Counts those of `values` that lie in `range`.
    pub fn of(values: &[f64], range: (f64, f64), of: (String, usize)) -> Histogram {
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
    fn what_occurs_is_counted_where_it_is() {
        let values = [0.0, 0.0, 0.0, 0.0, 1.0, 0.5, 7.0, f64::NAN];
        let histogram = Histogram::of(&values, (0.0, 1.0), (String::new(), 1));
        assert_eq!(histogram.bars[0], 1.0);
        assert_eq!(histogram.bars[BARS - 1], 0.5);
        assert_eq!(histogram.bars[BARS / 2], 0.5);
        assert_eq!(histogram.bars.iter().filter(|b| **b > 0.0).count(), 3);
        // Of one value there is one bar.
        assert_eq!(
            Histogram::of(&[2.0], (2.0, 2.0), (String::new(), 0)).bars[0],
            1.0
        );
    }
}
