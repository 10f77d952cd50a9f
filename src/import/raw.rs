//! The raw soup: triangles without connectivity, the simplest file for another program to write.
//!
//! All values are little-endian, without padding. The file ends after the last record.
//!
//! | offset | bytes | content |
//! |---|---|---|
//! | 0 | 8 | magic: `OCSOUP`, carriage return, line feed |
//! | 8 | 4 | version, `u32`: 1 |
//! | 12 | 4 | flags, `u32`: 1 = coordinates are `f64` (else `f32`), 2 = each triangle has a part; other bits 0 |
//! | 16 | 8 | number of triangles, `u64` |
//! | 24 | 8 | reserved, 0 |
//! | 32 | … | records: nine coordinates (x, y, z of three corners), then with flag 2 a `u32` part |
//!
//! Parts are identified by their number, which becomes the part's id. They may come in any order, but runs of the same
//! part are read faster. Without flag 2 the whole file is one part with the file's name. Triangles keep their order:
//! the primitive id of a triangle is its index in the file.

use super::batch::{Batch, Corners};
use super::input::Input;
use super::{MaterialDesc, MeshKey, PartDesc, PartKey, Sink, stem};
use crate::base::error::{Error, Place, Result};
use glam::DVec3;
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

pub(crate) const MAGIC: [u8; 8] = *b"OCSOUP\r\n";
const VERSION: u32 = 1;
const DOUBLE: u32 = 1;
const PARTS: u32 = 2;
const HEADER: usize = 32;
const COUNT_AT: u64 = 16;

/// Layout of the records of a raw soup.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RawLayout {
    /// Double-precision coordinates (72 bytes per triangle instead of 36).
    pub double: bool,
    /// A part for each triangle (4 more bytes).
    pub parts: bool,
}

impl RawLayout {
    fn flags(self) -> u32 {
        u32::from(self.double) * DOUBLE + u32::from(self.parts) * PARTS
    }

    fn coordinates(self) -> usize {
        if self.double { 72 } else { 36 }
    }

    fn record(self) -> usize {
        self.coordinates() + if self.parts { 4 } else { 0 }
    }
}

/// Writes a raw soup of any length. Not thread-safe: use one writer per file.
///
/// Until [`RawWriter::finish`] the header announces more triangles than the file holds, so that readers refuse it.
pub struct RawWriter {
    path: PathBuf,
    out: BufWriter<File>,
    layout: RawLayout,
    count: u64,
}

impl RawWriter {
    /// Creates the file at `path`, or empties an existing one. Fails with `Io`.
    pub fn create(path: &Path, layout: RawLayout) -> Result<Self> {
        let file = File::create(path).map_err(|e| Error::io(path, "create", e))?;
        let mut writer =
            Self { path: path.to_path_buf(), out: BufWriter::with_capacity(1 << 18, file), layout, count: 0 };
        writer.write(&MAGIC)?;
        writer.write(&VERSION.to_le_bytes())?;
        writer.write(&layout.flags().to_le_bytes())?;
        writer.write(&u64::MAX.to_le_bytes())?;
        writer.write(&[0; 8])?;
        Ok(writer)
    }

    /// Adds triangles of one part. A layout without parts ignores `part`; a layout in single precision rounds
    /// coordinates to nearest. Fails with `Io`.
    pub fn triangles(&mut self, part: u32, triangles: &[[DVec3; 3]]) -> Result<()> {
        for corners in triangles {
            for coordinate in corners.iter().flat_map(|c| c.to_array()) {
                if self.layout.double {
                    self.write(&coordinate.to_le_bytes())?;
                } else {
                    self.write(&(coordinate as f32).to_le_bytes())?;
                }
            }
            if self.layout.parts {
                self.write(&part.to_le_bytes())?;
            }
            self.count += 1;
        }
        Ok(())
    }

    /// Writes the count, flushes, and returns the number of triangles in the file. Fails with `Io`.
    pub fn finish(mut self) -> Result<u64> {
        self.out.seek(SeekFrom::Start(COUNT_AT)).map_err(|e| Error::io(&self.path, "seek", e))?;
        self.write(&self.count.to_le_bytes())?;
        self.out.flush().map_err(|e| Error::io(&self.path, "write", e))?;
        Ok(self.count)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.out.write_all(bytes).map_err(|e| Error::io(&self.path, "write", e))
    }
}

/// Reads a raw soup from the beginning of the file.
pub(crate) fn read(input: &mut Input, sink: &mut dyn Sink) -> Result<()> {
    let (layout, count) = header(input)?;
    let mut parts = Parts { one: None, keys: HashMap::new() };
    let mut batch = Batch::new(0);
    if !layout.parts {
        let part = sink.part(PartDesc { name: stem(input.path()), ..PartDesc::default() })?;
        batch.aim(MeshKey::DIRECT, part, MaterialDesc::default().colour, sink)?;
    }
    let mut done = 0;
    while done < count {
        if !input.ensure(layout.record())? {
            return Err(Error::parse(
                input.path(),
                Place::Byte(input.offset()),
                "the file became shorter while being read",
            ));
        }
        let mut n = 0;
        let most = usize::try_from(count - done).unwrap_or(usize::MAX);
        for record in input.available().chunks_exact(layout.record()).take(most) {
            if layout.parts {
                let (_, id) = record.split_at(layout.coordinates());
                let id = u32::from_le_bytes(id.first_chunk().copied().unwrap_or_default());
                let part = parts.find(id, sink)?;
                batch.aim(MeshKey::DIRECT, part, MaterialDesc::default().colour, sink)?;
            }
            n += 1;
            if batch.push(corners(record, layout.double), Corners::default()) {
                break;
            }
        }
        input.consume(n * layout.record());
        done += n as u64;
        if batch.is_full() {
            sink.at(input.offset(), input.total());
            batch.flush(sink)?;
        }
    }
    batch.flush(sink)?;
    if count == 0 {
        sink.note(format!("{}: no triangles; the model is empty", input.path().display()));
    }
    Ok(())
}

/// Returns the layout and the number of triangles; the file is checked to hold exactly as many.
fn header(input: &mut Input) -> Result<(RawLayout, u64)> {
    let fail = |input: &Input, at: u64, why: String| Err(Error::parse(input.path(), Place::Byte(at), why));
    let Some(header) = input.take::<HEADER>()? else {
        return fail(input, input.total(), "the file ends inside the header".into());
    };
    let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
    if word(8) != VERSION {
        return fail(input, 8, format!("version {} of the raw soup; only {VERSION} is supported", word(8)));
    }
    let flags = word(12);
    if flags & !(DOUBLE | PARTS) != 0 || long(24) != 0 {
        return fail(input, 12, "unknown flags, or reserved bytes that are not 0".into());
    }
    let layout = RawLayout { double: flags & DOUBLE != 0, parts: flags & PARTS != 0 };
    let (count, body) = (long(16), input.remaining());
    match count.checked_mul(layout.record() as u64) {
        Some(bytes) if bytes == body => Ok((layout, count)),
        Some(bytes) if bytes < body => fail(
            input,
            HEADER as u64 + bytes,
            format!("unexpected data: {} bytes after the last of {count} triangles", body - bytes),
        ),
        _ => {
            let there = body / layout.record() as u64;
            fail(input, input.total(), format!("the file ends after {there} of {count} triangles"))
        }
    }
}

fn corners(record: &[u8], double: bool) -> [DVec3; 3] {
    let number = |i: usize| match double {
        true => record[8 * i..].first_chunk().map_or(f64::NAN, |b| f64::from_le_bytes(*b)),
        false => record[4 * i..].first_chunk().map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(*b))),
    };
    std::array::from_fn(|v| DVec3::new(number(3 * v), number(3 * v + 1), number(3 * v + 2)))
}

/// Parts by number, with the last one cached.
struct Parts {
    one: Option<(u32, PartKey)>,
    keys: HashMap<u32, PartKey>,
}

impl Parts {
    #[inline]
    fn find(&mut self, id: u32, sink: &mut dyn Sink) -> Result<PartKey> {
        if let Some((last, key)) = self.one
            && last == id
        {
            return Ok(key);
        }
        let key = match self.keys.get(&id) {
            Some(&key) => key,
            None => {
                let part = PartDesc { id: Some(u64::from(id)), name: format!("part {id}"), ..PartDesc::default() };
                let key = sink.part(part)?;
                self.keys.insert(id, key);
                key
            }
        };
        self.one = Some((id, key));
        Ok(key)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::collect::Collector;
    use crate::import::testing::{read_bytes, refuses_every_truncation, temporary};
    use proptest::prelude::*;

    fn written(layout: RawLayout, parts: &[u32], triangles: &[[DVec3; 3]]) -> Vec<u8> {
        let folder = temporary();
        let path = folder.path().join("t.soup");
        let mut writer = RawWriter::create(&path, layout).unwrap();
        for (&part, triangle) in parts.iter().zip(triangles) {
            writer.triangles(part, std::slice::from_ref(triangle)).unwrap();
        }
        assert_eq!(writer.finish().unwrap(), triangles.len() as u64);
        std::fs::read(path).unwrap()
    }

    fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
        let corner = || prop::array::uniform3(-8i32..8).prop_map(|c| DVec3::from(c.map(f64::from)));
        prop::array::uniform3(corner())
    }

    proptest! {
        #[test]
        fn written_soups_are_read_back(
            rows in prop::collection::vec((0u32..4, triangle()), 0..40),
            double: bool,
            parts: bool,
        ) {
            let (ids, triangles): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
            let sink: Collector = read_bytes("t.soup", written(RawLayout { double, parts }, &ids, &triangles)).unwrap();
            prop_assert_eq!(sink.direct().iter().map(|t| t.positions).collect::<Vec<_>>(), triangles);
            if parts {
                let read: Vec<_> = sink.direct().iter().map(|t| sink.parts[t.part as usize].id).collect();
                prop_assert_eq!(read, ids.iter().map(|&id| Some(u64::from(id))).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn every_other_length_is_refused() {
        let bytes = written(RawLayout { double: false, parts: true }, &[7, 8], &[[DVec3::ZERO, DVec3::X, DVec3::Y]; 2]);
        refuses_every_truncation("t.soup", &bytes);
        let error = read_bytes("t.soup", [&bytes[..], &[0]].concat()).unwrap_err().to_string();
        assert!(error.contains("byte 112") && error.contains("1 bytes after"), "{error}");
    }

    #[test]
    fn claims_beyond_all_files_are_refused() {
        let bytes = written(RawLayout::default(), &[0], &[[DVec3::ZERO, DVec3::X, DVec3::Y]]);
        for count in [2u64, 1 << 32, (1 << 32) + 1, u64::MAX / 36 + 1, u64::MAX] {
            let mut damaged = bytes.clone();
            damaged[16..24].copy_from_slice(&count.to_le_bytes());
            let error = read_bytes("t.soup", &damaged).unwrap_err().to_string();
            assert!(error.contains(&format!("1 of {count} triangles")), "{error}");
        }
    }
}
