//! Material libraries: colour, opacity and the common extensions for metalness and roughness.

use super::lines::Lines;
use crate::base::error::Result;
use crate::import::colour::unit;
use crate::import::input::Input;
use crate::import::{MaterialDesc, Sink, text};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Adds the materials of `library`, as named in the OBJ file at `obj`, to `defined`.
///
/// `Kd` is taken as linear. `d` is the opacity; `Tr` is the transparency and used only without `d`. `Pm` and `Pr` are
/// metalness and roughness. Without `Pr` a Phong exponent `Ns` gives the roughness of microfacets with the same
/// highlight, (2 / (Ns + 2))^¼. A library that cannot be read adds a note.
pub(crate) fn read(
    obj: &Path,
    library: &str,
    defined: &mut HashMap<String, MaterialDesc>,
    sink: &mut dyn Sink,
) -> Result<()> {
    for path in files(obj, library) {
        if let Err(error) = read_file(&path, defined, sink) {
            match error {
                crate::Error::Cancelled => return Err(error),
                error => sink.note(format!("{}: a material library could not be read: {error}", obj.display())),
            }
        }
    }
    Ok(())
}

/// Returns the files of an `mtllib` line: one file with spaces in its name, or several files.
fn files(obj: &Path, library: &str) -> Vec<PathBuf> {
    let folder = obj.parent().unwrap_or(Path::new(""));
    let whole = folder.join(library.replace('\\', "/"));
    if whole.is_file() || library.is_empty() {
        return vec![whole];
    }
    library.split_ascii_whitespace().map(|name| folder.join(name.replace('\\', "/"))).collect()
}

/// A material under construction. Its opacity and roughness are determined after its last line.
#[derive(Default)]
struct Draft {
    name: String,
    looks: MaterialDesc,
    transparency: Option<f32>,
    dissolve: Option<f32>,
    exponent: Option<f32>,
    roughness: Option<f32>,
}

fn read_file(path: &Path, defined: &mut HashMap<String, MaterialDesc>, sink: &mut dyn Sink) -> Result<()> {
    let mut input = Input::open(path)?;
    let mut lines = Lines::default();
    let mut draft: Option<Draft> = None;
    let mut bad_lines = 0u64;
    while let Some(line) = lines.next(&mut input)? {
        sink.cancel().check()?;
        let mut rest = line;
        match text::word(&mut rest) {
            Some(b"newmtl") => {
                finish(draft.take(), defined);
                draft = Some(Draft { name: text::name(rest), ..Draft::default() });
            }
            Some(keyword) => {
                if let Some(draft) = &mut draft {
                    bad_lines += u64::from(draft.property(keyword, rest).is_none());
                }
            }
            None => {}
        }
    }
    finish(draft, defined);
    if bad_lines > 0 {
        sink.note(format!("{}: {bad_lines} lines are invalid and were ignored", path.display()));
    }
    Ok(())
}

impl Draft {
    /// Parses one line. Returns `None` if a number is missing or invalid.
    fn property(&mut self, keyword: &[u8], mut rest: &[u8]) -> Option<()> {
        match keyword {
            b"Kd" => {
                let mut look = rest;
                if matches!(text::word(&mut look), Some(b"spectral" | b"xyz")) {
                    return None;
                }
                let r = number(&mut rest)?;
                // A single number is used for all three channels.
                let (g, b) = (number(&mut rest).unwrap_or(r), number(&mut rest).unwrap_or(r));
                self.looks.colour = [r, g, b].map(|c| unit(c, 0.6));
            }
            b"d" => {
                let mut look = rest;
                if text::word(&mut look) == Some(b"-halo") {
                    rest = look;
                }
                self.dissolve = Some(number(&mut rest)?);
            }
            b"Tr" => self.transparency = Some(number(&mut rest)?),
            b"Ns" => self.exponent = Some(number(&mut rest)?),
            b"Pm" => self.looks.metalness = unit(number(&mut rest)?, 0.0),
            b"Pr" => self.roughness = Some(number(&mut rest)?),
            _ => {}
        }
        Some(())
    }
}

fn number(rest: &mut &[u8]) -> Option<f32> {
    text::single(text::word(rest)?)
}

fn finish(draft: Option<Draft>, defined: &mut HashMap<String, MaterialDesc>) {
    let Some(mut draft) = draft else { return };
    let opacity = draft.dissolve.or(draft.transparency.map(|t| 1.0 - t)).unwrap_or(1.0);
    draft.looks.opacity = unit(opacity, 1.0);
    let by_exponent = draft.exponent.filter(|n| *n >= 0.0).map(|n| (2.0 / (n + 2.0)).powf(0.25));
    if let Some(roughness) = draft.roughness.or(by_exponent) {
        draft.looks.roughness = unit(roughness, draft.looks.roughness);
    }
    defined.insert(draft.name, draft.looks);
}
