//! Words and numbers of text formats, parsed directly from bytes.

/// Splits the first word off `rest`. Words are separated by ASCII white space.
#[inline]
pub(crate) fn word<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let bytes = *rest;
    let start = bytes.iter().position(|&b| !is_space(b))?;
    let len = bytes[start..].iter().position(|&b| is_space(b)).unwrap_or(bytes.len() - start);
    *rest = &bytes[start + len..];
    Some(&bytes[start..start + len])
}

#[inline]
fn is_space(b: u8) -> bool {
    b == b' ' || (9..=13).contains(&b)
}

/// Returns `bytes` as text without leading and trailing white space; invalid UTF-8 is replaced.
pub(crate) fn name(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes.trim_ascii()).into_owned()
}

/// Returns a word as quoted text for messages, truncated to a readable length.
pub(crate) fn shown(word: &[u8]) -> String {
    let cut = &word[..word.len().min(32)];
    format!("\"{}{}\"", String::from_utf8_lossy(cut).escape_debug(), if cut.len() < word.len() { "..." } else { "" })
}

/// Parses a double-precision number, correctly rounded. Also accepts `nan`, `inf` and Microsoft's `1.#IND`.
#[inline]
pub(crate) fn double(word: &[u8]) -> Option<f64> {
    match fast_float2::parse::<f64, _>(word) {
        Ok(x) => Some(x),
        Err(_) => odd_float(word),
    }
}

/// Parses a single-precision number, correctly rounded from its decimal digits.
#[inline]
pub(crate) fn single(word: &[u8]) -> Option<f32> {
    match fast_float2::parse::<f32, _>(word) {
        Ok(x) => Some(x),
        Err(_) => odd_float(word).map(|x| x as f32),
    }
}

/// Parses the texts that C libraries print for infinities and NaN.
#[cold]
fn odd_float(word: &[u8]) -> Option<f64> {
    let (negative, rest) = match word {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        _ => (false, word),
    };
    let lower = rest.to_ascii_lowercase();
    let magnitude = if lower.starts_with(b"1.#inf") || lower == b"inf" || lower == b"infinity" {
        f64::INFINITY
    } else if lower.starts_with(b"1.#") || lower == b"nan" || (lower.starts_with(b"nan(") && lower.ends_with(b")")) {
        f64::NAN
    } else {
        return None;
    };
    Some(if negative { -magnitude } else { magnitude })
}

/// Parses an integer. Returns `None` if the word is not one or does not fit.
#[inline]
pub(crate) fn integer(word: &[u8]) -> Option<i64> {
    let (negative, digits) = match word {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        _ => (false, word),
    };
    if digits.len() > 18 {
        return str::from_utf8(word).ok()?.parse().ok();
    }
    if digits.is_empty() {
        return None;
    }
    let mut value = 0i64;
    for &d in digits {
        let d = d.wrapping_sub(b'0');
        if d > 9 {
            return None;
        }
        value = value * 10 + i64::from(d);
    }
    Some(if negative { -value } else { value })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn words_are_cut_at_any_white_space() {
        let mut line: &[u8] = b"  f\t1/2/3  -4\x0b5\r";
        let words: Vec<_> = std::iter::from_fn(|| word(&mut line)).collect();
        assert_eq!(words, [&b"f"[..], b"1/2/3", b"-4", b"5"]);
    }

    #[test]
    fn odd_floats_are_read_as_c_prints_them() {
        for nan in ["nan", "-nan", "NaN", "1.#IND", "-1.#IND", "1.#QNAN", "nan(ind)", "-nan(snan)"] {
            assert!(double(nan.as_bytes()).is_some_and(f64::is_nan), "{nan}");
        }
        assert_eq!(double(b"-1.#INF"), Some(f64::NEG_INFINITY));
        assert_eq!(double(b"inf"), Some(f64::INFINITY));
        assert_eq!(double(b"+1.5e+003"), Some(1500.0));
        for bad in ["", "x", "1.2.3", "1,5", "--1", "nanx", "0x10"] {
            assert_eq!(double(bad.as_bytes()), None, "{bad}");
        }
    }

    #[test]
    fn integers_out_of_range_are_refused() {
        assert_eq!(integer(b"-12"), Some(-12));
        assert_eq!(integer(b"999999999999999999"), Some(999_999_999_999_999_999));
        for bad in ["", "-", "1.0", "9999999999999999999", "1e3", "0x1"] {
            assert_eq!(integer(bad.as_bytes()), None, "{bad}");
        }
    }

    proptest! {
        #[test]
        fn floats_agree_with_the_standard_library(bits in any::<u64>(), digits in 1usize..20) {
            let x = f64::from_bits(bits);
            prop_assume!(x.is_finite());
            let text = format!("{x:.digits$e}");
            prop_assert_eq!(double(text.as_bytes()).map(f64::to_bits), text.parse::<f64>().ok().map(f64::to_bits));
            prop_assert_eq!(single(text.as_bytes()).map(f32::to_bits), text.parse::<f32>().ok().map(f32::to_bits));
        }
    }
}
