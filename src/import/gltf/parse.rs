//! Parsing of JSON that can be cancelled: a large document takes seconds.

use crate::base::progress::Cancel;
use serde_core::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};
use std::fmt;

/// Parses a JSON text. Fails with an error of the parser, also if the work was cancelled meanwhile.
pub(crate) fn value(text: &str, cancel: &Cancel) -> Result<Value, serde_json::Error> {
    let mut parser = serde_json::Deserializer::from_str(text);
    let value = Any(cancel).deserialize(&mut parser)?;
    parser.end()?;
    Ok(value)
}

/// Any value, as [`Value`] itself is parsed, with a check of the flag for each member and item.
#[derive(Clone, Copy)]
struct Any<'a>(&'a Cancel);

impl<'de> DeserializeSeed<'de> for Any<'_> {
    type Value = Value;
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl Any<'_> {
    fn check<E: Error>(self) -> Result<(), E> {
        self.0.check().map_err(E::custom)
    }
}

impl<'de> Visitor<'de> for Any<'_> {
    type Value = Value;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("any valid JSON value")
    }
    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Bool(value))
    }
    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(Value::Number(value.into()))
    }
    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(Value::Number(value.into()))
    }
    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(Number::from_f64(value).map_or(Value::Null, Value::Number))
    }
    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(Value::String(value.to_owned()))
    }
    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(item) = items.next_element_seed(self)? {
            self.check()?;
            list.push(item);
        }
        Ok(Value::Array(list))
    }
    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(key) = members.next_key::<String>()? {
            self.check()?;
            object.insert(key, members.next_value_seed(self)?);
        }
        Ok(Value::Object(object))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_of_the_library_and_a_cancel_ends_the_parsing() {
        let cancel = Cancel::new();
        let fine =
            r#" {"a":[1,-2,3.5,1e300,18446744073709551615,1e99,null,true,"\u00e9\n",[],{}],"b":{"c":{}},"a":2} "#;
        assert_eq!(value(fine, &cancel).unwrap(), serde_json::from_str::<Value>(fine).unwrap());
        let deep = "[".repeat(200);
        for bad in ["", "{", "[1,]", "{\"a\":1}x", "1e999", "nul", deep.as_str(), "{\"a\":\n\n01}"] {
            let errors =
                [value(bad, &cancel), serde_json::from_str(bad)].map(|outcome| outcome.unwrap_err().to_string());
            assert_eq!(errors[0], errors[1], "{bad}");
        }
        cancel.cancel();
        assert!(value(fine, &cancel).unwrap_err().to_string().contains("cancelled"));
    }
}
