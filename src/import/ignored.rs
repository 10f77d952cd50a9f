//! Data of text files that is not understood, or not used, and is skipped.

use super::Sink;
use std::collections::BTreeMap;
use std::path::Path;

/// Number of kinds that are told apart: a file with only unknown words must not fill memory with them.
const KINDS: usize = 16;

/// Kinds of skipped data, each with its number and the line of the first.
#[derive(Debug, Default)]
pub(crate) struct Ignored {
    kinds: BTreeMap<String, (u64, u64)>,
    /// Number of all others, and the line of the first.
    others: Option<(u64, u64)>,
}

impl Ignored {
    /// Counts one more of `kind`.
    pub(crate) fn add(&mut self, kind: &str, line: u64) {
        if let Some(seen) = self.kinds.get_mut(kind) {
            seen.0 += 1;
        } else if self.kinds.len() < KINDS {
            self.kinds.insert(kind.to_owned(), (1, line));
        } else {
            self.others.get_or_insert((0, line)).0 += 1;
        }
    }

    /// Adds a note for the user, if anything was skipped.
    pub(crate) fn note(&self, file: &Path, sink: &mut dyn Sink) {
        if !self.kinds.is_empty() {
            let kinds = self.kinds.iter().map(|(kind, (n, line))| format!("{n} × {kind} (first in line {line})"));
            let others = self.others.map(|(n, line)| format!("{n} × of other kinds (first in line {line})"));
            let kinds: Vec<_> = kinds.chain(others).collect();
            sink.note(format!("{}: ignored: {}", file.display(), kinds.join(", ")));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::collect::Collector;

    #[test]
    fn kinds_that_are_too_many_are_counted_together() {
        let mut ignored = Ignored::default();
        (0..KINDS as u64 + 5).for_each(|i| ignored.add(&format!("kind {i:02}"), i + 1));
        ignored.add("kind 03", 99);
        let mut sink = Collector::default();
        ignored.note(Path::new("f"), &mut sink);
        let [note] = &sink.notes[..] else { panic!("{:?}", sink.notes) };
        assert!(note.contains("2 × kind 03 (first in line 4)"), "{note}");
        assert!(note.ends_with("5 × of other kinds (first in line 17)"), "{note}");
    }
}
