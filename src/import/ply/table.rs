//! The tables of units, materials and parts that the generators of this crate write into comments of a PLY file.
//!
//! ```text
//! comment outcrop units <metres per unit, or -> up <x|y|z|->
//! comment outcrop material <index> <red> <green> <blue> <opacity> <metalness> <roughness> <name>
//! comment outcrop part <index> <id> <index of the parent, or -> <index of the material, or -> <name>
//! ```
//!
//! Indices count from 0 in order, and parents come before their children. Colours are linear. A face property `part` is
//! an index into the parts; without it all faces belong to part 0.

use crate::base::error::Result;
use crate::import::{MaterialDesc, PartDesc, PartKey, Sink, UpAxis, text};

/// Tables of the comments. Rows refer to earlier rows only.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Tables {
    units: Option<(Option<f64>, UpAxis)>,
    materials: Vec<MaterialDesc>,
    parts: Vec<PartDesc>,
    /// Number of comments that begin like ours but are invalid.
    bad_lines: u64,
}

/// A declared part and the colour of its material.
pub(crate) type Declared = (PartKey, [f32; 3]);

impl Tables {
    /// Parses the text of one comment. Comments of other programs are ignored.
    pub(crate) fn comment(&mut self, mut rest: &[u8]) {
        if text::word(&mut rest) != Some(b"outcrop") {
            return;
        }
        let understood = match text::word(&mut rest) {
            Some(b"units") => self.units_line(rest),
            Some(b"material") => self.material_line(rest),
            Some(b"part") => self.part_line(rest),
            _ => None,
        };
        self.bad_lines += u64::from(understood.is_none());
    }

    fn units_line(&mut self, mut rest: &[u8]) -> Option<()> {
        let metres = or_dash(text::word(&mut rest)?, text::double)?;
        let up = match (text::word(&mut rest)?, text::word(&mut rest)?) {
            (b"up", b"x") => UpAxis::X,
            (b"up", b"y") => UpAxis::Y,
            (b"up", b"z") => UpAxis::Z,
            (b"up", b"-") => UpAxis::Unknown,
            _ => return None,
        };
        self.units = Some((metres.filter(|m| m.is_finite() && *m > 0.0), up));
        Some(())
    }

    fn material_line(&mut self, mut rest: &[u8]) -> Option<()> {
        index(text::word(&mut rest)?).filter(|&i| i as usize == self.materials.len())?;
        let mut numbers = [0f32; 6];
        for number in &mut numbers {
            *number = text::single(text::word(&mut rest)?).filter(|x| x.is_finite())?;
        }
        let [r, g, b, opacity, metalness, roughness] = numbers;
        self.materials.push(MaterialDesc { colour: [r, g, b], opacity, metalness, roughness });
        Some(())
    }

    fn part_line(&mut self, mut rest: &[u8]) -> Option<()> {
        index(text::word(&mut rest)?).filter(|&i| i as usize == self.parts.len())?;
        let id = str::from_utf8(text::word(&mut rest)?).ok()?.parse().ok()?;
        let parent = or_dash(text::word(&mut rest)?, index)?;
        let material = or_dash(text::word(&mut rest)?, index)?;
        let known = parent.is_none_or(|p| (p as usize) < self.parts.len())
            && material.is_none_or(|m| (m as usize) < self.materials.len());
        let name = text::name(rest);
        known.then(|| self.parts.push(PartDesc { id: Some(id), name, parent, material }))
    }

    /// Declares the tables to the sink. Returns the declared parts in order.
    pub(crate) fn declare(&self, file: &str, sink: &mut dyn Sink) -> Result<Vec<Declared>> {
        if let Some((metres, up)) = self.units {
            sink.units(metres, up);
        }
        if self.bad_lines > 0 {
            sink.note(format!(
                "{file}: {} comments with the keyword outcrop are invalid and were ignored",
                self.bad_lines
            ));
        }
        let materials = self.materials.iter().map(|&m| sink.material(m)).collect::<Result<Vec<_>>>()?;
        let mut declared: Vec<Declared> = Vec::with_capacity(self.parts.len());
        for part in &self.parts {
            let looks = part.material.map_or(MaterialDesc::default(), |m| self.materials[m as usize]);
            let key = sink.part(PartDesc {
                parent: part.parent.map(|p| declared[p as usize].0),
                material: part.material.map(|m| materials[m as usize]),
                ..part.clone()
            })?;
            declared.push((key, looks.colour));
        }
        Ok(declared)
    }
}

fn index(word: &[u8]) -> Option<u32> {
    u32::try_from(text::integer(word)?).ok()
}

fn or_dash<T>(word: &[u8], parse: impl Fn(&[u8]) -> Option<T>) -> Option<Option<T>> {
    if word == b"-" { Some(None) } else { parse(word).map(Some) }
}
