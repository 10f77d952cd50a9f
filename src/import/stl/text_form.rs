//! The text form: any number of solids, each with `solid`, facets of `vertex` lines, and `endsolid`.

use crate::base::error::Result;
use crate::import::batch::Batch;
use crate::import::input::{Input, Parsed};
use crate::import::{MaterialDesc, MeshKey, PartDesc, Sink, UpAxis, stem, text};
use glam::DVec3;

/// Words of the file, independent of line breaks.
struct Words<'a> {
    input: &'a mut Input,
    line: Vec<u8>,
    used: usize,
}

impl Words<'_> {
    /// Returns the next word, or `None` at the end of the file.
    fn next(&mut self) -> Parsed<Option<&[u8]>> {
        loop {
            let mut rest = &self.line[self.used..];
            let before = rest.len();
            if let Some(len) = text::word(&mut rest).map(<[u8]>::len) {
                self.used += before - rest.len();
                return Ok(Some(&self.line[self.used - len..self.used]));
            }
            self.line.clear();
            self.used = 0;
            match self.input.next_line()? {
                Some(line) => self.line.extend_from_slice(line),
                None => return Ok(None),
            }
        }
    }

    fn rest_of_line(&mut self) -> String {
        let rest = text::name(&self.line[self.used..]);
        self.used = self.line.len();
        rest
    }

    fn expect(&mut self, keyword: &str) -> Parsed<()> {
        match self.next()? {
            Some(word) if word.eq_ignore_ascii_case(keyword.as_bytes()) => Ok(()),
            Some(word) => Err(format!("expected \"{keyword}\", found {}", text::shown(word)).into()),
            None => Err(format!("expected \"{keyword}\", found the end of the file").into()),
        }
    }

    fn number(&mut self) -> Parsed<f64> {
        match self.next()? {
            Some(word) => text::double(word).ok_or_else(|| format!("{} is not a number", text::shown(word)).into()),
            None => Err("the file ends inside a vertex".into()),
        }
    }
}

/// Reads a text STL file from its beginning.
pub(crate) fn read(input: &mut Input, sink: &mut dyn Sink) -> Result<()> {
    sink.units(None, UpAxis::Z);
    let mut words = Words { input, line: Vec::new(), used: 0 };
    let counts = solids(&mut words, sink);
    let place = crate::base::error::Place::Line(input.line());
    let (triangles, without_area) = counts.map_err(|fault| fault.at(input.path(), place))?;
    let file = input.path().display();
    if without_area > 0 {
        sink.note(format!("{file}: {without_area} facets with fewer than three corners make no triangle"));
    }
    if triangles == 0 {
        sink.note(format!("{file}: no triangles; the model is empty"));
    }
    Ok(())
}

/// Reads all solids. Returns the number of triangles and of facets that yield none.
fn solids(words: &mut Words<'_>, sink: &mut dyn Sink) -> Parsed<(u64, u64)> {
    let mut batch: Option<Batch> = None;
    let (mut triangles, mut without_area) = (0, 0);
    while let Some(word) = words.next()? {
        if !word.eq_ignore_ascii_case(b"solid") {
            return Err(format!("expected \"solid\", found {}", text::shown(word)).into());
        }
        let named = words.rest_of_line();
        let name = if named.is_empty() { stem(words.input.path()) } else { named };
        let part = sink.part(PartDesc { name, ..PartDesc::default() })?;
        let batch = batch.get_or_insert_with(|| Batch::new(part));
        batch.aim(MeshKey::DIRECT, part, MaterialDesc::default().colour, sink)?;
        while facet_follows(words)? {
            match facet(words, batch, sink)? {
                0 => without_area += 1,
                n => triangles += n,
            }
        }
        batch.flush(sink)?;
    }
    Ok((triangles, without_area))
}

/// Returns `true` if another facet begins, `false` after the end of the solid.
fn facet_follows(words: &mut Words<'_>) -> Parsed<bool> {
    loop {
        let Some(word) = words.next()? else {
            return Err("the file ends inside a solid".into());
        };
        if word.eq_ignore_ascii_case(b"facet") {
            return Ok(true);
        }
        if word.eq_ignore_ascii_case(b"endsolid") {
            words.rest_of_line();
            return Ok(false);
        }
        // Some writers put a colour between facets. Its meaning is not standardised, so it is ignored.
        if !(word.eq_ignore_ascii_case(b"color") || word.eq_ignore_ascii_case(b"colour")) {
            return Err(format!("expected \"facet\" or \"endsolid\", found {}", text::shown(word)).into());
        }
        words.rest_of_line();
    }
}

/// Reads the rest of a facet as a fan around its first corner. Returns the number of triangles.
fn facet(words: &mut Words<'_>, batch: &mut Batch, sink: &mut dyn Sink) -> Parsed<u64> {
    words.expect("normal")?;
    for _ in 0..3 {
        words.number()?;
    }
    words.expect("outer")?;
    words.expect("loop")?;
    let (mut first, mut last, mut corners) = (DVec3::NAN, DVec3::NAN, 0u64);
    loop {
        match words.next()? {
            Some(word) if word.eq_ignore_ascii_case(b"vertex") => {}
            Some(word) if word.eq_ignore_ascii_case(b"endloop") => break,
            Some(word) => return Err(format!("expected \"vertex\" or \"endloop\", found {}", text::shown(word)).into()),
            None => return Err("the file ends inside a facet".into()),
        }
        let corner = DVec3::new(words.number()?, words.number()?, words.number()?);
        if corners == 0 {
            first = corner;
        } else if corners > 1 && batch.push([first, last, corner], None) {
            sink.at(words.input.offset(), words.input.total());
            batch.flush(sink)?;
        }
        last = corner;
        corners += 1;
    }
    words.expect("endfacet")?;
    Ok(corners.saturating_sub(2))
}
