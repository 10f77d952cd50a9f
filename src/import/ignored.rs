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
}

impl Ignored {
    /// Counts one more of `kind`.
    pub(crate) fn add(&mut self, kind: &str, line: u64) {
        if let Some(seen) = self.kinds.get_mut(kind) {
            seen.0 += 1;
        } else if self.kinds.len() < KINDS {
            self.kinds.insert(kind.to_owned(), (1, line));
        }
    }

    /// Adds a note for the user, if anything was skipped.
    pub(crate) fn note(&self, file: &Path, sink: &mut dyn Sink) {
        if !self.kinds.is_empty() {
            let kinds = self.kinds.iter().map(|(kind, (n, line))| format!("{n} × {kind} (first in line {line})"));
            let kinds: Vec<_> = kinds.collect();
            sink.note(format!("{}: ignored: {}", file.display(), kinds.join(", ")));
        }
    }
}
