//! Material libraries: colour, opacity, texture, and the common extensions for metalness and roughness.

use super::beside;
use super::lines::Lines;
use super::textures::Map;
use crate::base::error::Result;
use crate::import::access::Files;
use crate::import::colour::unit;
use crate::import::ignored::Ignored;
use crate::import::input::Input;
use crate::import::{MaterialDesc, Sink, text};
use std::collections::HashMap;
use std::path::Path;

/// Statements without effect here that nearly all libraries have. They are ignored without a note.
const SILENT: [&[u8]; 6] = [b"Ka", b"Ks", b"Ni", b"Km", b"sharpness", b"aniso"];

/// Values of `illum` with which light passes through the material.
const GLASS: [f32; 4] = [4.0, 6.0, 7.0, 9.0];

/// A material of a library.
#[derive(Clone)]
pub(crate) struct Material {
    pub(crate) looks: MaterialDesc,
    /// The texture `map_Kd`.
    pub(crate) map: Option<Map>,
    /// Factor of the texture's colours: `Kd`, if the library has it.
    pub(crate) factor: Option<[f32; 3]>,
}

/// All materials of the libraries of an OBJ file.
#[derive(Default)]
pub(crate) struct Libraries {
    materials: HashMap<Vec<u8>, Material>,
}

impl Libraries {
    /// Adds the materials of an `mtllib` line in the OBJ file at `obj`: one library with spaces in its name, or
    /// several. A library that cannot be read adds a note.
    pub(crate) fn read(&mut self, obj: &Path, line: &[u8], files: &Files<'_>, sink: &mut dyn Sink) -> Result<()> {
        let mut rest = text::name_before_comment(line).unwrap_or(line);
        let words: Vec<&[u8]> = std::iter::from_fn(|| text::word(&mut rest)).collect();
        if let [only] = words[..] {
            let library = files.open(beside::plain(only), obj, || Ok(beside::candidates(obj, line)));
            return self.try_file(obj, library, sink);
        }
        // The whole line first: it may be one name with spaces.
        match files.open(beside::plain(line), obj, || Ok(beside::candidates(obj, line))) {
            Err(error) if error.ends_work() => return Err(error),
            Err(_) => {}
            whole => return self.try_file(obj, whole, sink),
        }
        for name in words {
            sink.cancel().check()?;
            self.try_file(obj, files.open(name, obj, || Ok(beside::candidates(obj, name))), sink)?;
        }
        Ok(())
    }

    fn try_file(&mut self, obj: &Path, library: Result<Input>, sink: &mut dyn Sink) -> Result<()> {
        match library.and_then(|input| self.read_file(input, sink)) {
            Err(error) if error.ends_work() => Err(error),
            Err(error) => {
                sink.note(format!("{}: a material library could not be read: {error}", obj.display()));
                Ok(())
            }
            Ok(()) => Ok(()),
        }
    }

    /// Returns the material of that name. Either name may have a comment behind it.
    pub(crate) fn get(&self, name: &[u8]) -> Option<&Material> {
        self.materials.get(name).or_else(|| self.materials.get(text::name_before_comment(name)?))
    }

    fn read_file(&mut self, mut input: Input, sink: &mut dyn Sink) -> Result<()> {
        let path = input.path().to_path_buf();
        if matches!(input.peek(2)?, b"\xff\xfe" | b"\xfe\xff") {
            return Err(input.fault("text in UTF-16; save it as UTF-8"));
        }
        let mut lines = Lines::default();
        let mut draft: Option<Draft> = None;
        let mut ignored = Ignored::default();
        loop {
            let number = input.line() + 1;
            let Some(line) = lines.next(&mut input)? else { break };
            sink.cancel().check()?;
            let mut rest = line;
            match text::word(&mut rest) {
                Some(b"newmtl") => {
                    self.finish(draft.take(), &mut ignored);
                    draft = Some(Draft { name: rest.trim_ascii().to_vec(), line: number, ..Draft::default() });
                }
                Some(keyword) if !keyword.starts_with(b"#") => {
                    if let Some(draft) = &mut draft {
                        draft.property(keyword, rest, &path, &mut |kind| ignored.add(kind, number));
                    }
                }
                _ => {}
            }
        }
        self.finish(draft, &mut ignored);
        ignored.note(&path, sink);
        Ok(())
    }

    fn finish(&mut self, draft: Option<Draft>, ignored: &mut Ignored) {
        let Some(draft) = draft else { return };
        let material = draft.material(ignored);
        if let Some(name) = text::name_before_comment(&draft.name) {
            self.materials.entry(name.to_vec()).or_insert_with(|| material.clone());
        }
        self.materials.insert(draft.name, material);
    }
}

/// A material under construction. Opacity and roughness are determined after its last line.
#[derive(Default)]
struct Draft {
    name: Vec<u8>,
    line: u64,
    looks: MaterialDesc,
    colour: Option<[f32; 3]>,
    transparency: Option<f32>,
    dissolve: Option<f32>,
    /// Mean of the transmitted colour `Tf`, and the illumination model.
    transmission: Option<f32>,
    illumination: Option<f32>,
    exponent: Option<f32>,
    roughness: Option<f32>,
    map: Option<Map>,
    /// True if there is a texture of the opacity.
    cut: bool,
}

impl Draft {
    /// Handles one line of the library at `path`. Calls `ignore` with the kind of the line if it has no effect.
    fn property(&mut self, keyword: &[u8], rest: &[u8], path: &Path, ignore: &mut dyn FnMut(&str)) {
        let understood = match keyword {
            b"Kd" => colour(rest).map(|c| self.colour = Some(c.map(|c| unit(c, 0.6)))),
            b"Tf" => colour(rest).map(|[r, g, b]| self.transmission = Some((r + g + b) / 3.0)),
            b"d" => number(after(rest, b"-halo")).map(|d| self.dissolve = Some(d)),
            b"Tr" => number(rest).map(|t| self.transparency = Some(t)),
            b"illum" => number(rest).map(|model| self.illumination = Some(model)),
            b"Ns" => number(rest).map(|n| self.exponent = Some(n)),
            b"Pm" => number(rest).map(|m| self.looks.metalness = unit(m, 0.0)),
            b"Pr" => number(rest).map(|r| self.roughness = Some(r)),
            b"map_Kd" => Map::parse(path, rest).map(|map| self.map = Some(map)),
            b"Ke" if colour(rest) == Some([0.0; 3]) => Some(()),
            other => {
                self.cut |= other == b"map_d";
                if !SILENT.contains(&other) {
                    ignore(&text::shown(other));
                }
                Some(())
            }
        };
        if understood.is_none() {
            ignore(&format!("invalid {}", text::shown(keyword)));
        }
    }

    /// Returns the opacity.
    ///
    /// `d` is the opacity, and `Tr` the transparency if there is no `d`. Many programs write `Tr 1` for opaque
    /// materials, so that it says nothing; a material is not made to be invisible. `Tf` is the light that passes, if
    /// the illumination model is one of glass; Maya writes `Tf 1 1 1` for opaque materials of that model.
    fn opacity(&self, ignored: &mut Ignored) -> f32 {
        let of_transparency = self.transparency.map(|t| {
            if t >= 1.0 && self.dissolve.is_none() {
                ignored.add("\"Tr 1\" of a material without \"d\", which is taken as opaque", self.line);
                return 1.0;
            }
            1.0 - t
        });
        let opacity = unit(self.dissolve.or(of_transparency).unwrap_or(1.0), 1.0);
        let glass = self.illumination.is_some_and(|model| GLASS.contains(&model));
        let passes = self.transmission.filter(|t| glass && (0.0..1.0).contains(t));
        opacity * (1.0 - passes.unwrap_or(0.0))
    }

    fn material(&self, ignored: &mut Ignored) -> Material {
        let colour = self.colour.unwrap_or(self.looks.colour);
        let mut looks = MaterialDesc { colour, opacity: self.opacity(ignored), ..self.looks };
        let by_exponent = self.exponent.filter(|n| *n >= 0.0).map(|n| (2.0 / (n + 2.0)).powf(0.25));
        if let Some(roughness) = self.roughness.or(by_exponent) {
            looks.roughness = unit(roughness, looks.roughness);
        }
        Material { looks, map: self.map.clone().map(|map| map.with_alpha(self.cut)), factor: self.colour }
    }
}

/// Returns the rest of a line behind `option`, or the whole rest without it.
fn after<'a>(rest: &'a [u8], option: &[u8]) -> &'a [u8] {
    let mut look = rest;
    if text::word(&mut look) == Some(option) { look } else { rest }
}

fn number(mut rest: &[u8]) -> Option<f32> {
    next_number(&mut rest).filter(|x| !x.is_nan())
}

/// Returns the next number of a line. A comment may follow it directly.
pub(crate) fn next_number(rest: &mut &[u8]) -> Option<f32> {
    let word = text::word(rest)?;
    text::single(word).or_else(|| text::single(text::before_comment(word)?))
}

/// Parses three linear values, or one that is used for all of them. Spectral curves and CIE XYZ are not understood.
fn colour(mut rest: &[u8]) -> Option<[f32; 3]> {
    let r = next_number(&mut rest)?;
    let mut more = || text::word(&mut rest).filter(|word| !word.starts_with(b"#"));
    let Some(g) = more() else { return Some([r; 3]).filter(|_| !r.is_nan()) };
    let parse = |word: &[u8]| next_number(&mut &word[..]);
    let g = parse(g)?;
    let b = more().map_or(Some(g), parse)?;
    let rgb = [r, g, b];
    (!rgb.iter().any(|x| x.is_nan())).then_some(rgb)
}
