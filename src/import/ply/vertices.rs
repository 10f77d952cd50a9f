//! The element `vertex`: positions, optional colours and normals.

use super::header::{Coding, Element, Kind, Type};
use super::values::{Values, truncated};
use crate::base::error::Result;
use crate::import::ReadOptions;
use crate::import::Sink;
use crate::import::colour;
use crate::import::input::Input;
use crate::import::normals::Normals;
use crate::import::vertices::{Held, Vertices};
use glam::Vec3;

/// Vertices that faces refer to.
pub(crate) struct VertexTable {
    pub(crate) positions: Vertices,
    colours: Option<Colours>,
    normals: Option<Normals>,
}

enum Colours {
    /// sRGB-coded bytes, as in the file.
    Bytes(Vec<[u8; 3]>),
    /// Linear colours.
    Linear(Vec<[f32; 3]>),
}

impl VertexTable {
    /// Creates a table without vertices.
    pub(crate) fn empty() -> Self {
        Self { positions: Vertices::new(true, 0, &ReadOptions::default()), colours: None, normals: None }
    }

    /// True if vertices have normals.
    pub(crate) fn has_normals(&self) -> bool {
        self.normals.is_some()
    }

    /// Returns the normal of vertex `i`, if vertices have normals.
    #[inline]
    pub(crate) fn normal(&self, i: usize) -> Option<Vec3> {
        self.normals.as_ref().map(|normals| normals.get(i))
    }

    /// Returns the linear colour of vertex `i`, if vertices have colours.
    #[inline]
    pub(crate) fn colour(&self, i: usize) -> Option<[f32; 3]> {
        match self.colours.as_ref()? {
            Colours::Bytes(c) => c.get(i).map(|&c| colour::linear_bytes(c)),
            Colours::Linear(c) => c.get(i).copied(),
        }
    }
}

/// The three channels of a colour: index and type of their properties.
pub(crate) type Channels = [(usize, Type); 3];

/// Finds the colour properties, under any of the names in use.
pub(crate) fn channels(element: &Element) -> Option<Channels> {
    let find = |short: &str, long: &str| element.scalar(&[long, &format!("diffuse_{long}"), short]);
    Some([find("r", "red")?, find("g", "green")?, find("b", "blue")?])
}

/// Returns a channel in [0, 1], still coded: integers relative to the range of their type, floats unchanged.
pub(crate) fn channel(value: f64, ty: Type) -> f32 {
    let scale = match ty {
        Type::I8 => 127.0,
        Type::U8 => 255.0,
        Type::I16 => 32767.0,
        Type::U16 => 65535.0,
        Type::F32 | Type::F64 => 1.0,
        // Some writers know only one, wider integer type and store values up to 255 in it.
        _ => 255.0,
    };
    (value / scale) as f32
}

/// Reads all rows of the element `vertex`.
pub(crate) fn read(
    values: &mut impl Values,
    element: &Element,
    coding: Coding,
    options: &ReadOptions,
    sink: &mut dyn Sink,
) -> Result<VertexTable> {
    let axis = |name| element.scalar(&[name]);
    let (Some(x), Some(y), Some(z)) = (axis("x"), axis("y"), axis("z")) else {
        return Err(values.fault("the vertices have no x, y and z".into()));
    };
    let axes = [x, y, z];
    let single = axes.iter().all(|(_, ty)| ty.fits_single());
    let channels = channels(element);
    let across = [axis("nx"), axis("ny"), axis("nz")];
    let across = if let [Some(x), Some(y), Some(z)] = across { Some([x, y, z]) } else { None };
    if let (true, true, None, Some(stride)) = (coding != Coding::Ascii, single, channels, element.row_bytes())
        && let Some(offsets) = float_offsets(element, axes)
    {
        let normals = across.map(|across| float_offsets(element, across));
        if !matches!(normals, Some(None)) {
            let normals = normals.flatten();
            let rows = Rows { count: element.count, stride, offsets, normals, big: coding == Coding::Big };
            return read_floats(values.input(), rows, options, sink);
        }
    }
    let input = values.input();
    let fits = input.remaining() / element.least_bytes(coding).max(1) + 1;
    let capacity = element.count.min(fits) as usize;
    let mut table = VertexTable {
        positions: Vertices::new(single, capacity, options),
        colours: channels.map(|c| match c.iter().all(|&(_, ty)| ty == Type::U8) {
            true => Colours::Bytes(Vec::with_capacity(capacity)),
            false => Colours::Linear(Vec::with_capacity(capacity)),
        }),
        normals: across.map(|_| Normals::with_capacity(capacity)),
    };
    read_rows(values, element, [Some(axes), channels, across], &mut table, sink)?;
    table.positions.complete()?;
    Ok(table)
}

fn read_rows(
    values: &mut impl Values,
    element: &Element,
    wanted: [Option<Channels>; 3],
    table: &mut VertexTable,
    sink: &mut dyn Sink,
) -> Result<()> {
    // Target of each property: 0..3 position, 3..6 colour, 6..9 normal, 9 unused.
    let mut targets = vec![9usize; element.properties.len()];
    for (first, list) in (0..).step_by(3).zip(wanted) {
        list.into_iter().flatten().zip(first..).for_each(|((property, _), slot)| targets[property] = slot);
    }
    let channels = wanted[1];
    let mut row = [0f64; 9];
    for n in 0..element.count {
        if n.is_multiple_of(16384) {
            super::tick(values.input(), sink)?;
            table.positions.settle()?;
        }
        for (property, &target) in element.properties.iter().zip(&targets) {
            match property.kind {
                Kind::Scalar(ty) if target < 9 => row[target] = values.float(ty)?,
                Kind::Scalar(ty) => values.skip(ty, 1)?,
                Kind::List { count, item } => {
                    let n = super::list_length(values, count)?;
                    values.skip(item, n)?;
                }
            }
        }
        values.end_row()?;
        let [x, y, z, r, g, b, nx, ny, nz] = row;
        match table.positions.held() {
            Held::Single(v) => v.push([x as f32, y as f32, z as f32]),
            Held::Double(v) => v.push([x, y, z]),
        }
        match (&mut table.colours, channels) {
            (Some(Colours::Bytes(c)), _) => c.push([r as u8, g as u8, b as u8]),
            (Some(Colours::Linear(c)), Some(ty)) => c.push([
                colour::linear(channel(r, ty[0].1)),
                colour::linear(channel(g, ty[1].1)),
                colour::linear(channel(b, ty[2].1)),
            ]),
            _ => {}
        }
        if let Some(normals) = &mut table.normals {
            normals.push([nx, ny, nz].map(|x| x as f32));
        }
    }
    Ok(())
}

/// Returns the byte offsets of three properties in a row of constant size, if all are `float`.
fn float_offsets(element: &Element, axes: Channels) -> Option<[usize; 3]> {
    let mut offsets = [0; 3];
    for (slot, (property, ty)) in axes.into_iter().enumerate() {
        if ty != Type::F32 {
            return None;
        }
        for p in &element.properties[..property] {
            let Kind::Scalar(ty) = p.kind else { return None };
            offsets[slot] += ty.size() as usize;
        }
    }
    Some(offsets)
}

/// Rows of constant size.
struct Rows {
    count: u64,
    stride: u64,
    /// Byte offsets of x, y and z in a row.
    offsets: [usize; 3],
    /// Byte offsets of the normal.
    normals: Option<[usize; 3]>,
    /// True for big-endian byte order.
    big: bool,
}

/// Reads the usual case, floats at fixed offsets, many rows at a time.
fn read_floats(input: &mut Input, rows: Rows, options: &ReadOptions, sink: &mut dyn Sink) -> Result<VertexTable> {
    let Rows { count, stride, offsets, normals: across, big } = rows;
    if count.checked_mul(stride).is_none_or(|bytes| bytes > input.remaining()) {
        return Err(truncated(input));
    }
    let mut positions = Vertices::new(true, count as usize, options);
    let mut normals = across.map(|_| Normals::with_capacity(count as usize));
    let stride = stride as usize;
    while (positions.len() as u64) < count {
        super::tick(input, sink)?;
        positions.settle()?;
        if !input.ensure(stride)? {
            return Err(truncated(input));
        }
        let rows = (input.available().len() / stride).min(count as usize - positions.len());
        let bytes = &input.available()[..rows * stride];
        let axis = |row: &[u8], at: usize| {
            let four = row[at..].first_chunk().copied().unwrap_or_default();
            if big { f32::from_be_bytes(four) } else { f32::from_le_bytes(four) }
        };
        let points = bytes.chunks_exact(stride).map(|row| offsets.map(|at| axis(row, at)));
        match positions.held() {
            Held::Single(v) => v.extend(points),
            Held::Double(v) => v.extend(points.map(|p| p.map(f64::from))),
        }
        if let (Some(normals), Some(offsets)) = (&mut normals, across) {
            bytes.chunks_exact(stride).for_each(|row| normals.push(offsets.map(|at| axis(row, at))));
        }
        input.consume(rows * stride);
    }
    positions.complete()?;
    Ok(VertexTable { positions, colours: None, normals })
}
