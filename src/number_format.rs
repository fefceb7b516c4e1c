//! Numbers as text for reports and messages.

/// Formats a number with six significant digits, without trailing zeros: fixed-point for
/// magnitudes from 10⁻⁴ to 10⁹, otherwise with an exponent.
pub fn significant(x: f64) -> String {
    rounded(x, 6)
}

/// Formats a number as [`significant`], with `digits` significant digits.
pub fn rounded(x: f64, digits: usize) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let decimals = digits.max(1) - 1;
    let magnitude = x.abs().log10().floor() as i32;
    if !(-4..9).contains(&magnitude) {
        return format!("{x:.decimals$e}");
    }
    let text = format!("{x:.*}", (decimals as i32 - magnitude).max(0) as usize);
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_string(),
        false => text,
    }
}

/// Formats a number and its error, with the digits that the error leaves: one of the error, or two if
/// the first is 1. The error is rounded up. A number smaller than its error has two digits.
pub(crate) fn with_error(x: f64, error: f64) -> [String; 2] {
    let error = error.abs();
    if !(x.is_finite() && error.is_finite() && error > 0.0) {
        return [significant(x), significant(error)];
    }
    let first = error.log10().floor();
    let digit = if error < 2.0 * 10f64.powf(first) {
        first - 1.0
    } else {
        first
    };
    let place = 10f64.powf(digit);
    // The tolerance keeps an error that is exact up to rounding.
    let up = (error / place - 1e-9).ceil() * place;
    if error > x.abs() && x != 0.0 {
        let unit = 10f64.powf(x.abs().log10().floor() - 1.0);
        let near = (x / unit).round() * unit;
        return [significant(near), significant(up)];
    }
    let near = (x / place).round() * place;
    match digit < 0.0 && digit > -7.0 {
        true => {
            let decimals = -digit as usize;
            [format!("{near:.decimals$}"), format!("{up:.decimals$}")]
        }
        false => [significant(near), significant(up)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_significant_digits() {
        for (x, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (-0.000123456789, "-0.000123457"),
            (1.23456789e-5, "1.23457e-5"),
            (123456.7, "123457"),
            (1234567.8, "1234568"),
            (2.5e12, "2.50000e12"),
        ] {
            assert_eq!(significant(x), text);
        }
        assert_eq!(rounded(0.0123456, 4), "0.01235");
    }

    #[test]
    fn digits_beyond_the_error_are_not_printed() {
        for (x, error, text) in [
            (0.262417, 0.0057, ["0.262", "0.006"]),
            (0.262417, 0.0121, ["0.262", "0.013"]),
            (0.262417, 0.2, ["0.3", "0.2"]),
            (12345.6, 321.0, ["12300", "400"]),
            (12345.6, 1210.0, ["12300", "1300"]),
            (-5.0, 0.5, ["-5.0", "0.5"]),
            (1.3412, 9.2, ["1.3", "10"]),
            (0.0413, 0.5, ["0.041", "0.5"]),
            (0.0, 0.5, ["0.0", "0.5"]),
            (1.5, 0.0, ["1.5", "0"]),
            (1.5, f64::NAN, ["1.5", "NaN"]),
        ] {
            assert_eq!(with_error(x, error), text.map(str::to_owned), "{x} {error}");
        }
    }
}
