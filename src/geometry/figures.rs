//! Figures as text.

/// A figure with seven significant digits, with an exponent where it is very small or large.
pub fn format_significant(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    let text = format!("{x:.6e}");
    let exponent: i32 = text.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    match exponent {
        -4..7 => format!("{x:.0$}", (6 - exponent) as usize),
        _ => text,
    }
}

/// The shortest digits of a coordinate: those of 32 bits where these hold it exactly.
pub fn format_shortest(x: f64) -> String {
    let narrow = x as f32;
    let small = x != 0.0 && !(1e-5..1e16).contains(&x.abs());
    match (f64::from(narrow) == x, small) {
        (true, false) => format!("{narrow}"),
        (true, true) => format!("{narrow:e}"),
        (false, false) => format!("{x}"),
        (false, true) => format!("{x:e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_the_digits_that_mean_something() {
        for (x, text) in [
            (1.0 / 6.0, "0.1666667"),
            (53.289895, "53.28990"),
            (-1234567.0, "-1234567"),
            (4.2e-27, "4.200000e-27"),
            (0.00012345678, "0.0001234568"),
            (4.2e36, "4.200000e36"),
            (0.0, "0"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(format_significant(x), text);
        }
    }

    #[test]
    fn coordinates_are_as_short_as_they_can_be() {
        for (x, text) in [
            (f64::from(0.1f32), "0.1"),
            (0.1, "0.1"),
            (5_411_234.6, "5411234.6"),
            (-2.0, "-2"),
            (1e-9, "1e-9"),
            (f64::from(3e12f32), "3000000000000"),
            (0.0, "0"),
        ] {
            assert_eq!(format_shortest(x), text);
        }
    }
}
