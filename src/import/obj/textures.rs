//! Textures of OBJ materials, decoded at first use.

use super::beside;
use super::mtl::next_number;
use crate::base::error::{Error, Place, Result};
use crate::import::Sink;
use crate::import::input::{Input, Stamp};
use crate::import::text;
use crate::import::texture::{self, Alpha, Mapping, Texture, Wrap};
use glam::Vec2;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Decoded textures that are kept, in bytes; a large one has 21 MiB.
const KEPT: usize = 256 << 20;
/// Largest picture file, in bytes.
const MAX_FILE: u64 = 1 << 30;

/// A statement `map_Kd`.
#[derive(Clone)]
pub(crate) struct Map {
    /// The library, and the name of the picture in it.
    library: PathBuf,
    name: Vec<u8>,
    mapping: Mapping,
    /// True if the alpha channel of the picture is its opacity.
    alpha: bool,
}

impl Map {
    /// Parses the text behind the keyword: options, then a name that may have spaces.
    pub(crate) fn parse(library: &Path, mut rest: &[u8]) -> Option<Self> {
        let (mut scale, mut offset, mut wrap) = (Vec2::ONE, Vec2::ZERO, Wrap::Repeat);
        loop {
            let mut look = rest;
            match text::word(&mut look)? {
                b"-s" => scale = vector(&mut look, scale),
                b"-o" => offset = vector(&mut look, offset),
                b"-t" => drop(vector(&mut look, Vec2::ZERO)),
                b"-mm" => drop((text::word(&mut look), text::word(&mut look))),
                b"-clamp" => {
                    if text::word(&mut look) == Some(b"on") {
                        wrap = Wrap::ClampToEdge;
                    }
                }
                b"-blendu" | b"-blendv" | b"-boost" | b"-cc" | b"-texres" | b"-imfchan" | b"-bm" | b"-type" => {
                    text::word(&mut look);
                }
                _ => break,
            }
            rest = look;
        }
        let mapping = Mapping { offset, rotation: 0.0, scale, wrap: [wrap; 2] };
        Some(Self { library: library.to_path_buf(), name: rest.trim_ascii().to_vec(), mapping, alpha: false })
    }

    /// States if the alpha channel of the picture is its opacity. Otherwise it has no meaning.
    pub(crate) fn with_alpha(self, alpha: bool) -> Self {
        Self { alpha, ..self }
    }
}

/// Parses the one to three numbers of an option; the third is for volumes.
fn vector(rest: &mut &[u8], or: Vec2) -> Vec2 {
    let mut numbers = or.extend(0.0).to_array();
    for number in &mut numbers {
        let mut look = *rest;
        let Some(value) = next_number(&mut look) else { break };
        (*number, *rest) = (value, look);
    }
    Vec2::new(numbers[0], numbers[1])
}

/// The pictures of a file's materials.
#[derive(Default)]
pub(crate) struct Textures {
    /// Pictures that can be decoded, and if their alpha is opacity.
    known: Vec<(PathBuf, bool)>,
    /// Decoded pictures by index, most recently used last.
    kept: Vec<(usize, Rc<Texture>)>,
    /// Picture files that were read.
    pub(crate) opened: Vec<Stamp>,
    /// Indices of pictures that cannot be used, and the first reason.
    failed: Vec<usize>,
    reason: Option<Error>,
}

/// A picture by its index in [`Textures`], and the mapping of its coordinates.
#[derive(Clone, Copy)]
pub(crate) struct Used {
    pub(crate) index: usize,
    pub(crate) mapping: Mapping,
}

impl Textures {
    /// Decodes the picture of a material. Returns `None` if it cannot be used.
    pub(crate) fn add(&mut self, map: &Map) -> Option<(Used, Rc<Texture>)> {
        let path = beside::find(&map.library, &map.name);
        let key = (path.unwrap_or_else(|| beside::expected(&map.library, &map.name)), map.alpha);
        let index = self.known.iter().position(|known| *known == key).unwrap_or_else(|| {
            self.known.push(key);
            self.known.len() - 1
        });
        if self.failed.contains(&index) {
            return None;
        }
        match self.get(index) {
            Ok(texture) => Some((Used { index, mapping: map.mapping }, texture)),
            Err(error) => {
                self.failed.push(index);
                self.reason.get_or_insert(error);
                None
            }
        }
    }

    /// Adds a note about pictures that cannot be used.
    pub(crate) fn note(&self, obj: &Path, sink: &mut dyn Sink) {
        if let Some(reason) = &self.reason {
            let (file, n) = (obj.display(), self.failed.len());
            sink.note(format!("{file}: {n} textures were left out, and their materials have one colour: {reason}"));
        }
    }

    /// Returns a picture, and decodes it if necessary.
    pub(crate) fn get(&mut self, index: usize) -> Result<Rc<Texture>> {
        if let Some(at) = self.kept.iter().position(|(i, _)| *i == index) {
            let entry = self.kept.remove(at);
            let texture = Rc::clone(&entry.1);
            self.kept.push(entry);
            return Ok(texture);
        }
        let (path, alpha) = &self.known[index];
        let mut input = Input::open(path)?;
        if !self.opened.contains(input.stamp()) {
            self.opened.push(input.stamp().clone());
        }
        let texture = Rc::new(decode(&mut input, *alpha)?);
        self.kept.push((index, Rc::clone(&texture)));
        while self.kept.len() > 1 && self.kept.iter().map(|(_, t)| t.bytes()).sum::<usize>() > KEPT {
            self.kept.remove(0);
        }
        Ok(texture)
    }
}

/// Decodes a picture. Its rows are stored from the bottom up, because OBJ coordinates begin there. Without an opacity
/// texture in the material the alpha channel has no meaning.
fn decode(input: &mut Input, alpha: bool) -> Result<Texture> {
    let fail = |input: &Input, why: String| Error::parse(input.path(), Place::File, why);
    if input.total() > MAX_FILE {
        return Err(fail(input, format!("is larger than {MAX_FILE} bytes")));
    }
    let mut bytes = vec![0; input.total() as usize];
    if !input.read_range(0, &mut bytes)? {
        return Err(fail(input, "became shorter while being read".into()));
    }
    let mut picture = texture::picture(&bytes).map_err(|why| fail(input, why))?;
    image::imageops::flip_vertical_in_place(&mut picture);
    Ok(Texture::of(picture, if alpha { Alpha::Opacity } else { Alpha::Ignored }))
}
