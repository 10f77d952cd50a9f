//! The text form: `solid`, facets of `vertex` lines, `endsolid`, any number of times.

use crate::base::error::Result;
use crate::import::batch::Batch;
use crate::import::input::{Input, Parsed};
use crate::import::{MaterialDesc, MeshKey, PartDesc, Sink, UpAxis, stem, text};
use glam::DVec3;

/// Words across lines.
struct Words<'a> {
    input: &'a mut Input,
    line: Vec<u8>,
    used: usize,
}

impl Words<'_> {
    /// The next word, or `None` at the end of the file.
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
            Some(word) => Err(format!("{} where \"{keyword}\" belongs", text::shown(word)).into()),
            None => Err(format!("the file ends where \"{keyword}\" belongs").into()),
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

/// All solids; how many triangles, and how many facets that are none.
fn solids(words: &mut Words<'_>, sink: &mut dyn Sink) -> Parsed<(u64, u64)> {
    let mut batch: Option<Batch> = None;
    let (mut triangles, mut without_area) = (0, 0);
    while let Some(word) = words.next()? {
        if !word.eq_ignore_ascii_case(b"solid") {
            return Err(format!("{} where \"solid\" belongs", text::shown(word)).into());
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

/// Whether another facet begins; `false` past the solid's end.
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
        // Some writers put a colour between the facets; nobody agrees what it colours.
        if !(word.eq_ignore_ascii_case(b"color") || word.eq_ignore_ascii_case(b"colour")) {
            return Err(format!("{} where \"facet\" or \"endsolid\" belongs", text::shown(word)).into());
        }
        words.rest_of_line();
    }
}

/// The rest of a facet, as a fan from its first corner; how many triangles it has.
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
            Some(word) => return Err(format!("{} where \"vertex\" or \"endloop\" belongs", text::shown(word)).into()),
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
