//! The binary form: a header of 80 bytes, a count, and 50 bytes per triangle.

use crate::base::error::{Error, Place, Result};
use crate::import::batch::{Batch, Corners};
use crate::import::input::Input;
use crate::import::{MaterialDesc, MeshKey, PartDesc, Sink, UpAxis, colour, stem};
use glam::DVec3;

/// Bytes of a triangle: a normal and three corners as `f32`, then 16 bits of attributes.
const RECORD: usize = 50;

/// Interpretation of the 16 attribute bits.
#[derive(Clone, Copy)]
enum Colours {
    /// Bit 15 is set for a colour; blue, green and red from bit 0.
    VisCam,
    /// Bit 15 is clear for a colour; red, green and blue from bit 0.
    Magics,
}

/// Reads a binary STL file from its beginning.
pub(crate) fn read(input: &mut Input, sink: &mut dyn Sink) -> Result<()> {
    let (header, count) = match (input.take::<80>()?, input.take::<4>()?) {
        (Some(header), Some(count)) => (header, u64::from(u32::from_le_bytes(count))),
        _ => return Err(Error::parse(input.path(), Place::Byte(input.total()), "the file ends inside the header")),
    };
    let room = input.remaining() / RECORD as u64;
    if room < count {
        let why = format!("the file ends after {room} of the {count} triangles that its header announces");
        return Err(Error::parse(input.path(), Place::Byte(input.total()), why));
    }
    let magics = magics_material(&header);
    let (colours, looks) = match magics {
        Some(material) => (Colours::Magics, material),
        None => (Colours::VisCam, MaterialDesc::default()),
    };
    sink.units(None, UpAxis::Z);
    let material = magics.map(|m| sink.material(m)).transpose()?;
    let part = sink.part(PartDesc { name: stem(input.path()), material, ..PartDesc::default() })?;
    let mut batch = Batch::new(part);
    batch.aim(MeshKey::DIRECT, part, looks.colour, sink)?;
    let mut done = 0;
    while done < count {
        if !input.ensure(RECORD)? {
            return Err(Error::parse(
                input.path(),
                Place::Byte(input.offset()),
                "the file became shorter while being read",
            ));
        }
        let records = input.available().chunks_exact(RECORD).take((count - done) as usize);
        let mut n = 0;
        for record in records {
            n += 1;
            if batch.push(corners(record), Corners::plain(own_colour(record, colours))) {
                break;
            }
        }
        input.consume(n * RECORD);
        done += n as u64;
        sink.at(input.offset(), input.total());
        batch.flush(sink)?;
    }
    report(input, count, sink);
    Ok(())
}

fn report(input: &Input, count: u64, sink: &mut dyn Sink) {
    let file = input.path().display();
    if count == 0 {
        sink.note(format!("{file}: no triangles; the model is empty"));
    }
    if input.remaining() > 0 {
        let n = input.remaining();
        sink.note(format!("{file}: {n} bytes after the last of {count} triangles were not read"));
    }
}

fn corners(record: &[u8]) -> [DVec3; 3] {
    let number = |i: usize| record[12 + 4 * i..].first_chunk().map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(*b)));
    std::array::from_fn(|v| DVec3::new(number(3 * v), number(3 * v + 1), number(3 * v + 2)))
}

#[inline]
fn own_colour(record: &[u8], colours: Colours) -> Option<[f32; 3]> {
    let bits = u16::from_le_bytes([record[48], record[49]]);
    let five = |shift: u32| colour::linear(f32::from(bits >> shift & 31) / 31.0);
    match colours {
        Colours::VisCam => (bits >> 15 == 1).then(|| [five(10), five(5), five(0)]),
        Colours::Magics => (bits >> 15 == 0).then(|| [five(0), five(5), five(10)]),
    }
}

/// Returns the material of the whole part, if Magics wrote the file.
fn magics_material(header: &[u8; 80]) -> Option<MaterialDesc> {
    let at = memchr::memmem::find(header, b"COLOR=")?;
    let &[r, g, b, a] = header[at + 6..].first_chunk()?;
    let opacity = f32::from(a) / 255.0;
    Some(MaterialDesc { colour: colour::linear_bytes([r, g, b]), opacity, ..MaterialDesc::default() })
}
