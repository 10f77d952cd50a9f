//! Expected answers: how many rays hit, and a hash of the bits of all hits, kept in `expected.toml` beside the
//! benchmarks.

use crate::failure::{Failure, Outcome};
use outcrop::query::{Hit, HitKind};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use xxhash_rust::xxh3::Xxh3;

/// Of one case at one setting.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Expected {
    pub hits: usize,
    /// In hexadecimal.
    pub hash: String,
}

impl Expected {
    /// Of closest hits, every member of which counts.
    pub fn of_hits(hits: &[Hit]) -> Self {
        let mut hash = Xxh3::new();
        for h in hits {
            let doubles = [h.t, h.position.x, h.position.y, h.position.z, h.t_free];
            doubles.iter().for_each(|v| hash.update(&v.to_le_bytes()));
            [h.part, h.instance, h.prim].iter().for_each(|v| hash.update(&v.to_le_bytes()));
            let singles = [h.normal.x, h.normal.y, h.normal.z, h.uv[0], h.uv[1], h.error];
            singles.iter().for_each(|v| hash.update(&v.to_le_bytes()));
            hash.update(&(h.kind as u32).to_le_bytes());
        }
        let hits = hits.iter().filter(|hit| hit.kind != HitKind::Miss).count();
        Self::of_hash(hits, hash.digest())
    }

    /// Of a hash of all that is looked at, and how many things that is.
    pub fn of_hash(count: usize, hash: u64) -> Self {
        Self { hits: count, hash: format!("{hash:016x}") }
    }

    /// Of bytes, one a ray or several a pixel, and the number of those that hit.
    pub fn of_bytes(hits: usize, bytes: &[u8]) -> Self {
        Self::of_hash(hits, xxhash_rust::xxh3::xxh3_64(bytes))
    }
}

impl fmt::Display for Expected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} hits of hash {}", self.hits, self.hash)
    }
}

/// All expected answers, by case.
pub struct Book {
    known: BTreeMap<String, Expected>,
    /// Whether they are written anew instead of compared.
    is_written: bool,
}

fn path() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("expected.toml")
}

impl Book {
    /// As it is on disk.
    pub fn open(is_written: bool) -> Result<Self, Failure> {
        let text = if path().is_file() { std::fs::read_to_string(path())? } else { String::new() };
        Ok(Self { known: parse(&text)?, is_written })
    }

    /// Compares, or takes note; a difference is a failure that says how to accept it.
    pub fn check(&mut self, id: &str, got: Expected) -> Outcome {
        if self.is_written {
            self.known.insert(id.into(), got);
            return Ok(());
        }
        let name = id.split('/').next().unwrap_or(id);
        let advice = format!("; after a meant change: make bench-expect, or for this one ONLY={name}");
        match self.known.get(id) {
            Some(wanted) if *wanted == got => Ok(()),
            Some(wanted) => Err(Failure::new(format!("{id}: wrong answers: {got}, expected are {wanted}{advice}"))),
            None => Err(Failure::new(format!("{id}: no answers are expected yet{advice}"))),
        }
    }

    /// Writes it, if it is to be.
    pub fn close(self) -> Outcome {
        if self.is_written {
            std::fs::write(path(), format(&self.known)?)?;
        }
        Ok(())
    }
}

fn parse(text: &str) -> Result<BTreeMap<String, Expected>, String> {
    toml::from_str(text).map_err(|e| format!("{}: {e}", path().display()))
}

/// One line a case: differences read well.
fn format(known: &BTreeMap<String, Expected>) -> Result<String, String> {
    let mut text = String::from("# Hits and a hash of their bits, of every case; written by `make bench-expect`.\n");
    for (id, Expected { hits, hash }) in known {
        text += &format!("\"{id}\" = {{ hits = {hits}, hash = \"{hash}\" }}\n");
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn book(is_written: bool) -> Book {
        Book { known: BTreeMap::new(), is_written }
    }

    #[test]
    fn the_book_of_this_folder_is_in_order() {
        let known = parse(&std::fs::read_to_string(path()).expect("expected.toml")).expect("answers");
        assert!(!known.is_empty() && known.values().all(|e| e.hash.len() == 16));
    }

    #[test]
    fn what_is_written_is_expected_and_nothing_else() {
        let hit = Hit { t: 1.0, kind: HitKind::Exact, ..Hit::MISS };
        let answers = Expected::of_hits(&[hit, Hit::MISS]);
        assert_eq!(answers.hits, 1);
        let mut new = book(true);
        new.check("a/b/PoE 0.5", answers.clone()).expect("noted");
        let known = parse(&format(&new.known).expect("text")).expect("the same");
        let mut old = Book { known, is_written: false };
        old.check("a/b/PoE 0.5", answers).expect("as expected");
        assert!(old.check("a/b/PoE 1", Expected::of_hits(&[])).expect_err("new").to_string().contains("no answers"));
        for changed in [Hit { t: 1.0f64.next_up(), ..hit }, Hit { prim: 1, ..hit }, Hit { kind: HitKind::Lod, ..hit }] {
            let wrong = old.check("a/b/PoE 0.5", Expected::of_hits(&[changed, Hit::MISS]));
            assert!(wrong.expect_err("other bits").to_string().contains("wrong answers"));
        }
    }
}
