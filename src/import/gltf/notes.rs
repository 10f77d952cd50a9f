//! Notes for the user about data that was left out, with the number of cases and the first one.

/// Notes in the order in which they first arose.
#[derive(Default)]
pub(crate) struct Notes {
    entries: Vec<(&'static str, u64, String)>,
}

impl Notes {
    /// Counts a case of `text`, which continues a sentence that begins with the number of cases.
    pub(crate) fn add(&mut self, text: &'static str, example: impl FnOnce() -> String) {
        match self.entries.iter_mut().find(|entry| entry.0 == text) {
            Some(entry) => entry.1 += 1,
            None => self.entries.push((text, 1, example())),
        }
    }

    /// Returns the notes as texts.
    pub(crate) fn texts(&self) -> impl Iterator<Item = String> {
        self.entries.iter().map(|(text, count, example)| match (example.is_empty(), count) {
            (true, _) => format!("{count} {text}"),
            (false, 1) => format!("{count} {text} ({example})"),
            (false, _) => format!("{count} {text} (the first: {example})"),
        })
    }
}
