//! Parsing of JSON that can be cancelled: a large document takes seconds.

use super::model::{Items, Model};
use crate::base::progress::Cancel;
use serde_core::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};
use std::fmt;

/// Parses a document: the model, and the members that are no lists of objects. (All objects as values would take three
/// times the memory, and freeing them after a cancel takes half a second for a million nodes.) Fails with an error of
/// the parser, also if the work was cancelled meanwhile.
pub(crate) fn document(text: &str, cancel: &Cancel) -> Result<(Model, Value), serde_json::Error> {
    let (mut parser, mut model) = (serde_json::Deserializer::from_str(text), Model::new());
    let rest = Root { model: &mut model, any: Any(cancel) }.deserialize(&mut parser)?;
    parser.end()?;
    model.read_rest(&rest);
    Ok((model, rest))
}

/// Members of a document that are read as they are.
const KEPT: [&str; 6] = ["asset", "scene", "extensions", "extensionsRequired", "geometricError", "root"];

/// The document, whose lists go to the model. All other members but those of [`KEPT`] are dropped.
struct Root<'a> {
    model: &'a mut Model,
    any: Any<'a>,
}

impl<'de> DeserializeSeed<'de> for Root<'_> {
    type Value = Value;
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Root<'_> {
    type Value = Value;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.any.expecting(f)
    }
    fn visit_bool<E: Error>(self, value: bool) -> Result<Value, E> {
        self.any.visit_bool(value)
    }
    fn visit_i64<E: Error>(self, value: i64) -> Result<Value, E> {
        self.any.visit_i64(value)
    }
    fn visit_u64<E: Error>(self, value: u64) -> Result<Value, E> {
        self.any.visit_u64(value)
    }
    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        self.any.visit_f64(value)
    }
    fn visit_str<E: Error>(self, value: &str) -> Result<Value, E> {
        self.any.visit_str(value)
    }
    fn visit_unit<E: Error>(self) -> Result<Value, E> {
        self.any.visit_unit()
    }
    fn visit_seq<A: SeqAccess<'de>>(self, items: A) -> Result<Value, A::Error> {
        self.any.visit_seq(items)
    }
    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut rest = Map::new();
        while let Some(key) = members.next_key::<String>()? {
            self.any.check()?;
            if let Some(list) = self.model.list(&key) {
                list.clear();
                members.next_value_seed(Objects { list, any: self.any })?;
                continue;
            }
            let value = members.next_value_seed(self.any)?;
            if KEPT.contains(&key.as_str()) {
                rest.insert(key, value);
            }
        }
        Ok(Value::Object(rest))
    }
}

/// The objects of a list. Anything else than a list has none.
struct Objects<'a> {
    list: &'a mut dyn Items,
    any: Any<'a>,
}

impl<'de> DeserializeSeed<'de> for Objects<'_> {
    type Value = ();
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Objects<'_> {
    type Value = ();
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.any.expecting(f)
    }
    fn visit_bool<E>(self, _: bool) -> Result<(), E> {
        Ok(())
    }
    fn visit_i64<E>(self, _: i64) -> Result<(), E> {
        Ok(())
    }
    fn visit_u64<E>(self, _: u64) -> Result<(), E> {
        Ok(())
    }
    fn visit_f64<E>(self, _: f64) -> Result<(), E> {
        Ok(())
    }
    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }
    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<(), A::Error> {
        while let Some(item) = items.next_element_seed(self.any)? {
            self.any.check()?;
            self.list.push(&item);
        }
        Ok(())
    }
    fn visit_map<A: MapAccess<'de>>(self, members: A) -> Result<(), A::Error> {
        self.any.visit_map(members).map(drop)
    }
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

    fn value(text: &str, cancel: &Cancel) -> Result<Value, serde_json::Error> {
        let mut parser = serde_json::Deserializer::from_str(text);
        let value = Any(cancel).deserialize(&mut parser)?;
        parser.end()?;
        Ok(value)
    }

    #[test]
    fn values_are_those_of_the_library_and_a_cancel_ends_the_parsing() {
        let cancel = Cancel::new();
        let fine =
            r#" {"a":[1,-2,3.5,1e300,18446744073709551615,1e99,null,true,"\u00e9\n",[],{}],"b":{"c":{}},"a":2} "#;
        assert_eq!(value(fine, &cancel).unwrap(), serde_json::from_str::<Value>(fine).unwrap());
        let deep = "[".repeat(200);
        for bad in ["", "{", "[1,]", "{\"a\":1}x", "1e999", "nul", deep.as_str(), "{\"a\":\n\n01}"] {
            let error = serde_json::from_str::<Value>(bad).unwrap_err().to_string();
            assert_eq!(value(bad, &cancel).unwrap_err().to_string(), error, "{bad}");
            assert_eq!(document(bad, &cancel).err().expect(bad).to_string(), error);
        }
        cancel.cancel();
        assert!(value(fine, &cancel).unwrap_err().to_string().contains("cancelled"));
        assert!(document(fine, &cancel).err().expect("cancelled").to_string().contains("cancelled"));
    }

    #[test]
    fn the_last_of_equal_members_counts_and_a_list_may_be_anything() {
        let read = |text: &str| document(text, &Cancel::new()).expect(text);
        for (text, count) in [
            (r#"{"nodes":[{},{}]}"#, 2),
            (r#"{"nodes":[{},{}],"nodes":[{}]}"#, 1),
            (r#"{"nodes":[{},{}],"nodes":null}"#, 0),
            (r#"{"nodes":{"a":[{}]}}"#, 0),
            (r#"{"nodes":"x","nodes":-1,"nodes":1,"nodes":1.5,"nodes":true}"#, 0),
            ("[]", 0),
            ("3", 0),
        ] {
            assert_eq!(read(text).0.nodes.len(), count, "{text}");
        }
        let (_, rest) = read(r#"{"asset":{"version":"2.0"},"extras":[1],"scene":0}"#);
        assert_eq!(rest.to_string(), r#"{"asset":{"version":"2.0"},"scene":0}"#);
        assert!(document("{\"nodes\":[{]}", &Cancel::new()).is_err());
    }
}
