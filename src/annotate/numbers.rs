//! Round numbers and number formatting.

/// Round mantissas of a decade.
const ROUND: [f64; 4] = [1.0, 2.0, 5.0, 10.0];
/// Numbers outside of this range are written in scientific notation.
const LARGE: f64 = 1e6;
const SMALL: f64 = 1e-4;
/// Largest number of digits after the first in scientific notation of large numbers.
const MAX_EXPONENT_DIGITS: f64 = 6.0;

/// Returns the largest of 1, 2 and 5 times a power of ten that is at most `most`, which must be
/// positive.
pub(super) fn round_below(most: f64) -> f64 {
    let power = 10f64.powf(most.log10().floor());
    // The logarithm of a power of ten may be slightly too small by rounding.
    let fits = |r: &&f64| **r * power <= most * (1.0 + 1e-12);
    ROUND.iter().rev().find(fits).map_or(power, |r| r * power)
}

/// Returns the smallest of 1, 2 and 5 times a power of ten that is at least `least`, which must be
/// positive.
fn round_above(least: f64) -> f64 {
    let power = 10f64.powf(least.log10().floor());
    let fits = |r: &&f64| **r * power >= least * (1.0 - 1e-12);
    ROUND.iter().find(fits).map_or(10.0 * power, |r| r * power)
}

/// Returns round numbers from `low` to `high`, at most `most` + 1, and their distance.
pub(super) fn ticks(low: f64, high: f64, most: usize) -> (Vec<f64>, f64) {
    let span = high - low;
    if !(span.is_finite() && span > 0.0) {
        // A constant is written with up to six digits.
        let rounded = |step: &f64| ((low / step).round() * step - low).abs() <= 1e-6 * low.abs();
        let power = low.abs().max(f64::MIN_POSITIVE).log10().floor();
        let mut steps = (0..6).map(|digit| 10f64.powf(power - f64::from(digit)));
        return (vec![low], steps.find(rounded).unwrap_or(1e-5 * low.abs()));
    }
    let step = round_above(span / most.max(1) as f64);
    let first = (low / step - 1e-9).ceil();
    let count = (high / step + 1e-9).floor() - first;
    let ticks: Vec<f64> = (0..=count.max(0.0) as usize)
        // Avoids −0 and rounding residues such as −1e-17.
        .map(|i| (first + i as f64) * step + 0.0)
        .filter(|tick| {
            (low..=high).contains(tick)
                || (*tick - low).abs().min((*tick - high).abs()) < 1e-6 * span
        })
        .collect();
    (ticks, step)
}

/// Formats a number with enough digits to distinguish it from others at a distance of `step`.
pub(super) fn label(value: f64, step: f64) -> String {
    let size = value.abs().max(step.abs());
    if value == 0.0 && !(SMALL..LARGE).contains(&size) {
        return "0".into();
    }
    let power = |x: f64| (x.abs().log10() + 1e-9).floor();
    let text = match (SMALL..LARGE).contains(&size) || size == 0.0 {
        true => {
            let decimals = (-step.abs().max(1e-12).log10() - 1e-9).ceil().max(0.0) as usize;
            format!("{value:.decimals$}")
        }
        // With more digits, an exponent does not make them easier to compare.
        false if size >= LARGE && power(size) - power(step) > MAX_EXPONENT_DIGITS => {
            format!("{value:.*}", (-power(step)).clamp(0.0, 12.0) as usize)
        }
        false => {
            let digits = (power(value) - power(step)).clamp(0.0, MAX_EXPONENT_DIGITS);
            let text = format!("{value:.0$e}", digits as usize);
            match text.split_once('e') {
                Some((number, power)) if number.contains('.') => {
                    format!(
                        "{}e{power}",
                        number.trim_end_matches('0').trim_end_matches('.')
                    )
                }
                _ => text,
            }
        }
    };
    text.replace('-', "−")
}

/// Formats seconds with enough decimals to distinguish times at a distance of `resolution`.
pub(super) fn time(seconds: f64, resolution: f64) -> String {
    let exact = |decimals: &usize| {
        let digits = resolution * 10f64.powi(*decimals as i32);
        (digits - digits.round()).abs() < 0.02 * digits
    };
    let decimals = match resolution.is_finite() && resolution > 0.0 {
        true => (0..9).find(exact).unwrap_or(9),
        false => 2,
    };
    format!("t = {seconds:.decimals$} s").replace('-', "−")
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn labels_distinguish_ticks() {
        for (low, high) in [
            (1e6, 1e6 + 1e-3),
            (-2e9, -2e9 + 10.0),
            (0.35, 0.35),
            (3e-7, 4e-7),
        ] {
            let (values, step) = ticks(low, high, 5);
            let labels: Vec<String> = values.iter().map(|v| label(*v, step)).collect();
            for (text, value) in labels.iter().zip(&values) {
                let read: f64 = text.replace('−', "-").parse().unwrap();
                assert!((read - value).abs() <= 0.01 * step, "{labels:?}");
            }
            assert!(labels.windows(2).all(|two| two[0] != two[1]), "{labels:?}");
        }
    }

    #[test]
    fn lengths_are_round() {
        for (most, expected) in [
            (1.0, 1.0),
            (1.99, 1.0),
            (2.0, 2.0),
            (7.3, 5.0),
            (0.049, 0.02),
            (1e-3, 1e-3),
            (999.0, 500.0),
        ] {
            let found = round_below(most);
            assert!((found / expected - 1.0).abs() < 1e-12, "{most}: {found}");
        }
    }

    #[test]
    fn ticks_are_round_and_in_range() {
        let cases: [(f64, f64, &[&str]); 7] = [
            (0.0, 1.0, &["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
            (
                -1000.0,
                1500.0,
                &["−1000", "−500", "0", "500", "1000", "1500"],
            ),
            (0.31, 0.34, &["0.31", "0.32", "0.33", "0.34"]),
            (3.0, 97.0, &["20", "40", "60", "80"]),
            (0.0, 4e7, &["0", "1e7", "2e7", "3e7", "4e7"]),
            (0.0, 3e-6, &["0", "1e−6", "2e−6", "3e−6"]),
            (7.0, 7.0, &["7"]),
        ];
        for (low, high, expected) in cases {
            let (ticks, step) = ticks(low, high, 5);
            let labels: Vec<String> = ticks.iter().map(|t| label(*t, step)).collect();
            let expected: Vec<&str> = expected.to_vec();
            let labels: Vec<&str> = labels.iter().map(String::as_str).collect();
            // Ticks at the ends are kept despite rounding errors of the range.
            assert_eq!(labels, expected, "{low} to {high}");
        }
    }

    #[test]
    fn tick_count_is_bounded_for_any_range() {
        for power in -30..30 {
            for span in [1.0, 1.7, 2.3, 4.9, 9.99] {
                let low = 0.37 * 10f64.powi(power);
                let (ticks, step) = ticks(low, low + span * 10f64.powi(power), 5);
                assert!((2..=6).contains(&ticks.len()), "{power} {span}: {ticks:?}");
                let labels: std::collections::BTreeSet<String> =
                    ticks.iter().map(|t| label(*t, step)).collect();
                assert_eq!(labels.len(), ticks.len(), "{labels:?}");
            }
        }
    }

    #[test]
    fn time_label_resolves_step() {
        assert_eq!(time(0.12, 0.01), "t = 0.12 s");
        assert_eq!(time(0.0, 0.05), "t = 0.00 s");
        assert_eq!(time(0.0375, 0.0125), "t = 0.0375 s");
        assert_eq!(time(3.0, 1.0), "t = 3 s");
        assert_eq!(time(1.5, 0.0), "t = 1.50 s");
    }
}
