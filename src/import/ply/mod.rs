//! PLY: text and both byte orders, any properties, polygons, strips and colours.
//!
//! This crate has its own reader because available crates load whole files into maps of named values and report neither
//! line nor byte of an error. This reader streams and needs 12 or 24 bytes per vertex.
//!
//! - Faces are lists `vertex_indices` or `vertex_index`, converted to fans around the first corner; `tristrips` are
//!   read too.
//! - Vertex colours are interpolated in linear light. A colour of the face takes precedence. Integer
//!   channels span the range of their type, floats [0, 1]; both are taken as sRGB-coded.
//! - An integer face property `part` (or `part_id`) refers to parts: to the table that the generators of this crate
//!   write into comments (`table.rs`), else to parts with that id below the file's own part.
//! - Lines of the header that are not understood, and values behind the last property of a row of text, are skipped
//!   with a note.
//! - All other data is skipped. A file without faces (a point cloud, a range grid) is an empty model.

mod faces;
mod header;
mod table;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod text_tests;
mod values;
mod vertices;

use super::input::Input;
use super::text;
use super::{MaterialDesc, PartDesc, ReadOptions, Sink};
use crate::base::error::Result;
use faces::{Faces, INDEX_LISTS};
use header::{Coding, Element, Header, Kind, Type};
use values::{Ascii, Binary, Values};
use vertices::VertexTable;

/// Reads a PLY file from its beginning.
pub(crate) fn read(input: &mut Input, options: &ReadOptions, sink: &mut dyn Sink) -> Result<()> {
    let header = header::read(input)?;
    match header.coding {
        Coding::Ascii => read_elements(&mut Ascii::new(input), header, options, sink),
        Coding::Little => read_elements(&mut Binary::<false>::new(input), header, options, sink),
        Coding::Big => read_elements(&mut Binary::<true>::new(input), header, options, sink),
    }
}

/// Returns the index list of an element that makes triangles.
fn index_list(element: &Element) -> Option<usize> {
    let makes_triangles = matches!(element.name.as_str(), "face" | "tristrips");
    element.list(&INDEX_LISTS).filter(|_| makes_triangles)
}

fn read_elements(values: &mut impl Values, header: Header, options: &ReadOptions, sink: &mut dyn Sink) -> Result<()> {
    let (body, body_line) = (values.input().offset(), values.input().line());
    let vertex = header.element("vertex");
    let first_faces = header.elements.iter().position(|e| index_list(e).is_some());
    let mut rest = 0;
    let mut table = VertexTable::empty();
    if let Some(vertex) = vertex {
        for element in &header.elements[..vertex] {
            skip_rows(values, element, sink)?;
        }
        table = vertices::read(values, &header.elements[vertex], header.coding, options, sink)?;
        rest = vertex + 1;
        if first_faces.is_some_and(|faces| faces < vertex) {
            // If faces come before vertices, the vertices were read first; the second reading starts at the beginning.
            values.input().seek(body, body_line)?;
            rest = 0;
        }
    }
    let path = values.input().path().to_path_buf();
    let mut declared = header.tables.declare(&path.display().to_string(), sink)?;
    let named = !declared.is_empty();
    if !named {
        let part = PartDesc { name: super::stem(&path), ..PartDesc::default() };
        declared.push((sink.part(part)?, MaterialDesc::default().colour));
    }
    let mut faces = Faces::new(&table, declared, named, sink)?;
    for element in &header.elements[rest..] {
        match index_list(element) {
            Some(list) if element.name == "face" => {
                faces.polygons(values, element, list, header.coding, sink)?;
            }
            Some(list) => faces.strips(values, element, list, sink)?,
            None => skip_rows(values, element, sink)?,
        }
    }
    faces.finish(values.input(), sink)?;
    header.ignored.note(&path, sink);
    if let Some(ignored) = values.ignored() {
        ignored.note(&path, sink);
    }
    report(values.input(), &header, &table, &faces, sink)
}

/// Adds notes about missing or unused data of a valid file.
fn report(
    input: &mut Input,
    header: &Header,
    table: &VertexTable,
    faces: &Faces<'_>,
    sink: &mut dyn Sink,
) -> Result<()> {
    let file = input.path().display().to_string();
    if faces.without_area > 0 {
        let n = faces.without_area;
        sink.note(format!("{file}: {n} faces with fewer than three corners make no triangle"));
    }
    if faces.triangles == 0 {
        let names: Vec<_> = header.elements.iter().map(|e| format!("{} {}", e.count, e.name)).collect();
        let (vertices, names) = (table.positions.len(), names.join(", "));
        sink.note(format!("{file}: no triangles ({vertices} vertices; elements: {names}); the model is empty"));
    }
    let n = input.remaining();
    let behind = input.peek(4096)?;
    let behind = if header.coding == Coding::Ascii { text::unpadded(behind) } else { behind };
    if !behind.trim_ascii().is_empty() {
        sink.note(format!("{file}: {n} bytes after the last element were not read"));
    }
    Ok(())
}

/// Skips an element that makes no triangles.
fn skip_rows(values: &mut impl Values, element: &Element, sink: &mut dyn Sink) -> Result<()> {
    if element.properties.is_empty() {
        return Ok(());
    }
    for n in 0..element.count {
        if n.is_multiple_of(16384) {
            tick(values.input(), sink)?;
        }
        for property in &element.properties {
            match property.kind {
                Kind::Scalar(ty) => values.skip(ty, 1)?,
                Kind::List { count, item } => {
                    let n = list_length(values, count)?;
                    values.skip(item, n)?;
                }
            }
        }
        values.end_row()?;
    }
    Ok(())
}

/// Reads the length of a list. It is not trusted: nothing is allocated by it.
fn list_length(values: &mut impl Values, count: Type) -> Result<u64> {
    let n = values.int(count)?;
    u64::try_from(n).map_err(|_| values.fault(format!("a list has the negative length {n}")))
}

/// Reports progress and checks for cancellation.
fn tick(input: &Input, sink: &mut dyn Sink) -> Result<()> {
    sink.at(input.offset(), input.total());
    sink.cancel().check()
}
