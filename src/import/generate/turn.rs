//! Sine and cosine from additions and multiplications, so that their bits are equal on every machine; those of the
//! standard library come from the platform.

use std::f64::consts::PI;

/// Returns sine and cosine of an angle in degrees, within 10⁻¹⁵ for angles up to 10⁴ degrees.
pub fn sin_cos(degrees: f64) -> (f64, f64) {
    let quarter = (degrees / 90.0).round();
    let x = (degrees - 90.0 * quarter) * (PI / 180.0);
    let (sin, cos) = (x * series(x, 1.0), series(x, 0.0));
    match (quarter as i64).rem_euclid(4) {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Returns the Taylor series of cos x, or of sin x / x with `odd` 1, for |x| <= π/4. The first term left out is below
/// 10⁻¹⁷.
fn series(x: f64, odd: f64) -> f64 {
    let mut sum = 1.0;
    for pair in (1..=8).rev() {
        let n = 2.0 * f64::from(pair) + odd;
        sum = 1.0 - sum * x * x / (n * (n - 1.0));
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_of_the_standard_library() {
        for i in -20_000..20_000 {
            let degrees = f64::from(i) * 0.1;
            let (sin, cos) = sin_cos(degrees);
            let expected = degrees.to_radians().sin_cos();
            assert!((sin - expected.0).abs() < 1e-13 && (cos - expected.1).abs() < 1e-13, "{degrees}");
            assert!((sin * sin + cos * cos - 1.0).abs() < 1e-15, "{degrees}");
        }
        for (degrees, expected) in [(0.0, (0.0, 1.0)), (90.0, (1.0, 0.0)), (-90.0, (-1.0, 0.0)), (540.0, (0.0, -1.0))] {
            assert_eq!(sin_cos(degrees), expected);
        }
        assert!((sin_cos(30.0).0 - 0.5).abs() < 1e-15 && (sin_cos(60.0).1 - 0.5).abs() < 1e-15);
    }
}
