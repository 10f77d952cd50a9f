//! Textures of OBJ materials, decoded at first use.

use super::beside;
use super::mtl::next_number;
use crate::base::error::{Error, Place, Result};
use crate::base::progress::Cancel;
use crate::import::Sink;
use crate::import::access::Files;
use crate::import::pictures::{Encoded, PictureId, Pictures};
use crate::import::text;
use crate::import::texture::{Alpha, Mapping, Texture, Wrap};
use glam::Vec2;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

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
pub(crate) struct Textures<'a> {
    files: &'a Files<'a>,
    pictures: Pictures,
    /// The picture that a name in a library means; `None` if it cannot be used.
    names: HashMap<(PathBuf, Vec<u8>), Option<PictureId>>,
    /// The picture in a file: several names may mean the same.
    paths: HashMap<PathBuf, PictureId>,
    /// Number of pictures that cannot be used, and the first reason.
    failed: usize,
    reason: Option<Error>,
}

/// A picture, the use of its alpha channel, and the mapping of its coordinates.
#[derive(Clone, Copy)]
pub(crate) struct Used {
    picture: PictureId,
    alpha: Alpha,
    pub(crate) mapping: Mapping,
}

impl<'a> Textures<'a> {
    pub(crate) fn new(files: &'a Files<'a>) -> Self {
        // OBJ coordinates begin at the lowest row.
        let pictures = Pictures::new(files.options, true);
        Self { files, pictures, names: HashMap::new(), paths: HashMap::new(), failed: 0, reason: None }
    }

    /// Decodes the picture of a material. Returns `None` if it cannot be used. Fails only if the work
    /// was cancelled, or with `NoMemory`.
    pub(crate) fn add(&mut self, map: &Map, cancel: &Cancel) -> Result<Option<(Used, Rc<Texture>)>> {
        // Without an opacity texture in the material the alpha channel has no meaning.
        let alpha = if map.alpha { Alpha::Opacity } else { Alpha::Ignored };
        let key = (map.library.clone(), map.name.clone());
        let picture = match self.names.get(&key) {
            Some(known) => *known,
            None => {
                let picture = match self.picture(map, cancel) {
                    Err(error) if error.ends_work() => return Err(error),
                    Err(error) => {
                        self.failed += 1;
                        self.reason.get_or_insert(error);
                        None
                    }
                    Ok(picture) => Some(picture),
                };
                self.names.insert(key, picture);
                picture
            }
        };
        let Some(picture) = picture else { return Ok(None) };
        let used = Used { picture, alpha, mapping: map.mapping };
        Ok(Some((used, self.get(&used)?)))
    }

    /// Opens and decodes the picture of a material.
    fn picture(&mut self, map: &Map, cancel: &Cancel) -> Result<PictureId> {
        let candidates = || Ok(beside::candidates(&map.library, &map.name));
        let mut input = self.files.open(beside::plain(&map.name), &map.library, candidates)?;
        let path = input.path().to_path_buf();
        let fail = |why: String| Error::parse(&path, Place::File, why);
        let is_file = input.stamp().is_file();
        if let Some(&known) = self.paths.get(&path).filter(|_| is_file) {
            return Ok(known);
        }
        let (total, most) = (input.total(), self.pictures.largest_file());
        if total > most {
            return Err(fail(format!("is a picture of {total} bytes, more than the {most} that may be read")));
        }
        let mut bytes = vec![0; total as usize];
        if !input.read_range(0, &mut bytes)? {
            return Err(fail("became shorter while being read".into()));
        }
        let picture = self.pictures.add(&bytes, Encoded::File, cancel).map_err(|fault| fault.at(&path, Place::File))?;
        if is_file {
            self.paths.insert(path, picture);
        }
        Ok(picture)
    }

    /// Adds a note about pictures that cannot be used.
    pub(crate) fn note(&self, obj: &Path, sink: &mut dyn Sink) {
        if let Some(reason) = &self.reason {
            let (file, n) = (obj.display(), self.failed);
            sink.note(format!("{file}: {n} textures were left out, and their materials have one colour: {reason}"));
        }
    }

    /// Returns the texture of a picture.
    pub(crate) fn get(&mut self, used: &Used) -> Result<Rc<Texture>> {
        self.pictures.texture(used.picture, used.alpha)
    }
}
