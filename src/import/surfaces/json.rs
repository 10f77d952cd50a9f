//! JSON objects and lists that are read one member or item at a time, so that no tree of values is in memory.

use serde_core::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use std::fmt;

/// A JSON object whose members are read one by one.
pub(super) trait Members {
    /// Reads the value of a member; false if it is not known.
    fn read<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<bool, A::Error>;
}

/// A JSON list whose items are read one by one.
pub(super) trait Items {
    /// Reads the next item; false at the end.
    fn read<'de, A: SeqAccess<'de>>(&mut self, items: &mut A) -> Result<bool, A::Error>;
}

/// Parses an object.
pub(super) struct Object<'a, T>(pub(super) &'a mut T);

impl<'de, T: Members> DeserializeSeed<'de> for Object<'_, T> {
    type Value = ();
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de, T: Members> Visitor<'de> for Object<'_, T> {
    type Value = ();
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }
    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<(), A::Error> {
        while let Some(key) = members.next_key::<String>()? {
            if !self.0.read(&key, &mut members)? {
                members.next_value::<IgnoredAny>()?;
            }
        }
        Ok(())
    }
}

/// Parses a list.
pub(super) struct List<'a, T>(pub(super) &'a mut T);

impl<'de, T: Items> DeserializeSeed<'de> for List<'_, T> {
    type Value = ();
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de, T: Items> Visitor<'de> for List<'_, T> {
    type Value = ();
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list")
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<(), A::Error> {
        while self.0.read(&mut items)? {}
        Ok(())
    }
}

/// A list of at most N numbers; of further ones only the number counts.
pub(super) struct Numbers<const N: usize> {
    pub(super) values: [f64; N],
    pub(super) count: usize,
}

impl<const N: usize> Default for Numbers<N> {
    fn default() -> Self {
        Self { values: [0.0; N], count: 0 }
    }
}

impl<const N: usize> Items for Numbers<N> {
    fn read<'de, A: SeqAccess<'de>>(&mut self, items: &mut A) -> Result<bool, A::Error> {
        let Some(number) = items.next_element()? else { return Ok(false) };
        if let Some(value) = self.values.get_mut(self.count) {
            *value = number;
        }
        self.count += 1;
        Ok(true)
    }
}
