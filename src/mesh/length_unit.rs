//! Parsing of lengths with units.

use crate::{Error, Result};
use std::str::FromStr;

/// A length as entered by a user: `2mm`, `0.2 cm`, or a number in the unit of the input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Length {
    value: f64,
    /// Its unit in metres, if given.
    unit: Option<f64>,
}

/// Returns a unit of length in metres, by name: `m`, `cm`, `mm`, `um`, `in`.
pub(crate) fn metres_in(name: &str) -> Option<f64> {
    match name {
        "m" => Some(1.0),
        "cm" => Some(1e-2),
        "mm" => Some(1e-3),
        "um" | "µm" => Some(1e-6),
        "in" => Some(0.0254),
        _ => None,
    }
}

impl Length {
    /// Converts the length to the input's unit of `metres`; a number without unit is already in it.
    ///
    /// # Errors
    /// An [`Error::Input`] if the length has a unit and that of the input is unknown.
    pub fn in_unit_of(&self, metres: Option<f64>) -> Result<f64> {
        match (self.unit, metres) {
            (None, _) => Ok(self.value),
            (Some(unit), Some(metres)) => Ok(self.value * unit / metres),
            (Some(_), None) => Err(Error::Input(
                "cannot convert a length with a unit: the file does not state its length unit; set \
                it (for example --unit mm)".into(),
            )),
        }
    }
}

impl FromStr for Length {
    type Err = Error;

    fn from_str(text: &str) -> Result<Length> {
        let text = text.trim();
        let letters = text.trim_start_matches(|c: char| !c.is_alphabetic() || c == 'e');
        let (number, unit) = match metres_in(letters) {
            Some(metres) => (&text[..text.len() - letters.len()], Some(metres)),
            None => (text, None),
        };
        match number.trim().parse::<f64>() {
            Ok(value) if value.is_finite() && value > 0.0 => Ok(Length { value, unit }),
            _ => Err(Error::Input(format!(
                "invalid length \"{text}\": expected a positive number, optionally with a unit \
                (2mm, 0.2cm)"
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn lengths_are_converted_to_input_unit() {
        let length = |text: &str| text.parse::<Length>();
        let in_mm = |text: &str| length(text).unwrap().in_unit_of(Some(1e-3)).unwrap();
        assert_eq!(in_mm("2mm"), 2.0);
        assert!((in_mm("0.2 cm") - 2.0).abs() < 1e-12);
        assert!((in_mm("1e-3m") - 1.0).abs() < 1e-12);
        assert_eq!(in_mm("1.5e0"), 1.5);
        assert!(length("2mm").unwrap().in_unit_of(None).is_err());
        assert_eq!(length("2").unwrap().in_unit_of(None).unwrap(), 2.0);
        for wrong in ["", "mm", "-1mm", "0", "2 furlongs", "inf"] {
            assert!(length(wrong).is_err(), "{wrong}");
        }
    }
}
