//! Repair of documents with values that JSON does not know, and that some programs write: `NaN`, infinite numbers, and
//! numbers that no double holds. They become `null`, as does anything that is nested too deep to be parsed. Such a
//! value matters only if the geometry uses it: it is then reported there as malformed.

use crate::base::progress::Cancel;

/// Depth of lists and objects that the parser reads, with a reserve. Geometry uses fewer than ten.
const DEEPEST: usize = 100;

/// Number of words, texts and signs between two checks for a cancel.
const TOGETHER: usize = 1 << 16;

/// Returns the text with such values replaced by `null`, or `None` if there are none, if there is no memory for another
/// text, or once cancelled.
pub(crate) fn repaired(text: &str, cancel: &Cancel) -> Option<String> {
    let mut repaired = String::new();
    repaired.try_reserve_exact(text.len()).ok()?;
    let (mut rest, mut depth, mut replaced, mut count) = (text, 0usize, false, 0usize);
    while let Some(first) = rest.chars().next() {
        count += 1;
        if count.is_multiple_of(TOGETHER) && cancel.is_cancelled() {
            return None;
        }
        let len = match first {
            '"' => string(rest),
            '[' | '{' => {
                depth += 1;
                if depth > DEEPEST { nested(rest) } else { 1 }
            }
            c if is_of_word(c) => rest.find(|c| !is_of_word(c)).unwrap_or(rest.len()),
            c => c.len_utf8(),
        };
        let (token, behind) = rest.split_at(len);
        let is_unknown = match first {
            '[' | '{' if depth > DEEPEST => {
                depth -= 1;
                true
            }
            ']' | '}' => {
                depth = depth.saturating_sub(1);
                false
            }
            c => is_of_word(c) && is_no_number(token),
        };
        replaced |= is_unknown;
        repaired.push_str(if is_unknown { "null" } else { token });
        rest = behind;
    }
    replaced.then_some(repaired)
}

/// True for the characters of numbers and of `NaN`, `true` and the like.
fn is_of_word(c: char) -> bool {
    c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.')
}

/// True if a word is a number that JSON or a double does not know.
fn is_no_number(word: &str) -> bool {
    word.parse::<f64>().is_ok_and(|x| !x.is_finite())
}

/// Length of the string that `text` begins with.
fn string(text: &str) -> usize {
    let mut is_escaped = false;
    for (i, c) in text.bytes().enumerate().skip(1) {
        match c {
            _ if is_escaped => is_escaped = false,
            b'\\' => is_escaped = true,
            b'"' => return i + 1,
            _ => {}
        }
    }
    text.len()
}

/// Length of the list or object that `text` begins with.
fn nested(text: &str) -> usize {
    let (mut at, mut depth) = (0, 0usize);
    while let Some(c) = text.as_bytes().get(at) {
        match c {
            b'"' => at += string(&text[at..]) - 1,
            b'[' | b'{' => depth += 1,
            b']' | b'}' => depth -= 1,
            _ => {}
        }
        at += 1;
        if depth == 0 {
            return at;
        }
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn repaired(text: &str) -> Option<String> {
        super::repaired(text, &Cancel::new())
    }

    #[test]
    fn a_cancel_ends_the_repair() {
        let (text, cancel) = ("[NaN".to_owned() + &",1".repeat(TOGETHER), Cancel::new());
        assert!(super::repaired(&text, &cancel).is_some());
        cancel.cancel();
        assert!(super::repaired(&text, &cancel).is_none());
    }

    #[test]
    fn values_that_json_does_not_know_become_null() {
        let cases = [
            (r#"{"a":NaN,"b":[-Infinity,1e400,-1e999, 3]}"#, r#"{"a":null,"b":[null,null,null, 3]}"#),
            (r#"{"NaN":"1e400 \" NaN","é":nan}"#, r#"{"NaN":"1e400 \" NaN","é":null}"#),
        ];
        for (text, expected) in cases {
            assert_eq!(repaired(text).as_deref(), Some(expected));
        }
        for sound in [r#"{"a":[1e300,true,null,-0.5E-3],"b":"x\\"}"#, "", "\"", "{]}", "infinit", "[1e-400]"] {
            assert_eq!(repaired(sound), None, "{sound}");
        }
    }

    #[test]
    fn what_is_nested_too_deep_becomes_null() {
        let deep = |n: usize| format!("{}\"]{{\"{}", "[".repeat(n), "]".repeat(n));
        assert_eq!(repaired(&format!("{{\"a\":{},\"b\":1}}", deep(90))), None);
        let text = repaired(&format!("{{\"a\":{},\"b\":1}}", deep(200))).expect("a repair");
        let value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(value["b"], 1);
        // Unfinished.
        assert!(repaired(&"[".repeat(100_000)).is_some());
    }
}
