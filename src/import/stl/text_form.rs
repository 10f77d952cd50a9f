//! The text form: any number of solids, each with `solid`, facets of `vertex` lines, and `endsolid`.
//!
//! Programs leave out the ends of solids, write `end solid`, and put comments anywhere. Lines outside of facets that
//! are not understood are therefore skipped, with a note. A word of a facet where none can be is refused, because it
//! belongs to a triangle that would be lost.

use crate::base::error::{Place, Result};
use crate::import::batch::{Batch, Corners};
use crate::import::ignored::Ignored;
use crate::import::input::{Input, Parsed};
use crate::import::{MaterialDesc, MeshKey, PartDesc, Sink, UpAxis, stem, text};
use glam::DVec3;

/// Words of the file, independent of line breaks, without comments behind `#`.
struct Words<'a> {
    input: &'a mut Input,
    line: Vec<u8>,
    used: usize,
    /// True within a facet, where `//` and `;` begin comments as `#` does everywhere.
    in_facet: bool,
    ignored: Ignored,
}

/// Words with a meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Keyword {
    Solid,
    Facet,
    Outer,
    Loop,
    Vertex,
    EndLoop,
    EndFacet,
    EndSolid,
    /// `end`, as the first half of one of these.
    End,
    /// A colour between facets. Its meaning is not standardised.
    Colour,
    Other,
}

impl Keyword {
    fn of(word: &[u8]) -> Self {
        const ALL: [(&[u8], Keyword); 11] = [
            (b"vertex", Keyword::Vertex),
            (b"facet", Keyword::Facet),
            (b"outer", Keyword::Outer),
            (b"loop", Keyword::Loop),
            (b"endloop", Keyword::EndLoop),
            (b"endfacet", Keyword::EndFacet),
            (b"solid", Keyword::Solid),
            (b"endsolid", Keyword::EndSolid),
            (b"end", Keyword::End),
            (b"color", Keyword::Colour),
            (b"colour", Keyword::Colour),
        ];
        ALL.iter().find(|(text, _)| word.eq_ignore_ascii_case(text)).map_or(Keyword::Other, |(_, keyword)| *keyword)
    }
}

impl Words<'_> {
    /// Returns the next word, or `None` at the end of the file.
    fn next(&mut self) -> Parsed<Option<&[u8]>> {
        loop {
            let mut rest = &self.line[self.used..];
            let before = rest.len();
            match text::word(&mut rest).map(|word| (word.len(), self.is_comment(word))) {
                Some((len, false)) => {
                    self.used += before - rest.len();
                    return Ok(Some(&self.line[self.used - len..self.used]));
                }
                Some((len, true)) => {
                    let start = before - rest.len() - len;
                    if self.line[self.used + start] != b'#' {
                        self.ignored.add("comments within facets", self.input.line());
                    }
                    self.used = self.line.len();
                }
                None => {
                    self.line.clear();
                    self.used = 0;
                    match self.input.next_line()? {
                        Some(line) => self.line.extend_from_slice(line),
                        None => return Ok(None),
                    }
                    // Padding, also between facets.
                    self.line.iter_mut().filter(|b| **b == 0).for_each(|b| *b = b' ');
                }
            }
        }
    }

    fn is_comment(&self, word: &[u8]) -> bool {
        word[0] == b'#' || self.in_facet && (word[0] == b';' || word.starts_with(b"//"))
    }

    /// Skips numbers behind the three of a vertex, in its line.
    fn skip_numbers(&mut self) {
        let mut look = &self.line[self.used..];
        let mut extra = false;
        while text::word(&mut look).is_some_and(|word| text::double(word).is_some()) {
            self.used = self.line.len() - look.len();
            extra = true;
        }
        if extra {
            self.ignored.add("vertices with more than three numbers", self.input.line());
        }
    }

    /// Returns the meaning of the next word, with `end solid` as one word, and the word itself.
    fn keyword(&mut self) -> Parsed<Option<(Keyword, &[u8])>> {
        let Some(first) = self.next()?.map(Keyword::of) else { return Ok(None) };
        if first == Keyword::End {
            let mut look = &self.line[self.used..];
            let whole = match text::word(&mut look).map(Keyword::of) {
                Some(Keyword::Solid) => Some(Keyword::EndSolid),
                Some(Keyword::Facet) => Some(Keyword::EndFacet),
                Some(Keyword::Loop) => Some(Keyword::EndLoop),
                _ => None,
            };
            if let Some(whole) = whole {
                self.used = self.line.len() - look.len();
                return Ok(Some((whole, self.last_word())));
            }
        }
        Ok(Some((first, self.last_word())))
    }

    /// Returns the last word that was read.
    fn last_word(&self) -> &[u8] {
        let read = &self.line[..self.used];
        let start = read.iter().rposition(|b| b.is_ascii_whitespace()).map_or(0, |at| at + 1);
        &read[start..]
    }

    fn rest_of_line(&mut self) -> String {
        let rest = text::name(&self.line[self.used..]);
        self.used = self.line.len();
        rest
    }

    /// Returns the rest of the line as a name, up to the next data if the file has it in one line: a facet, or with
    /// `ended` a solid that has one.
    fn name(&mut self, ended: bool) -> String {
        let rest = &self.line[self.used..];
        let (mut look, mut solid, mut facet) = (rest, None, None);
        while let Some(word) = text::word(&mut look) {
            let start = rest.len() - look.len() - word.len();
            if let Some(facet) = facet.filter(|_| word.eq_ignore_ascii_case(b"normal") && is_vector(look)) {
                let data = solid.filter(|_| ended).unwrap_or(facet);
                let name = text::name(&rest[..data]);
                self.used += data;
                return name;
            }
            let keyword = Keyword::of(word);
            facet = (keyword == Keyword::Facet).then_some(start);
            solid = solid.or((keyword == Keyword::Solid).then_some(start));
        }
        self.rest_of_line()
    }

    fn expect(&mut self, keyword: Keyword, name: &str) -> Parsed<()> {
        match self.keyword()? {
            Some((found, _)) if found == keyword => Ok(()),
            Some((_, word)) => Err(format!("expected \"{name}\", found {}", text::shown(word)).into()),
            None => Err(format!("expected \"{name}\", found the end of the file").into()),
        }
    }

    fn number(&mut self) -> Parsed<f64> {
        match self.next()? {
            Some(word) => match text::double(word).or_else(|| text::double(text::before_comment(word)?)) {
                Some(number) => {
                    if word.contains(&b'#') {
                        self.used = self.line.len();
                    }
                    Ok(number)
                }
                None => Err(text::not_a_number(word).into()),
            },
            None => Err("the file ends inside a vertex".into()),
        }
    }
}

/// True if a line goes on with three numbers: the name of a solid may have the words of a facet.
fn is_vector(mut rest: &[u8]) -> bool {
    (0..3).all(|_| text::word(&mut rest).is_some_and(|word| text::double(word).is_some()))
}

/// Reads a text STL file from its beginning.
pub(crate) fn read(input: &mut Input, sink: &mut dyn Sink) -> Result<()> {
    sink.units(None, UpAxis::Z);
    let words = Words { input, line: Vec::new(), used: 0, in_facet: false, ignored: Ignored::default() };
    let mut solids = Solids { words, batch: None, triangles: 0, without_area: 0 };
    let outcome = solids.read(sink);
    let Solids { triangles, without_area, words, .. } = solids;
    let ignored = words.ignored;
    outcome.map_err(|fault| fault.at(input.path(), Place::Line(input.line())))?;
    ignored.note(input.path(), sink);
    let file = input.path().display();
    if without_area > 0 {
        sink.note(format!("{file}: {without_area} facets with fewer than three corners make no triangle"));
    }
    if triangles == 0 {
        sink.note(format!("{file}: no triangles; the model is empty"));
    }
    Ok(())
}

/// The solids of a file, while they are read.
struct Solids<'a> {
    words: Words<'a>,
    /// Triangles of the present part; `None` before the first part.
    batch: Option<Batch>,
    triangles: u64,
    /// Number of facets that yield no triangle.
    without_area: u64,
}

impl Solids<'_> {
    fn read(&mut self, sink: &mut dyn Sink) -> Parsed<()> {
        let mut inside = false;
        while let Some((keyword, word)) = self.words.keyword()? {
            let shown = text::shown(word);
            let line = self.words.input.line();
            match keyword {
                Keyword::Solid => {
                    if inside {
                        self.words.ignored.add("missing \"endsolid\"", line);
                    }
                    let name = self.words.name(false);
                    self.begin(name, sink)?;
                    inside = true;
                }
                Keyword::EndSolid => {
                    self.words.name(true);
                    inside = false;
                }
                Keyword::Facet => {
                    if !inside {
                        self.words.ignored.add("missing \"solid\"", line);
                        self.begin(String::new(), sink)?;
                        inside = true;
                    }
                    self.words.in_facet = true;
                    self.facet(sink)?;
                    self.words.in_facet = false;
                }
                Keyword::Colour => drop(self.words.rest_of_line()),
                Keyword::Other | Keyword::End => {
                    self.words.rest_of_line();
                    self.words.ignored.add(&format!("lines with {shown}"), line);
                }
                _ => return Err(format!("expected \"facet\" or \"endsolid\", found {shown}").into()),
            }
        }
        if inside {
            let line = self.words.input.line();
            self.words.ignored.add("missing \"endsolid\" at the end of the file, which may have been cut short", line);
        }
        if let Some(batch) = &mut self.batch {
            batch.flush(sink)?;
        }
        Ok(())
    }

    /// Begins a part, with the name of the file if it has no own.
    fn begin(&mut self, name: String, sink: &mut dyn Sink) -> Parsed<()> {
        let name = if name.is_empty() { stem(self.words.input.path()) } else { name };
        let part = sink.part(PartDesc { name, ..PartDesc::default() })?;
        let batch = self.batch.get_or_insert_with(|| Batch::new(part));
        Ok(batch.aim(MeshKey::DIRECT, part, MaterialDesc::default().colour, sink)?)
    }

    /// Reads the rest of a facet as a fan around its first corner.
    fn facet(&mut self, sink: &mut dyn Sink) -> Parsed<()> {
        self.skip_normal()?;
        self.words.expect(Keyword::Loop, "loop")?;
        let (mut first, mut last, mut corners) = (DVec3::NAN, DVec3::NAN, 0u64);
        loop {
            match self.words.keyword()? {
                Some((Keyword::Vertex, _)) => {}
                Some((Keyword::EndLoop, _)) => break,
                Some((_, word)) => {
                    return Err(format!("expected \"vertex\" or \"endloop\", found {}", text::shown(word)).into());
                }
                None => return Err("the file ends inside a facet".into()),
            }
            let words = &mut self.words;
            let corner = DVec3::new(words.number()?, words.number()?, words.number()?);
            words.skip_numbers();
            if corners == 0 {
                first = corner;
            } else if corners > 1
                && let Some(batch) = &mut self.batch
            {
                self.triangles += 1;
                if batch.push([first, last, corner], Corners::default()) {
                    sink.at(self.words.input.offset(), self.words.input.total());
                    batch.flush(sink)?;
                }
            }
            last = corner;
            corners += 1;
        }
        self.words.expect(Keyword::EndFacet, "endfacet")?;
        self.without_area += u64::from(corners < 3);
        Ok(())
    }

    /// Skips everything up to the word `outer`: the normal is not used, so it may be anything.
    fn skip_normal(&mut self) -> Parsed<()> {
        loop {
            match self.words.keyword()? {
                Some((Keyword::Outer, _)) => return Ok(()),
                Some((Keyword::Other, _)) => {}
                Some((_, word)) => return Err(format!("expected \"outer\", found {}", text::shown(word)).into()),
                None => return Err("expected \"outer\", found the end of the file".into()),
            }
        }
    }
}
