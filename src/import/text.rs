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

/// Returns `bytes` as text without leading and trailing white space.
///
/// Bytes that are not UTF-8 are taken as Latin-1, in which each byte is a letter: different names stay different, and
/// those of western languages stay readable. Files do not state their coding.
pub(crate) fn name(bytes: &[u8]) -> String {
    let bytes = bytes.trim_ascii();
    match str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    }
}

/// Returns the bytes before a `#`, which begins a comment in most text formats; `None` without one.
pub(crate) fn before_comment(word: &[u8]) -> Option<&[u8]> {
    word.iter().position(|&b| b == b'#').map(|at| &word[..at])
}

/// Returns the name before a comment, a `#` that begins a word; `None` without one. Some programs write such names.
pub(crate) fn name_before_comment(name: &[u8]) -> Option<&[u8]> {
    let at = (0..name.len()).find(|&i| name[i] == b'#' && (i == 0 || is_space(name[i - 1])))?;
    Some(name[..at].trim_ascii())
}

/// Returns `bytes` without padding at the end: zeros, which round up the length of a file, and the end mark of DOS.
pub(crate) fn unpadded(mut bytes: &[u8]) -> &[u8] {
    while let [rest @ .., 0 | 0x1a] = bytes {
        bytes = rest;
    }
    bytes
}

/// Returns the error message for a word that should be a number.
#[cold]
pub(crate) fn not_a_number(word: &[u8]) -> String {
    let comma = word.contains(&b',') && word.iter().all(|b| b.is_ascii_digit() || b",.+-eE".contains(b));
    let hint = if comma { " (decimals need a point, not a comma)" } else { "" };
    format!("{} is not a number{hint}", shown(word))
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
    fn names_in_any_coding_stay_different() {
        assert_eq!(name(" T\u{fc}r ".as_bytes()), "T\u{fc}r");
        assert_eq!(name(b"T\xfcr"), "T\u{fc}r");
        // Left and right in Shift-JIS.
        assert_eq!((name(b"\x8d\xb6"), name(b"\x89\x45")), ("\u{8d}\u{b6}".into(), "\u{89}E".into()));
    }

    #[test]
    fn comments_end_words_and_names() {
        assert_eq!(before_comment(b"3#x"), Some(&b"3"[..]));
        assert_eq!(before_comment(b"3"), None);
        for (text, name) in [("red # x", Some("red")), ("red\t#x", Some("red")), ("# x", Some("")), ("red#1", None)] {
            assert_eq!(name_before_comment(text.as_bytes()), name.map(str::as_bytes), "{text}");
        }
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
