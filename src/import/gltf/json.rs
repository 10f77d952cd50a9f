//! Members of JSON objects, read leniently: a `null` counts as missing, and an integer may be written as 36.0.

use serde_json::Value;

/// The result of reading a member; the error names the member.
pub(crate) type Read<T> = Result<T, String>;

/// Returns a member that is present and not `null`.
pub(crate) fn member<'v>(object: &'v Value, key: &str) -> Option<&'v Value> {
    object.get(key).filter(|value| !value.is_null())
}

/// Returns a non-negative integer, also one that is written with a fraction of zero or an exponent.
pub(crate) fn whole(value: &Value) -> Option<u64> {
    let written_otherwise = || value.as_f64().filter(|x| x.fract() == 0.0 && (0.0..1e15).contains(x)).map(|x| x as u64);
    value.as_u64().or_else(written_otherwise)
}

/// Returns a member that is a non-negative integer, or `None` if it is missing.
pub(crate) fn integer(object: &Value, key: &str) -> Read<Option<u64>> {
    let read = |value| whole(value).ok_or_else(|| format!("\"{key}\" is {}, not a whole number", shown(value)));
    member(object, key).map(read).transpose()
}

/// Returns a member that must be a non-negative integer.
pub(crate) fn required(object: &Value, key: &str) -> Read<u64> {
    integer(object, key)?.ok_or_else(|| format!("has no \"{key}\""))
}

/// Returns a member that is an index, or `None` if it is missing.
pub(crate) fn index(object: &Value, key: &str) -> Read<Option<usize>> {
    let read = |value| whole_index(value).ok_or_else(|| format!("\"{key}\" is {}, not an index", shown(value)));
    member(object, key).map(read).transpose()
}

/// True if a member is -1, which some programs write instead of leaving an index out.
pub(crate) fn is_none(object: &Value, key: &str) -> bool {
    object.get(key).and_then(Value::as_f64) == Some(-1.0)
}

/// Returns a member that is an index, or `None` if it is missing or -1.
pub(crate) fn index_or_none(object: &Value, key: &str) -> Read<Option<usize>> {
    if is_none(object, key) { Ok(None) } else { index(object, key) }
}

/// Returns a member that is a list of indices; it is empty if it is missing.
pub(crate) fn indices(object: &Value, key: &str) -> Read<Vec<usize>> {
    let Some(value) = member(object, key) else { return Ok(Vec::new()) };
    let list = value.as_array().and_then(|list| list.iter().map(whole_index).collect());
    list.ok_or_else(|| format!("\"{key}\" is not a list of indices"))
}

/// Returns a member that is a list of `N` numbers, or `None` if it is missing.
pub(crate) fn numbers<const N: usize>(object: &Value, key: &str) -> Read<Option<[f64; N]>> {
    let read = |value: &Value| {
        let list = value.as_array().filter(|list| list.len() == N)?;
        let mut numbers = [0.0; N];
        for (number, value) in numbers.iter_mut().zip(list) {
            *number = value.as_f64()?;
        }
        Some(numbers)
    };
    let malformed = || format!("\"{key}\" is not a list of {N} numbers");
    member(object, key).map(|value| read(value).ok_or_else(malformed)).transpose()
}

/// Returns the items of a list; none if the member is missing or not a list.
pub(crate) fn items<'v>(object: &'v Value, key: &str) -> &'v [Value] {
    object.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// Returns a member that is a number, else `or`.
pub(crate) fn number(object: &Value, key: &str, or: f64) -> f64 {
    object.get(key).and_then(Value::as_f64).unwrap_or(or)
}

/// Returns a member that is a text.
pub(crate) fn text(object: &Value, key: &str) -> Option<Box<str>> {
    object.get(key).and_then(Value::as_str).map(Box::from)
}

/// Returns an extension of an object.
pub(crate) fn extension<'v>(object: &'v Value, name: &str) -> Option<&'v Value> {
    member(member(object, "extensions")?, name)
}

fn whole_index(value: &Value) -> Option<usize> {
    whole(value).and_then(|n| usize::try_from(n).ok())
}

/// Returns the beginning of a value, for messages.
pub(crate) fn shown(value: &Value) -> String {
    value.to_string().chars().take(40).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn integers_are_read_in_every_form() {
        let object = json!({ "a": 36, "b": 36.0, "c": 3.6e1, "d": 36.5, "e": -1, "f": "36", "g": null, "h": 1e300 });
        for key in ["a", "b", "c"] {
            assert_eq!(integer(&object, key), Ok(Some(36)), "{key}");
        }
        for key in ["d", "e", "f", "h"] {
            assert!(index(&object, key).unwrap_err().starts_with(&format!("\"{key}\" is ")), "{key}");
        }
        assert_eq!((integer(&object, "g"), index(&object, "i")), (Ok(None), Ok(None)));
        assert_eq!(integer(&json!({ "a": u64::MAX }), "a"), Ok(Some(u64::MAX)));
    }
}
