//! The second reading of an OBJ file: vertices and faces.

use super::lines::Lines;
use super::parts::Parts;
use super::survey::{Keyword, keyword};
use crate::base::error::{Place, Result};
use crate::import::batch::Batch;
use crate::import::colour::{linear, mean3};
use crate::import::input::{Input, Parsed};
use crate::import::{MeshKey, Sink, text};
use glam::DVec3;
use std::collections::BTreeMap;

/// Keywords without geometry, or handled by the first reading: they are ignored without a note.
const SILENT: [&[u8]; 16] = [
    b"vt",
    b"vn",
    b"vp",
    b"s",
    b"mg",
    b"o",
    b"g",
    b"usemtl",
    b"mtllib",
    b"usemap",
    b"maplib",
    b"lod",
    b"bevel",
    b"c_interp",
    b"d_interp",
    b"shadow_obj",
];

struct Reader<'a> {
    parts: &'a Parts,
    positions: Vec<[f64; 3]>,
    /// Linear colours: either empty or as many as `positions`. NaN marks a vertex without a colour.
    colours: Vec<[f32; 3]>,
    corners: Vec<u32>,
    batch: Batch,
    /// Number of runs of faces begun, and a flag for being inside one.
    runs: usize,
    in_run: bool,
    triangles: u64,
    without_area: u64,
    /// Other lines by their first word: their number, and the line of the first.
    ignored: BTreeMap<String, (u64, u64)>,
}

/// Reads the whole file from its beginning; the triangles go to `parts`.
pub(crate) fn read(input: &mut Input, parts: &Parts, sink: &mut dyn Sink) -> Result<()> {
    let mut reader = Reader {
        parts,
        positions: Vec::new(),
        colours: Vec::new(),
        corners: Vec::new(),
        batch: Batch::new(0),
        runs: 0,
        in_run: false,
        triangles: 0,
        without_area: 0,
        ignored: BTreeMap::new(),
    };
    let mut lines = Lines::default();
    let mut count = 0u64;
    loop {
        count += 1;
        if count.is_multiple_of(16384) || reader.batch.is_full() {
            sink.at(input.offset(), input.total());
            sink.cancel().check()?;
        }
        let number = input.line() + 1;
        let Some(line) = lines.next(input)? else { break };
        let outcome = reader.line(line, number, sink);
        outcome.map_err(|fault| fault.at(input.path(), Place::Line(number)))?;
    }
    reader.batch.flush(sink)?;
    reader.report(input, sink);
    Ok(())
}

impl Reader<'_> {
    #[inline]
    fn line(&mut self, line: &[u8], number: u64, sink: &mut dyn Sink) -> Parsed<()> {
        match line {
            [b'v', b' ' | b'\t', rest @ ..] => return self.vertex(rest),
            [] | [b'#', ..] | [b'v', b'n' | b't', b' ' | b'\t', ..] => return Ok(()),
            _ => {}
        }
        match keyword(line) {
            Keyword::Face => self.face(line, sink)?,
            Keyword::Object(_) | Keyword::Group(_) | Keyword::Material(_) => self.in_run = false,
            Keyword::Library(_) => {}
            Keyword::Other => self.other(line, number),
        }
        Ok(())
    }

    fn vertex(&mut self, mut rest: &[u8]) -> Parsed<()> {
        let mut numbers = [0f64; 7];
        let mut n = 0;
        while n < 7
            && let Some(word) = text::word(&mut rest)
        {
            numbers[n] = text::double(word).ok_or_else(|| format!("{} is not a number", text::shown(word)))?;
            n += 1;
        }
        let [x, y, z, r, g, b, _] = numbers;
        if n < 3 {
            return Err("a vertex needs three coordinates".into());
        }
        if n >= 6 {
            self.colours.resize(self.positions.len(), [f32::NAN; 3]);
            self.colours.push([r, g, b].map(|c| linear(c as f32)));
        } else if !self.colours.is_empty() {
            self.colours.push([f32::NAN; 3]);
        }
        self.positions.push([x, y, z]);
        Ok(())
    }

    fn face(&mut self, line: &[u8], sink: &mut dyn Sink) -> Parsed<()> {
        if !self.in_run {
            let Some(target) = self.parts.run(self.runs) else {
                return Err("the file changed while it was being read".into());
            };
            self.batch.aim(MeshKey::DIRECT, target.part, target.colour, sink)?;
            self.runs += 1;
            self.in_run = true;
        }
        let mut rest = line;
        text::word(&mut rest);
        self.corners.clear();
        while let Some(word) = text::word(&mut rest) {
            self.corners.push(corner(word, self.positions.len())?);
        }
        self.without_area += u64::from(self.corners.len() < 3);
        for i in 2..self.corners.len() {
            self.triangle([self.corners[0], self.corners[i - 1], self.corners[i]]);
            if self.batch.is_full() {
                self.batch.flush(sink)?;
            }
        }
        Ok(())
    }

    #[inline]
    fn triangle(&mut self, corners: [u32; 3]) {
        let at = corners.map(|c| c as usize);
        let colour = if self.colours.is_empty() {
            None
        } else {
            Some(mean3(self.colours[at[0]], self.colours[at[1]], self.colours[at[2]])).filter(|c| !c[0].is_nan())
        };
        self.triangles += 1;
        self.batch.push(at.map(|i| DVec3::from(self.positions[i])), colour);
    }

    fn other(&mut self, line: &[u8], number: u64) {
        let mut rest = line;
        let word = text::word(&mut rest).unwrap_or(b"");
        // A file with only unknown words must not fill memory with them.
        if !SILENT.contains(&word) && self.ignored.len() < 16 {
            self.ignored.entry(text::shown(word)).or_insert((0, number)).0 += 1;
        } else if let Some(seen) = self.ignored.get_mut(&text::shown(word)) {
            seen.0 += 1;
        }
    }

    fn report(&self, input: &Input, sink: &mut dyn Sink) {
        let file = input.path().display();
        if !self.ignored.is_empty() {
            let kinds = self.ignored.iter().map(|(word, (n, line))| format!("{n} × {word} (first in line {line})"));
            let kinds: Vec<_> = kinds.collect();
            sink.note(format!("{file}: ignored lines: {}", kinds.join(", ")));
        }
        if self.without_area > 0 {
            let n = self.without_area;
            sink.note(format!("{file}: {n} faces with fewer than three corners make no triangle"));
        }
        if self.triangles == 0 {
            let n = self.positions.len();
            sink.note(format!("{file}: no triangles ({n} vertices); the model is empty"));
        }
    }
}

/// Returns the vertex index of a face corner `v`, `v/vt`, `v//vn` or `v/vt/vn`. `count` vertices are defined so far.
#[inline]
fn corner(word: &[u8], count: usize) -> Parsed<u32> {
    let digits = word.iter().position(|&b| b == b'/').unwrap_or(word.len());
    let Some(index) = text::integer(&word[..digits]) else {
        return Err(format!("{} is not a vertex", text::shown(word)).into());
    };
    let at = match index {
        1.. => index - 1,
        _ => index + count as i64,
    };
    match u32::try_from(at) {
        Ok(at) if (at as usize) < count && index != 0 => Ok(at),
        _ => Err(format!("vertex {index} is out of range: {count} are defined so far").into()),
    }
}
