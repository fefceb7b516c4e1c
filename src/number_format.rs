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
}
