//! Regions of a volume defined by ranges of its values.

use crate::{Error, Result};
use std::str::FromStr;

/// A region of a volume between two thresholds.
///
/// As text: `300` (300 and above), `150..400`, and either with a name in front, `skull=300`.
#[derive(Clone, Debug, PartialEq)]
pub struct ThresholdRange {
    /// Its name, if given.
    pub name: Option<String>,
    /// Lowest value inside.
    pub low: f64,
    /// Highest value inside; infinite for a threshold.
    pub high: f64,
}

impl FromStr for ThresholdRange {
    type Err = Error;

    fn from_str(text: &str) -> Result<ThresholdRange> {
        let (name, range) = match text.split_once('=') {
            Some((name, range)) => (Some(name.trim().to_owned()), range),
            None => (None, text),
        };
        let number = |text: &str| {
            let number = text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
            number.ok_or_else(|| {
                Error::Input(format!(
                    "invalid threshold \"{text}\": expected a number (300), a range (150..400), or \
                    either with a name (skull=300)"
                ))
            })
        };
        let (low, high) = match range.split_once("..") {
            Some((low, high)) => (number(low)?, number(high)?),
            None => (number(range)?, f64::INFINITY),
        };
        if low >= high {
            return Err(Error::Input(format!(
                "invalid threshold range \"{text}\": the lower value must be less than the upper \
                value"
            )));
        }
        if name.as_ref().is_some_and(String::is_empty) {
            return Err(Error::Input(format!(
                "invalid threshold \"{text}\": the name is empty"
            )));
        }
        Ok(ThresholdRange { name, low, high })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn thresholds_parse_as_numbers_or_named_ranges() {
        let window = |text: &str| text.parse::<ThresholdRange>();
        let skull = window("skull = 300").unwrap();
        assert_eq!((skull.name.as_deref(), skull.low), (Some("skull"), 300.0));
        assert_eq!(skull.high, f64::INFINITY);
        let fat = window("-200..-50.5").unwrap();
        assert_eq!((fat.name, fat.low, fat.high), (None, -200.0, -50.5));
        for wrong in ["", "x", "1..", "4..3", "=3", "a=b", "nan", "1..inf"] {
            assert!(window(wrong).is_err(), "{wrong}");
        }
    }
}
