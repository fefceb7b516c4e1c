//! Chart axes, linear or logarithmic, scaled to the data.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// An axis: its label, with the unit, and whether it is logarithmic.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Name and unit.
    pub label: String,
    /// Whether the axis is logarithmic.
    pub log: bool,
}

impl Axis {
    /// A linear axis.
    pub fn linear(label: &str) -> Axis {
        Axis {
            label: label.to_owned(),
            log: false,
        }
    }

    /// A logarithmic axis, which omits values ≤ 0.
    pub fn log(label: &str) -> Axis {
        Axis {
            label: label.to_owned(),
            log: true,
        }
    }

    /// Whether the axis can show `value`.
    pub(super) fn shows(&self, value: f64) -> bool {
        value.is_finite() && (!self.log || value > 0.0)
    }

    /// Returns a scale that covers `values` with a margin.
    pub(super) fn scale(&self, values: impl Iterator<Item = f64>) -> Scale {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.filter(|v| self.shows(*v)) {
            low = low.min(value);
            high = high.max(value);
        }
        if low > high {
            (low, high) = (1.0, 10.0);
        }
        if self.log {
            let room = (0.04 * (high / low).log10()).max(0.05);
            return Scale {
                low: low * 10_f64.powf(-room),
                high: high * 10_f64.powf(room),
                log: true,
            };
        }
        let room = match high > low {
            true => 0.04 * (high - low),
            false => 0.5 * high.abs().max(1.0),
        };
        Scale {
            // An axis of non-negative values begins at zero.
            low: if low >= 0.0 && low < 4.0 * room {
                0.0
            } else {
                low - room
            },
            high: high + room,
            log: false,
        }
    }
}

/// The range of an axis that a chart shows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    pub low: f64,
    pub high: f64,
    pub log: bool,
}

impl Scale {
    pub fn holds(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    fn decades(&self) -> (f64, f64) {
        (self.low.log10(), self.high.log10())
    }
}

impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = match self.log {
            true => (value / self.low).ln() / (self.high / self.low).ln(),
            false => (value - self.low) / (self.high - self.low),
        };
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let most = hint.max_num_points().clamp(2, 10);
        if self.log {
            let (low, high) = self.decades();
            let (first, last) = (low.ceil() as i32, high.floor() as i32);
            // Ranges below three decades get intermediate ticks.
            let within: &[f64] = match last - first {
                ..=0 => &[1.0, 2.0, 3.0, 5.0],
                1 | 2 => &[1.0, 3.0],
                _ => &[1.0],
            };
            let every = ((last - first + 1) as usize).div_ceil(most).max(1);
            let decades =
                (first - 1..=last).filter(|d| within.len() > 1 || (*d - first) % every as i32 == 0);
            let ticks = decades.flat_map(|d| within.iter().map(move |w| w * 10_f64.powi(d)));
            return ticks.filter(|t| self.holds(*t)).collect();
        }
        let rough = (self.high - self.low) / most as f64;
        let decade = 10_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|s| s * decade)
            .into_iter()
            .find(|s| *s >= rough)
            .unwrap_or(10.0 * decade);
        let (first, last) = (
            (self.low / step).ceil() as i64,
            (self.high / step).floor() as i64,
        );
        (first..=last).map(|i| i as f64 * step).collect()
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Scale {
    fn format_ext(&self, value: &f64) -> String {
        tick(*value)
    }
}

/// Formats a tick label: decimal if short, else with an exponent.
pub(super) fn tick(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        // Rounded, because linear ticks are sums.
        let plain = format!("{value:.4}");
        return plain.trim_end_matches('0').trim_end_matches('.').to_owned();
    }
    format!("{value:.1e}").replace(".0e", "e")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tick_labels_are_short() {
        assert_eq!(tick(0.0), "0");
        assert_eq!(tick(0.30000000000000004), "0.3");
        assert_eq!(tick(30_000.0), "30000");
        assert_eq!(tick(1e-5), "1e-5");
        assert_eq!(tick(2.5e6), "2.5e6");
    }

    #[test]
    fn scale_covers_values_and_omits_invalid_ones() {
        let values = [1e-4, 3.0, f64::NAN, -1.0, 0.0];
        let scale = Axis::log("x").scale(values.into_iter());
        assert!(scale.holds(1e-4) && scale.holds(3.0) && scale.low > 5e-5);
        let scale = Axis::linear("x").scale([5.0].into_iter());
        assert!(scale.low < 5.0 && scale.high > 5.0);
        let scale = Axis::log("x").scale(std::iter::empty());
        assert!(scale.low < scale.high);
    }
}
