//! Elements `face` (polygons) and `tristrips`: conversion of indices to triangles.

use super::header::{Coding, Element, Kind, Type};
use super::table::Declared;
use super::values::Values;
use super::vertices::{Channels, VertexTable, channel, channels};
use crate::base::error::Result;
use crate::import::batch::{Batch, Corners};
use crate::import::colour;
use crate::import::input::Input;
use crate::import::{MaterialDesc, MeshKey, PartDesc, PartKey, Sink};
use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// Names of the property with the vertex indices of a face.
pub(crate) const INDEX_LISTS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Converts rows to triangles, as fans around the first corner, and counts faces that yield none.
pub(crate) struct Faces<'a> {
    vertices: &'a VertexTable,
    batch: Batch,
    parts: Parts,
    /// Number of faces with fewer than three corners.
    pub(crate) without_area: u64,
    pub(crate) triangles: u64,
}

/// Parts that the face property `part` refers to.
struct Parts {
    /// Parts of the file's table; without a table the part of the file itself.
    declared: Vec<Declared>,
    /// True if values of the property are indices into `declared`.
    named: bool,
    /// Parts that are not in the table.
    others: HashMap<i64, PartKey>,
}

/// Meaning of the properties of a face, as indices of properties.
struct Layout {
    indices: usize,
    colour: Option<Channels>,
    part: Option<usize>,
}

impl<'a> Faces<'a> {
    /// Creates the converter. `declared` holds the parts of the file's table if `named`, else only the file's own part.
    /// Faces begin in the first part.
    pub(crate) fn new(
        vertices: &'a VertexTable,
        declared: Vec<Declared>,
        named: bool,
        sink: &mut dyn Sink,
    ) -> Result<Self> {
        let mut batch = Batch::new(0);
        if let Some(&(part, colour)) = declared.first() {
            batch.aim(MeshKey::DIRECT, part, colour, sink)?;
        }
        let parts = Parts { declared, named, others: HashMap::new() };
        Ok(Self { vertices, batch, parts, without_area: 0, triangles: 0 })
    }

    /// Reads all rows of `element`; property `indices` is the list of vertex indices.
    pub(crate) fn polygons(
        &mut self,
        values: &mut impl Values,
        element: &Element,
        indices: usize,
        coding: Coding,
        sink: &mut dyn Sink,
    ) -> Result<()> {
        let part = element.scalar(&["part", "part_id"]).filter(|(_, ty)| !ty.is_float());
        let layout = Layout { indices, colour: channels(element), part: part.map(|(i, _)| i) };
        let quick = quick_layout(element, &layout, coding);
        let mut corners = Vec::new();
        let mut done = 0;
        while done < element.count {
            if let Some(quick) = quick {
                done += self.quick_rows(values.input(), quick, element.count - done, sink)?;
            }
            if self.batch.is_full() {
                self.hand_over(values.input(), sink)?;
            } else if done < element.count {
                self.polygon(values, element, &layout, &mut corners, sink)?;
                done += 1;
                if done.is_multiple_of(16384) {
                    super::tick(values.input(), sink)?;
                }
            }
        }
        Ok(())
    }

    /// Reads one row of any layout.
    fn polygon(
        &mut self,
        values: &mut impl Values,
        element: &Element,
        layout: &Layout,
        corners: &mut Vec<u32>,
        sink: &mut dyn Sink,
    ) -> Result<()> {
        let mut rgb = [0f32; 3];
        let mut part = None;
        for (i, property) in element.properties.iter().enumerate() {
            match property.kind {
                Kind::List { count, item } if i == layout.indices => {
                    self.corners(values, count, item, corners)?;
                }
                Kind::List { count, item } => {
                    let n = super::list_length(values, count)?;
                    values.skip(item, n)?;
                }
                Kind::Scalar(ty) if layout.part == Some(i) => part = Some(values.int(ty)?),
                Kind::Scalar(ty) => match layout.colour.and_then(|c| c.iter().position(|&(p, _)| p == i)) {
                    Some(slot) => rgb[slot] = channel(values.float(ty)?, ty),
                    None => values.skip(ty, 1)?,
                },
            }
        }
        values.end_row()?;
        if let Some(id) = part {
            let (key, colour) = self.parts.find(id, sink)?;
            self.batch.aim(MeshKey::DIRECT, key, colour, sink)?;
        }
        let face_colour = layout.colour.map(|_| rgb.map(colour::linear));
        self.fan(values, corners, face_colour, sink)
    }

    /// Reads the vertex list of a face and checks each index.
    fn corners(&self, values: &mut impl Values, count: Type, item: Type, corners: &mut Vec<u32>) -> Result<()> {
        let n = super::list_length(values, count)?;
        corners.clear();
        for _ in 0..n {
            let index = values.int(item)?;
            match u32::try_from(index) {
                Ok(i) if (i as usize) < self.vertices.positions.len() => corners.push(i),
                _ => return Err(values.fault(self.out_of_range(index))),
            }
        }
        Ok(())
    }

    fn out_of_range(&self, index: i64) -> String {
        format!("vertex {index} of {} is out of range", self.vertices.positions.len())
    }

    fn fan(
        &mut self,
        values: &mut impl Values,
        corners: &[u32],
        face_colour: Option<[f32; 3]>,
        sink: &mut dyn Sink,
    ) -> Result<()> {
        let [first, others @ ..] = corners else {
            self.without_area += 1;
            return Ok(());
        };
        self.without_area += u64::from(others.len() < 2);
        for pair in others.windows(2) {
            self.triangle([*first, pair[0], pair[1]], face_colour);
            if self.batch.is_full() {
                self.hand_over(values.input(), sink)?;
            }
        }
        Ok(())
    }

    #[inline]
    fn triangle(&mut self, corners: [u32; 3], face_colour: Option<[f32; 3]>) {
        let at = corners.map(|i| i as usize);
        // Every index was checked when it was read.
        let positions = at.map(|i| self.vertices.positions.get(i).unwrap_or(DVec3::NAN));
        let colours = face_colour.map(|c| [c; 3]).or_else(|| {
            let c = |i| self.vertices.colour(i);
            Some([c(at[0])?, c(at[1])?, c(at[2])?])
        });
        let normals = self.vertices.has_normals().then(|| at.map(|i| self.vertices.normal(i).unwrap_or(Vec3::NAN)));
        self.triangles += 1;
        self.batch.push(positions, Corners { colours, normals });
    }

    /// Reads triangle strips. Each list is a sequence of strips; negative indices end a strip.
    pub(crate) fn strips(
        &mut self,
        values: &mut impl Values,
        element: &Element,
        indices: usize,
        sink: &mut dyn Sink,
    ) -> Result<()> {
        for _ in 0..element.count {
            for (i, property) in element.properties.iter().enumerate() {
                match property.kind {
                    Kind::Scalar(ty) => values.skip(ty, 1)?,
                    Kind::List { count, item } => {
                        let n = super::list_length(values, count)?;
                        if i == indices { self.strip(values, item, n, sink)? } else { values.skip(item, n)? }
                    }
                }
            }
            values.end_row()?;
        }
        Ok(())
    }

    fn strip(&mut self, values: &mut impl Values, item: Type, n: u64, sink: &mut dyn Sink) -> Result<()> {
        let mut last = [0u32; 2];
        let mut length = 0u64;
        for k in 0..n {
            if k.is_multiple_of(65536) {
                super::tick(values.input(), sink)?;
            }
            let index = values.int(item)?;
            if index < 0 {
                length = 0;
                continue;
            }
            let Some(corner) = u32::try_from(index).ok().filter(|&i| (i as usize) < self.vertices.positions.len())
            else {
                return Err(values.fault(self.out_of_range(index)));
            };
            if length >= 2 {
                // Every other triangle of a strip has the opposite orientation.
                let [a, b] = if length.is_multiple_of(2) { last } else { [last[1], last[0]] };
                self.triangle([a, b, corner], None);
                if self.batch.is_full() {
                    self.hand_over(values.input(), sink)?;
                }
            }
            last = [last[1], corner];
            length += 1;
        }
        Ok(())
    }

    fn hand_over(&mut self, input: &Input, sink: &mut dyn Sink) -> Result<()> {
        sink.at(input.offset(), input.total());
        self.vertices.positions.check()?;
        self.batch.flush(sink)
    }

    /// Sends the remaining triangles to the sink.
    pub(crate) fn finish(&mut self, input: &Input, sink: &mut dyn Sink) -> Result<()> {
        self.hand_over(input, sink)
    }

    /// Reads the usual case, triangles in rows of constant size: as many as the window holds and the batch has room
    /// for. Stops at the first row that is not a triangle or has an index out of range. Returns the number of rows
    /// read.
    fn quick_rows(&mut self, input: &mut Input, quick: Quick, most: u64, sink: &mut dyn Sink) -> Result<u64> {
        let row = quick.before + 1 + 12 + quick.after;
        input.ensure(row)?;
        let rows = input.available().chunks_exact(row).take(most.try_into().unwrap_or(usize::MAX));
        let (mut n, count) = (0, self.vertices.positions.len());
        let mut part = None;
        for bytes in rows {
            let Some((&3, list)) = bytes[quick.before..].split_first() else { break };
            let corners = [quick.word(list, 0), quick.word(list, 4), quick.word(list, 8)];
            if self.batch.is_full() || corners.iter().any(|&c| c as usize >= count) {
                break;
            }
            let id = quick.part.map(|at| quick.word(bytes, at) as i32);
            if id != part
                && let Some(id) = id
            {
                let (key, colour) = self.parts.find(id.into(), sink)?;
                self.batch.aim(MeshKey::DIRECT, key, colour, sink)?;
                part = Some(id);
            }
            self.triangle(corners, None);
            n += 1;
        }
        input.consume(n * row);
        Ok(n as u64)
    }
}

impl Parts {
    fn find(&mut self, id: i64, sink: &mut dyn Sink) -> Result<Declared> {
        let at = usize::try_from(id).ok().filter(|_| self.named);
        if let Some(&declared) = at.and_then(|i| self.declared.get(i)) {
            return Ok(declared);
        }
        let colour = MaterialDesc::default().colour;
        if let Some(&key) = self.others.get(&id) {
            return Ok((key, colour));
        }
        let parent = self.declared.first().filter(|_| !self.named).map(|d| d.0);
        let desc = PartDesc { id: u64::try_from(id).ok(), name: format!("part {id}"), parent, material: None };
        let key = sink.part(desc)?;
        self.others.insert(id, key);
        Ok((key, colour))
    }
}

/// A row layout without colours and with a single list: a `uchar` count and 32-bit indices.
#[derive(Clone, Copy)]
struct Quick {
    /// Number of bytes before the list and after it.
    before: usize,
    after: usize,
    /// Byte offset of the part in a triangle's row.
    part: Option<usize>,
    big: bool,
}

impl Quick {
    /// Reads the 32-bit number at byte `at` of `bytes`; the caller guarantees that it is inside.
    #[inline]
    fn word(self, bytes: &[u8], at: usize) -> u32 {
        let four = bytes[at..].first_chunk().copied().unwrap_or([0xff; 4]);
        if self.big { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) }
    }
}

fn quick_layout(element: &Element, layout: &Layout, coding: Coding) -> Option<Quick> {
    if layout.colour.is_some() || coding == Coding::Ascii {
        return None;
    }
    let mut quick = Quick { before: 0, after: 0, part: None, big: coding == Coding::Big };
    for (i, property) in element.properties.iter().enumerate() {
        let after_list = i > layout.indices;
        match property.kind {
            Kind::List { count: Type::U8 | Type::I8, item: Type::I32 | Type::U32 } if i == layout.indices => {}
            Kind::List { .. } => return None,
            Kind::Scalar(ty) => {
                let at = if after_list { quick.before + 1 + 12 + quick.after } else { quick.before };
                if layout.part == Some(i) {
                    quick.part = Some(at).filter(|_| ty == Type::I32);
                    quick.part?;
                }
                *(if after_list { &mut quick.after } else { &mut quick.before }) += ty.size() as usize;
            }
        }
    }
    Some(quick)
}
