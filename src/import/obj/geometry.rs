//! The second reading of an OBJ file: vertices and faces.

use super::cage::Cage;
use super::lines::Lines;
use super::mtl::next_number;
use super::parts::{Painted, Parts};
use super::survey::{Keyword, keyword};
use crate::base::error::{Place, Result};
use crate::import::batch::{Batch, Corners};
use crate::import::colour::linear;
use crate::import::ignored::Ignored;
use crate::import::input::{Input, Parsed};
use crate::import::normals::Normals;
use crate::import::texture::Texture;
use crate::import::{MeshKey, ReadOptions, Sink, text};
use glam::DVec3;
use std::rc::Rc;

/// Keywords without geometry, or handled by the first reading: they are ignored without a note.
const SILENT: [&[u8]; 14] = [
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

/// Number of corners of a face between two checks for a cancel.
const CORNERS: usize = 1 << 16;

struct Reader<'a, 'f> {
    parts: &'a mut Parts<'f>,
    positions: Vec<[f64; 3]>,
    /// Linear colours: either empty or as many as `positions`. NaN marks a vertex without a colour.
    colours: Vec<[f32; 3]>,
    /// Value of a full channel of the vertices' colours: 1, or 255 after the first larger one.
    scale: f64,
    /// Texture coordinates; `None` if no part has a texture.
    coordinates: Option<Vec<[f32; 2]>>,
    normals: Normals,
    corners: Vec<Corner>,
    /// The faces, if they are the cage of a subdivision surface.
    cage: Option<Cage>,
    /// True if the cage needs texture coordinates.
    is_displaced: bool,
    /// The part of the present run of faces.
    part: u32,
    /// Texture of the present run of faces.
    texture: Option<(Painted, Rc<Texture>)>,
    batch: Batch,
    /// True if every corner of the present face has a normal.
    with_normals: bool,
    /// Number of runs of faces begun, and a flag for being inside one.
    runs: usize,
    in_run: bool,
    triangles: u64,
    without_area: u64,
    ignored: Ignored,
}

/// A corner of a face: the index of its vertex, and of its texture coordinates if there are any.
#[derive(Clone, Copy)]
struct Corner {
    vertex: u32,
    coordinates: Option<u32>,
    /// Index of its normal.
    normal: Option<u32>,
}

/// Reads the whole file from its beginning; the triangles go to `parts`, or the faces are a cage, as `options` say.
pub(crate) fn read(input: &mut Input, parts: &mut Parts<'_>, options: &ReadOptions, sink: &mut dyn Sink) -> Result<()> {
    let is_displaced = options.subdivide && options.displacement.is_some();
    let mut reader = Reader {
        coordinates: (is_displaced || !options.subdivide && parts.have_textures()).then(Vec::new),
        is_displaced,
        parts,
        positions: Vec::new(),
        colours: Vec::new(),
        scale: 1.0,
        normals: Normals::default(),
        corners: Vec::new(),
        cage: options.subdivide.then(Cage::default),
        part: 0,
        texture: None,
        batch: Batch::new(0),
        with_normals: false,
        runs: 0,
        in_run: false,
        triangles: 0,
        without_area: 0,
        ignored: Ignored::default(),
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
    if let Some(cage) = reader.cage.take() {
        cage.finish(&reader.positions, input.path(), options, sink)?;
    }
    reader.report(input, sink);
    Ok(())
}

impl Reader<'_, '_> {
    #[inline]
    fn line(&mut self, line: &[u8], number: u64, sink: &mut dyn Sink) -> Parsed<()> {
        match line {
            [b'v', b' ' | b'\t', rest @ ..] => return self.vertex(rest, number),
            [b'v', b't'] => return self.texture_vertex(b"", number),
            [b'v', b't', b' ' | b'\t', rest @ ..] => return self.texture_vertex(rest, number),
            [] | [b'#', ..] => return Ok(()),
            [b'v', b'n'] => return self.normal(b""),
            [b'v', b'n', b' ' | b'\t', rest @ ..] => return self.normal(rest),
            _ => {}
        }
        match keyword(line) {
            Keyword::Face => self.face(line, sink)?,
            Keyword::Object(_) | Keyword::Group(_) | Keyword::Material(_) => self.in_run = false,
            Keyword::Library(_) => {}
            Keyword::Other => self.other(line, number)?,
        }
        Ok(())
    }

    fn vertex(&mut self, mut rest: &[u8], number: u64) -> Parsed<()> {
        let mut numbers = [0f64; 7];
        let mut n = 0;
        while n < 7
            && let Some(word) = text::word(&mut rest)
        {
            let Some(value) = text::double(word) else {
                n += self.behind_vertex(word, n, number, &mut numbers)?;
                break;
            };
            numbers[n] = value;
            n += 1;
        }
        let [x, y, z, r, g, b, _] = numbers;
        if n < 3 {
            return Err("a vertex needs three coordinates".into());
        }
        if n >= 6 {
            if self.scale == 1.0 && [r, g, b].iter().any(|c| *c > 1.0) {
                self.scale = 255.0;
                self.ignored.add("vertex colours above 1: they are taken as 0 to 255 from there on", number);
            }
            self.colours.resize(self.positions.len(), [f32::NAN; 3]);
            self.colours.push([r, g, b].map(|c| linear((c / self.scale) as f32)));
        } else if !self.colours.is_empty() {
            self.colours.push([f32::NAN; 3]);
        }
        self.positions.push([x, y, z]);
        Ok(())
    }

    /// Reads texture coordinates, if they are needed. Invalid ones cost only the colour of their triangles.
    fn texture_vertex(&mut self, mut rest: &[u8], line: u64) -> Parsed<()> {
        let Some(coordinates) = &mut self.coordinates else { return Ok(()) };
        let mut next = || next_number(&mut rest);
        let Some(u) = next() else {
            self.ignored.add("invalid texture coordinates", line);
            coordinates.push([f32::NAN; 2]);
            return Ok(());
        };
        coordinates.push([u, next().unwrap_or(0.0)]);
        Ok(())
    }

    /// Reads a normal. One that cannot be used costs only the shape of its triangles' light.
    fn normal(&mut self, mut rest: &[u8]) -> Parsed<()> {
        let mut next = || next_number(&mut rest).unwrap_or(f32::NAN);
        self.normals.push([next(), next(), next()]);
        Ok(())
    }

    /// Handles a word that is not a number, the one behind `n` numbers of a vertex: a comment, perhaps with a number
    /// before it, or text that is ignored. Returns how many numbers it adds.
    #[cold]
    fn behind_vertex(&mut self, word: &[u8], n: usize, line: u64, numbers: &mut [f64; 7]) -> Parsed<usize> {
        match text::before_comment(word) {
            Some(b"") => Ok(0),
            Some(value) => {
                numbers[n] = text::double(value).ok_or_else(|| text::not_a_number(word))?;
                Ok(1)
            }
            None if n >= 3 => {
                self.ignored.add("text behind coordinates", line);
                Ok(0)
            }
            None => Err(text::not_a_number(word).into()),
        }
    }

    fn face(&mut self, line: &[u8], sink: &mut dyn Sink) -> Parsed<()> {
        if !self.in_run {
            let Some(target) = self.parts.run(self.runs) else {
                return Err("the file changed while it was being read".into());
            };
            self.batch.aim(MeshKey::DIRECT, target.part, target.colour, sink)?;
            self.part = target.part;
            self.texture = None;
            if let Some(painted) = target.texture.filter(|_| self.cage.is_none()) {
                self.texture = Some((painted, self.parts.textures.get(&painted.used)?));
            }
            self.runs += 1;
            self.in_run = true;
        }
        let mut rest = line;
        text::word(&mut rest);
        self.corners.clear();
        while let Some(word) = text::word(&mut rest) {
            if self.corners.len() % CORNERS == CORNERS - 1 {
                sink.cancel().check()?;
            }
            match self.corner(word) {
                Ok(corner) => self.corners.push(corner),
                Err(fault) => {
                    let comment = line[..line.len() - rest.len()].contains(&b'#');
                    match text::before_comment(word) {
                        None if !comment => return Err(fault),
                        None | Some(b"") => {}
                        Some(word) => self.corners.push(self.corner(word)?),
                    }
                    break;
                }
            }
        }
        self.without_area += u64::from(self.corners.len() < 3);
        if let Some(cage) = &mut self.cage {
            if self.corners.len() < 3 {
                return Err("a face of a cage needs at least three corners".into());
            }
            cage.face(self.part, self.corners.iter().map(|corner| corner.vertex));
            for corner in self.corners.iter().filter(|_| self.is_displaced) {
                let known = self.coordinates.as_ref().and_then(|all| all.get(corner.coordinates? as usize));
                cage.coordinates(*known.ok_or("a corner without texture coordinates, which the displacement needs")?);
            }
            self.triangles += 1;
            return Ok(());
        }
        // The normals of a face are used if each corner has one.
        self.with_normals = self.corners.iter().all(|corner| corner.normal.is_some());
        self.batch.with_normals(self.with_normals, sink)?;
        for i in 2..self.corners.len() {
            self.triangle([self.corners[0], self.corners[i - 1], self.corners[i]]);
            if self.batch.is_full() {
                self.batch.flush(sink)?;
            }
        }
        Ok(())
    }

    #[inline]
    fn corner(&self, word: &[u8]) -> Parsed<Corner> {
        let vertex = corner(word, self.positions.len())?;
        // Without a texture in this run of faces the rest of the word does not matter.
        let coordinates = self.coordinates.as_ref().filter(|_| self.is_displaced || self.texture.is_some());
        Ok(Corner {
            vertex,
            coordinates: coordinates.and_then(|c| further(word, 1, c.len())),
            normal: further(word, 2, self.normals.len()),
        })
    }

    #[inline]
    fn triangle(&mut self, corners: [Corner; 3]) {
        let at = corners.map(|c| c.vertex as usize);
        let colours = match &self.texture {
            Some((painted, texture)) => self.texture_colour(corners, *painted, texture).map(|c| [c; 3]),
            None if self.colours.is_empty() => None,
            None => Some(at.map(|i| self.colours[i])).filter(|all| !all.iter().any(|c| c[0].is_nan())),
        };
        let normals = match corners.map(|corner| corner.normal) {
            [Some(a), Some(b), Some(c)] if self.with_normals => Some([a, b, c].map(|i| self.normals.get(i as usize))),
            _ => None,
        };
        self.triangles += 1;
        self.batch.push(at.map(|i| DVec3::from(self.positions[i])), Corners { colours, normals });
    }

    /// Returns the mean colour of the texture over a triangle; `None` without texture coordinates.
    fn texture_colour(&self, corners: [Corner; 3], painted: Painted, texture: &Texture) -> Option<[f32; 3]> {
        let list = self.coordinates.as_ref()?;
        let at = |c: Corner| list.get(c.coordinates? as usize).copied().filter(|uv| !uv[0].is_nan());
        let [a, b, c] = corners.map(at);
        let mapping = painted.used.mapping;
        let mean = texture.mean([a?, b?, c?].map(|uv| mapping.apply(uv)), &mapping)?;
        Some(std::array::from_fn(|i| (painted.factor[i] * mean[i]).clamp(0.0, 1.0)))
    }

    fn other(&mut self, line: &[u8], number: u64) -> Parsed<()> {
        let mut rest = line;
        let word = text::word(&mut rest).unwrap_or(b"");
        if let (b"t", Some(cage)) = (word, &mut self.cage)
            && cage.tags.read(rest)?
        {
            return Ok(());
        }
        if !SILENT.contains(&word) && !word.is_empty() {
            self.ignored.add(&text::shown(word), number);
        }
        Ok(())
    }

    fn report(&self, input: &Input, sink: &mut dyn Sink) {
        let file = input.path().display();
        self.ignored.note(input.path(), sink);
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
    absolute(index, count).ok_or_else(|| format!("vertex {index} is out of range: {count} are defined so far").into())
}

/// Returns the second or third index of a corner, that of its texture coordinates or its normal, if it is defined.
#[inline]
fn further(word: &[u8], which: usize, count: usize) -> Option<u32> {
    absolute(text::integer(word.split(|&b| b == b'/').nth(which)?)?, count)
}

/// Returns the index from 0 for one that counts from 1, or backwards from -1.
#[inline]
fn absolute(index: i64, count: usize) -> Option<u32> {
    let at = if index > 0 { index - 1 } else { index.checked_add(count as i64)? };
    u32::try_from(at).ok().filter(|&at| (at as usize) < count && index != 0)
}
