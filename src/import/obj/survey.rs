//! The first reading of an OBJ file: its objects, groups and materials, and their use by faces.

use super::lines::Lines;
use crate::base::account::Claim;
use crate::base::error::Result;
use crate::import::Sink;
use crate::import::input::Input;
use crate::import::text;
use std::collections::HashMap;
use std::hash::{BuildHasher, Hash, RandomState};
use std::rc::Rc;

/// Distinct values in the order of their first occurrence.
pub(crate) struct Ordered<T> {
    /// The indices of the values, in [`TABLES`] tables: one that grows is hashed again as a whole, which takes too long
    /// for a million values.
    index: Vec<HashMap<T, u32>>,
    hasher: RandomState,
    pub(crate) items: Vec<T>,
}

const TABLES: usize = 64;

impl<T: Clone + Eq + Hash> Ordered<T> {
    fn new() -> Self {
        let index = (0..TABLES).map(|_| HashMap::new()).collect();
        Self { index, hasher: RandomState::new(), items: Vec::new() }
    }

    fn table(&self, item: &T) -> usize {
        self.hasher.hash_one(item) as usize % TABLES
    }

    /// Returns the index of a value that was added before.
    pub(crate) fn find(&self, item: &T) -> Option<u32> {
        self.index[self.table(item)].get(item).copied()
    }

    /// Returns the index of a value, which is added if it is new.
    fn place(&mut self, item: T) -> u32 {
        let (next, table) = (self.items.len() as u32, self.table(&item));
        let items = &mut self.items;
        *self.index[table].entry(item).or_insert_with_key(|item| {
            items.push(item.clone());
            next
        })
    }
}

/// Object and group, as indices into `names`.
pub(crate) type Group = (Option<u32>, Option<u32>);

/// Objects, groups and materials of a file's faces.
pub(crate) struct Survey {
    /// Names as bytes: their coding is unknown, and different names must stay different.
    pub(crate) names: Ordered<Rc<[u8]>>,
    /// Groups that have faces.
    pub(crate) groups: Ordered<Group>,
    /// Every combination that has faces: the index of a group, and of a material's name.
    pub(crate) uses: Ordered<(u32, Option<u32>)>,
    /// Index into `uses` for each run of faces between changes of object, group or material.
    pub(crate) runs: Vec<u32>,
    /// Library names of the `mtllib` lines.
    pub(crate) libraries: Ordered<Rc<[u8]>>,
    /// Sum of the lengths of all names.
    name_bytes: u64,
    /// The memory of the survey, and of the declaration of parts that follows it.
    claim: Claim,
    claimed: u64,
}

/// Reads the whole file from its beginning.
pub(crate) fn read(input: &mut Input, claim: Claim, sink: &mut dyn Sink) -> Result<Survey> {
    let mut survey = Survey {
        names: Ordered::new(),
        groups: Ordered::new(),
        uses: Ordered::new(),
        runs: Vec::new(),
        libraries: Ordered::new(),
        name_bytes: 0,
        claim,
        claimed: 0,
    };
    let mut group: Group = (None, None);
    let mut material = None;
    let mut in_run = false;
    let mut lines = Lines::default();
    let mut count = 0u64;
    loop {
        count += 1;
        if count.is_multiple_of(4096) {
            sink.cancel().check()?;
        }
        let Some(line) = lines.next(input)? else { break };
        let keyword = keyword(line);
        let has_grown = !matches!(keyword, Keyword::Face | Keyword::Other) || !in_run;
        match keyword {
            Keyword::Face if !in_run => {
                let group = survey.groups.place(group);
                survey.runs.push(survey.uses.place((group, material)));
                in_run = true;
            }
            Keyword::Object(name) => {
                group = (survey.name(name), None);
                in_run = false;
            }
            Keyword::Group(name) => {
                group.1 = survey.name(if name.is_empty() { b"default" } else { name });
                in_run = false;
            }
            Keyword::Material(name) => {
                material = survey.name(name);
                in_run = false;
            }
            Keyword::Library(name) => {
                survey.libraries.place(name.into());
                survey.name_bytes += name.len() as u64;
            }
            Keyword::Face | Keyword::Other => {}
        }
        if has_grown && !survey.fits() {
            let done = input.offset() as f64 / input.total().max(1) as f64;
            let what = format!("reading the names and groups of {}", input.path().display());
            return Err(survey.claim.over(done, survey.parts_bytes(), what));
        }
    }
    Ok(survey)
}

impl Survey {
    fn name(&mut self, name: &[u8]) -> Option<u32> {
        if name.is_empty() {
            return None;
        }
        let (before, index) = (self.names.items.len(), self.names.place(name.into()));
        if self.names.items.len() > before {
            self.name_bytes += name.len() as u64;
        }
        Some(index)
    }

    /// Memory of the parts in the sink, about: one for each group, and for each material of a group with several, with
    /// their names.
    fn parts_bytes(&self) -> u64 {
        let (groups, uses) = (self.groups.items.len(), self.uses.items.len());
        self.name_bytes + 250 * if uses > groups { groups + uses } else { groups } as u64
    }

    /// Counts the memory so far. Returns `false` if it does not fit.
    fn fits(&mut self) -> bool {
        // Bytes of each in its list, its index, and in the declaration of parts.
        let each = [(self.names.items.len(), 120), (self.groups.items.len(), 100), (self.uses.items.len(), 170)];
        let each = each.into_iter().chain([(self.runs.len(), 10), (self.libraries.items.len(), 160)]);
        let bytes = self.name_bytes + each.map(|(count, bytes)| count as u64 * bytes).sum::<u64>();
        let more = bytes - self.claimed;
        self.claimed = bytes;
        self.claim.grow(more)
    }
}

/// Keywords that are relevant for parts.
pub(crate) enum Keyword<'a> {
    Face,
    Object(&'a [u8]),
    Group(&'a [u8]),
    Material(&'a [u8]),
    Library(&'a [u8]),
    Other,
}

/// Classifies a line. Both readings use this function, so that they agree on the beginnings of runs.
#[inline]
pub(crate) fn keyword(line: &[u8]) -> Keyword<'_> {
    match line.first() {
        Some(b'f' | b'o' | b'g' | b'u' | b'm') => keyword_by_word(line),
        _ => Keyword::Other,
    }
}

fn keyword_by_word(line: &[u8]) -> Keyword<'_> {
    let mut rest = line;
    match text::word(&mut rest) {
        Some(b"f" | b"fo") => Keyword::Face,
        Some(b"o") => Keyword::Object(rest.trim_ascii()),
        Some(b"g") => Keyword::Group(rest.trim_ascii()),
        Some(b"usemtl") => Keyword::Material(rest.trim_ascii()),
        Some(b"mtllib") => Keyword::Library(rest.trim_ascii()),
        _ => Keyword::Other,
    }
}
