//! Typed elements in buffers, read in pieces with every range checked.

use super::buffers::{Buffers, Range};
use super::model::{Accessor, Component, Model};
use crate::import::input::Parsed;

/// Bytes per read.
const PIECE: u64 = 256 << 10;

/// An accessor with checked ranges: all elements are inside their buffer.
pub(crate) struct Elements {
    pub(crate) count: u64,
    component: Component,
    normalized: bool,
    /// Rows of the elements. `None` for zeros, apart from the sparse elements.
    base: Option<Strided>,
    sparse: Option<Sparse>,
    name: String,
}

/// Rows in a buffer.
#[derive(Clone, Copy)]
struct Strided {
    range: Range,
    stride: u64,
    row: u64,
}

struct Sparse {
    count: u64,
    indices: Strided,
    index_type: Component,
    values: Strided,
}

impl Elements {
    /// Opens accessor `index` and checks its ranges. The number of components must be one of `widths`.
    pub(crate) fn open(model: &Model, index: usize, widths: &[usize], buffers: &mut Buffers<'_>) -> Parsed<Self> {
        let name = format!("accessors[{index}]");
        let accessor = model.accessors.get(index)?;
        let (component, width, count) = (accessor.component, accessor.width, accessor.count);
        if !widths.contains(&width) {
            return Err(format!("{name} has {width} components; expected one of {widths:?}").into());
        }
        let row = (component.size() * width) as u64;
        let base = match accessor.view {
            Some(view) => Some(strided(model, (view, accessor.offset), count, row, &name, buffers)?),
            // Implicit zeros occupy no bytes, so the file's size is the only bound on their claimed count.
            None if count > buffers.total() => {
                return Err(
                    format!("{name} announces {count} elements without bytes, more than the size of the file").into()
                );
            }
            None => None,
        };
        let sparse = sparse(model, accessor, row, &name, buffers)?;
        Ok(Self { count, component, normalized: accessor.normalized, base, sparse, name })
    }

    /// The accessor, for messages.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Number of bytes that [`Elements::floats`] takes for elements of `width` numbers.
    pub(crate) fn bytes(&self, width: u64) -> u64 {
        let index = size_of::<u32>() as u64;
        let sparse = self.sparse.as_ref().map_or(0, |sparse| sparse.count.saturating_mul(index));
        self.count.saturating_mul(width * size_of::<f32>() as u64).saturating_add(sparse)
    }

    /// Returns every element as floating-point numbers, in order. Missing components are 0. Normalised integers become
    /// [-1, 1] or [0, 1].
    pub(crate) fn floats<const N: usize>(&self, buffers: &mut Buffers<'_>) -> Parsed<Vec<[f32; N]>> {
        let read = |row: &[u8]| {
            let mut out = [0.0; N];
            for (out, bytes) in out.iter_mut().zip(row.chunks_exact(self.component.size())) {
                *out = float(bytes, self.component, self.normalized);
            }
            out
        };
        let mut all = Vec::with_capacity(self.count as usize);
        match &self.base {
            Some(base) => base.rows(self.count, buffers, |row| {
                all.push(read(row));
                Ok(())
            })?,
            None => all.resize(self.count as usize, [0.0; N]),
        }
        if let Some(sparse) = &self.sparse {
            let mut indices = Vec::with_capacity(sparse.count as usize);
            sparse.indices.rows(sparse.count, buffers, |row| {
                indices.push(unsigned(row, sparse.index_type));
                Ok(())
            })?;
            let mut next = indices.iter();
            sparse.values.rows(sparse.count, buffers, |row| {
                let index = next.next().copied().unwrap_or(u32::MAX);
                match all.get_mut(index as usize) {
                    Some(element) => *element = read(row),
                    None => return Err(format!("{}: sparse index {index} is out of range", self.name).into()),
                }
                Ok(())
            })?;
        }
        Ok(all)
    }

    /// Calls `each` with every element as an index, in order, and stops at its first error.
    pub(crate) fn indices(
        &self,
        buffers: &mut Buffers<'_>,
        mut each: impl FnMut(u32, &Buffers<'_>) -> Parsed<()>,
    ) -> Parsed<()> {
        if matches!(self.component, Component::I8 | Component::I16 | Component::F32) {
            return Err(format!("{}: indices must be unsigned integers", self.name).into());
        }
        let (Some(base), None) = (&self.base, &self.sparse) else {
            return Err(format!("{}: sparse indices are not supported", self.name).into());
        };
        base.pieces(self.count, buffers, |piece, buffers| {
            for row in base.rows_of(piece) {
                each(unsigned(row, self.component), buffers)?;
            }
            Ok(())
        })
    }
}

impl Strided {
    /// Returns the rows in a piece. The last row may lack the padding.
    fn rows_of<'p>(&self, piece: &'p [u8]) -> impl Iterator<Item = &'p [u8]> {
        let row = self.row as usize;
        piece.chunks(self.stride as usize).filter_map(move |bytes| bytes.get(..row))
    }

    fn rows(&self, count: u64, buffers: &mut Buffers<'_>, mut each: impl FnMut(&[u8]) -> Parsed<()>) -> Parsed<()> {
        self.pieces(count, buffers, |piece, _| self.rows_of(piece).try_for_each(&mut each))
    }

    /// Reads `count` rows, some at a time, and calls `each` with the bytes of each piece.
    fn pieces(
        &self,
        count: u64,
        buffers: &mut Buffers<'_>,
        mut each: impl FnMut(&[u8], &Buffers<'_>) -> Parsed<()>,
    ) -> Parsed<()> {
        let rows = (PIECE / self.stride).max(1);
        let mut bytes = Vec::new();
        let mut done = 0;
        while done < count {
            let n = rows.min(count - done);
            let len = (n - 1) * self.stride + self.row;
            let Some(range) = self.range.part(done * self.stride, len) else {
                return Err("a range ends outside of its buffer view".into());
            };
            bytes.resize(len as usize, 0);
            buffers.read(range, &mut bytes)?;
            each(&bytes, buffers)?;
            done += n;
        }
        Ok(())
    }
}

/// Returns `count` rows of `row` bytes from byte `offset` of a buffer view, if they are inside.
fn strided(
    model: &Model,
    (view, offset): (usize, u64),
    count: u64,
    row: u64,
    name: &str,
    buffers: &mut Buffers<'_>,
) -> Parsed<Strided> {
    let (range, stride) = buffers.view(model, view)?;
    let stride = stride.unwrap_or(row);
    if stride < row {
        return Err(format!("{name}: a stride of {stride} bytes is too small for elements of {row} bytes").into());
    }
    let len = match count.checked_sub(1) {
        Some(more) => more.checked_mul(stride).and_then(|bytes| bytes.checked_add(row)),
        None => Some(0),
    };
    match len.and_then(|len| range.part(offset, len)) {
        Some(range) => Ok(Strided { range, stride, row }),
        None => Err(format!(
            "{name}: {count} elements of {stride} bytes from {offset} end outside of bufferViews[{view}] ({} bytes)",
            range.len()
        )
        .into()),
    }
}

fn sparse(
    model: &Model,
    accessor: &Accessor,
    row: u64,
    name: &str,
    buffers: &mut Buffers<'_>,
) -> Parsed<Option<Sparse>> {
    let Some(sparse) = &accessor.sparse else { return Ok(None) };
    let (count, index_type) = (sparse.count, sparse.index_type);
    let name = format!("{name}.sparse");
    let indices = strided(model, sparse.indices, count, index_type.size() as u64, &name, buffers)?;
    let values = strided(model, sparse.values, count, row, &name, buffers)?;
    Ok(Some(Sparse { count, indices, index_type, values }))
}

/// Converts a component. A slice that is too short gives 0; callers rule that out.
fn float(bytes: &[u8], ty: Component, normalized: bool) -> f32 {
    let two = || bytes.first_chunk().copied().unwrap_or_default();
    let four = || bytes.first_chunk().copied().unwrap_or_default();
    let one = bytes.first().copied().unwrap_or(0);
    let (value, scale) = match ty {
        Component::F32 => return f32::from_le_bytes(four()),
        Component::U32 => return u32::from_le_bytes(four()) as f32,
        Component::I8 => (f32::from(one as i8), 127.0),
        Component::U8 => (f32::from(one), 255.0),
        Component::I16 => (f32::from(i16::from_le_bytes(two())), 32767.0),
        Component::U16 => (f32::from(u16::from_le_bytes(two())), 65535.0),
    };
    if normalized { (value / scale).max(-1.0) } else { value }
}

fn unsigned(bytes: &[u8], ty: Component) -> u32 {
    match ty {
        Component::U8 | Component::I8 => u32::from(bytes.first().copied().unwrap_or(0)),
        Component::U16 | Component::I16 => {
            u32::from(u16::from_le_bytes(bytes.first_chunk().copied().unwrap_or_default()))
        }
        Component::U32 | Component::F32 => u32::from_le_bytes(bytes.first_chunk().copied().unwrap_or_default()),
    }
}
