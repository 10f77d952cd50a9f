//! The scene file: rows, header and the bytes around them (FORMAT.md, section 9). Scenes are written from front to back
//! and read the same way, so that no more than the rows is in memory.

use super::source::Source;
use crate::base::bytes::{ByteReader, Checked, Malformed, PutBytes, ensure, is_zero};
use crate::base::error::{Error, Result};
use crate::base::inputs::Inputs;
use crate::base::memory::room;
use crate::base::output::{Medium, OutputFile};
use crate::base::quota::Quota;
use std::io;
use std::path::Path;
use std::sync::Arc;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// The first eight bytes of a scene file: those of a model file with another third letter.
pub const SCENE_MAGIC: [u8; 8] = *b"\x8fOCS\r\n\x1a\n";
/// The newest format version, major and minor, that the library reads. It writes it where an array has masks or tints.
pub const SCENE_VERSION: (u16, u16) = (0, 2);
/// The version of files without masks and tints of members, which the library writes and reads too.
pub const PLAIN_VERSION: (u16, u16) = (0, 1);
/// Number of bytes of the header.
pub const SCENE_HEADER_LEN: usize = 96;
/// Number of bytes behind the last scene: the checksum of all before it.
pub const SCENE_FOOTER_LEN: usize = 8;
/// Greatest number of bytes of the path of a model.
pub const MOST_PATH: usize = 4096;
/// Greatest number of lights.
pub const MOST_LIGHTS: u32 = 1 << 16;
/// Tables begin at multiples of this number of bytes.
const ALIGN: usize = 8;
/// Greatest number of bytes that are read or written at once.
const PIECE: usize = 1 << 20;
/// The mask of instances that all rays see.
pub const ALL_RAYS: u32 = u32::MAX;

const RESERVED_AT: usize = 72;
const CHECKSUM_AT: usize = SCENE_HEADER_LEN - 8;

/// Number of zeros behind `len` bytes of a table.
pub fn padding(len: u64) -> u64 {
    len.next_multiple_of(ALIGN as u64) - len
}

/// True if the first bytes of the file are those of a scene file. Fails with [`Error::Io`].
pub fn is_scene_file(source: &dyn Source) -> Result<bool> {
    let mut magic = [0; SCENE_MAGIC.len()];
    if source.len() < magic.len() as u64 {
        return Ok(false);
    }
    source.read_at(0, &mut magic).map_err(|e| Error::io(source.name(), "read", e))?;
    Ok(magic == SCENE_MAGIC)
}

/// A row of fixed size.
pub trait SceneFileRow: Sized {
    /// Number of bytes.
    const LEN: usize;
    /// Appends the row.
    fn put(&self, out: &mut Vec<u8>);
    /// Reads a row and checks what it alone determines.
    fn get(r: &mut ByteReader) -> Checked<Self>;
}

/// The header.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneHeader {
    /// The format version.
    pub version: (u16, u16),
    /// Number of models.
    pub models: u32,
    /// Number of scenes, at least 1. The last one is the scene that was saved.
    pub scenes: u32,
    /// Number of lights.
    pub lights: u32,
    /// 0: one colour, 1: a gradient.
    pub background: u32,
    /// The colour and four zeros, or the colours at the bottom and at the top; linear RGBA, finite, at least 0.
    pub colours: [f32; 8],
}

impl SceneHeader {
    fn encode(&self, file_len: u64) -> Vec<u8> {
        let mut out = Vec::with_capacity(SCENE_HEADER_LEN);
        out.put_bytes(&SCENE_MAGIC);
        out.put_u16(self.version.0);
        out.put_u16(self.version.1);
        out.put_u32(SCENE_HEADER_LEN as u32);
        out.put_u64(file_len);
        out.put_u32(self.models);
        out.put_u32(self.scenes);
        out.put_u32(self.lights);
        out.put_u32(self.background);
        out.put_f32s(&self.colours);
        debug_assert_eq!(out.len(), RESERVED_AT);
        out.put_zeros_to(CHECKSUM_AT);
        out.put_u64(xxh3_64(&out));
        out
    }

    /// Reads the header and the number of bytes of the file.
    fn decode(bytes: &[u8; SCENE_HEADER_LEN]) -> Checked<(Self, u64)> {
        let mut r = ByteReader::new(bytes);
        r.take(SCENE_MAGIC.len())?;
        let version = (r.u16()?, r.u16()?);
        ensure(r.u32()? as usize == SCENE_HEADER_LEN, "the header has a wrong size")?;
        let file_len = r.u64()?;
        let (models, scenes, lights, background) = (r.u32()?, r.u32()?, r.u32()?, r.u32()?);
        let colours = r.f32s()?;
        r.zeros(CHECKSUM_AT - RESERVED_AT)?;
        ensure(r.u64()? == xxh3_64(&bytes[..CHECKSUM_AT]), "the header is damaged (checksum mismatch)")?;
        ensure(scenes > 0, "the file has no scene")?;
        ensure(lights <= MOST_LIGHTS, "more than 65536 lights")?;
        ensure(background <= 1, "unknown kind of background")?;
        ensure(background == 1 || colours[4..].iter().all(|x| x.to_bits() == 0), "unused colours are not zero")?;
        Ok((Self { version, models, scenes, lights, background, colours }, file_len))
    }
}

/// A light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightRow {
    /// 0 headlight, 1 point, 2 directional.
    pub kind: u32,
    /// True if it casts shadows.
    pub shadows: bool,
    /// Linear RGB.
    pub colour: [f32; 3],
    /// Factor to the colour.
    pub intensity: f32,
    /// The position of a point light or the direction of a directional one, in world space; otherwise zeros.
    pub vector: [f64; 3],
}

impl SceneFileRow for LightRow {
    const LEN: usize = 48;
    fn put(&self, out: &mut Vec<u8>) {
        out.put_u32(self.kind);
        out.put_u32(self.shadows.into());
        out.put_f32s(&self.colour);
        out.put_f32(self.intensity);
        out.put_f64s(&self.vector);
    }
    fn get(r: &mut ByteReader) -> Checked<Self> {
        let (kind, flags, colour, intensity, vector) = (r.u32()?, r.u32()?, r.f32s()?, r.f32()?, r.f64s()?);
        ensure(kind <= 2 && flags <= 1, "unknown kind of light, or unknown flags")?;
        ensure(kind != 0 || vector.iter().all(|x| x.to_bits() == 0), "a headlight has a place")?;
        Ok(Self { kind, shadows: flags == 1, colour, intensity, vector })
    }
}

/// A model, without its path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ModelFileRow {
    /// Number of bytes of its file.
    pub bytes: u64,
    /// XXH3 of its header, which holds the checksums of the rest: see [`super::ModelFile::fingerprint`].
    pub fingerprint: u64,
    /// Number of bytes of its path, which follows, padded to a multiple of 8.
    pub path_len: u32,
}

impl SceneFileRow for ModelFileRow {
    const LEN: usize = 24;
    fn put(&self, out: &mut Vec<u8>) {
        out.put_u64(self.bytes);
        out.put_u64(self.fingerprint);
        out.put_u32(self.path_len);
        out.put_u32(0);
    }
    fn get(r: &mut ByteReader) -> Checked<Self> {
        let row = Self { bytes: r.u64()?, fingerprint: r.u64()?, path_len: r.u32()? };
        r.zeros(4)?;
        ensure((1..=MOST_PATH).contains(&(row.path_len as usize)), "the path of a model is empty or too long")?;
        Ok(row)
    }
}

/// Checks the path of a model: relative, with `/` between names, and `..` only in front. Names that another system
/// takes for drives, servers or several names are refused too.
pub fn check_path(path: &str) -> Checked<()> {
    let mut names = path.split('/').peekable();
    while names.next_if_eq(&"..").is_some() {}
    ensure(names.peek().is_some(), "the path of a model names no file")?;
    let has_drive = |name: &str| name.as_bytes().get(1) == Some(&b':');
    let is_name = |name: &str| {
        !name.is_empty() && name != "." && name != ".." && !name.contains(['\0', '\\']) && !has_drive(name)
    };
    ensure(names.all(is_name), "the path of a model is not relative and in its shortest form")
}

/// The numbers of rows of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SceneRow {
    /// Single instances of models.
    pub singles: u32,
    /// States of these.
    pub single_states: u32,
    /// Single instances of scenes.
    pub scenes: u32,
    /// States of these.
    pub scene_states: u32,
    /// Arrays of models.
    pub arrays: u32,
    /// Arrays of scenes.
    pub scene_arrays: u32,
}

impl SceneFileRow for SceneRow {
    const LEN: usize = 24;
    fn put(&self, out: &mut Vec<u8>) {
        let Self { singles, single_states, scenes, scene_states, arrays, scene_arrays } = *self;
        for count in [singles, single_states, scenes, scene_states, arrays, scene_arrays] {
            out.put_u32(count);
        }
    }
    fn get(r: &mut ByteReader) -> Checked<Self> {
        let (singles, single_states, scenes) = (r.u32()?, r.u32()?, r.u32()?);
        let (scene_states, arrays, scene_arrays) = (r.u32()?, r.u32()?, r.u32()?);
        Ok(Self { singles, single_states, scenes, scene_states, arrays, scene_arrays })
    }
}

/// A single instance of a model or a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingleRow {
    /// The caller's id.
    pub id: u64,
    /// Index of the model, or of an earlier scene.
    pub of: u32,
    /// Columns of the map to the scene: the images of x, y, z, then the translation.
    pub map: [f64; 12],
}

impl SceneFileRow for SingleRow {
    const LEN: usize = 112;
    fn put(&self, out: &mut Vec<u8>) {
        out.put_u64(self.id);
        out.put_u32(self.of);
        out.put_u32(0);
        out.put_f64s(&self.map);
    }
    fn get(r: &mut ByteReader) -> Checked<Self> {
        let (id, of) = (r.u64()?, r.u32()?);
        r.zeros(4)?;
        Ok(Self { id, of, map: r.f64s()? })
    }
}

/// The mask and the look of an instance that are not those of all others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateRow {
    /// Index of the instance in its list, or of the member in its array.
    pub index: u32,
    /// The mask.
    pub mask: u32,
    /// True if rays can hit it.
    pub visible: bool,
    /// True if it is highlighted.
    pub selected: bool,
    /// Linear RGBA in place of its own colour.
    pub colour: Option<[f32; 4]>,
}

impl SceneFileRow for StateRow {
    const LEN: usize = 32;
    fn put(&self, out: &mut Vec<u8>) {
        out.put_u32(self.index);
        out.put_u32(self.mask);
        let flags = [!self.visible, self.selected, self.colour.is_some()];
        out.put_u32((0..).zip(flags).map(|(bit, is_set)| u32::from(is_set) << bit).sum());
        out.put_u32(0);
        out.put_f32s(&self.colour.unwrap_or_default());
    }
    fn get(r: &mut ByteReader) -> Checked<Self> {
        let (index, mask, flags) = (r.u32()?, r.u32()?, r.u32()?);
        r.zeros(4)?;
        let colour: [f32; 4] = r.f32s()?;
        ensure(flags < 8, "unknown flags of a look")?;
        let has_colour = flags & 4 != 0;
        ensure(has_colour || colour.iter().all(|x| x.to_bits() == 0), "an unused colour is not zero")?;
        Ok(Self {
            index,
            mask,
            visible: flags & 1 == 0,
            selected: flags & 2 != 0,
            colour: has_colour.then_some(colour),
        })
    }
}

/// An array of instances.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArrayRow {
    /// The form of its transforms: 0 affine in f64, 1 affine in f32, 2 place.
    pub form: u32,
    /// Number of members, from 1 to below 2^31.
    pub members: u32,
    /// Id of the first member; each further one has the next higher id.
    pub first_id: u64,
    /// Number of prototypes, at least 1.
    pub prototypes: u32,
    /// True if each member has an index of a prototype; otherwise all are of the first.
    pub has_indices: bool,
    /// True if each member has a mask of its own.
    pub has_masks: bool,
    /// True if each member has a tint.
    pub has_tints: bool,
    /// The mask of members without a state.
    pub mask: u32,
    /// Number of states.
    pub states: u32,
}

impl ArrayRow {
    /// Bytes of a transform of each form.
    pub const FORMS: [usize; 3] = [96, 48, 44];

    /// Bytes of a transform.
    pub fn transform_len(&self) -> usize {
        Self::FORMS[self.form as usize]
    }
}

impl SceneFileRow for ArrayRow {
    const LEN: usize = 32;
    fn put(&self, out: &mut Vec<u8>) {
        out.put_u32(self.form);
        out.put_u32(self.members);
        out.put_u64(self.first_id);
        out.put_u32(self.prototypes);
        let flags = [self.has_indices, self.has_masks, self.has_tints];
        out.put_u32((0..).zip(flags).map(|(bit, is_set)| u32::from(is_set) << bit).sum());
        out.put_u32(self.mask);
        out.put_u32(self.states);
    }
    fn get(r: &mut ByteReader) -> Checked<Self> {
        let (form, members, first_id, prototypes) = (r.u32()?, r.u32()?, r.u64()?, r.u32()?);
        let (flags, mask, states) = (r.u32()?, r.u32()?, r.u32()?);
        ensure((form as usize) < Self::FORMS.len(), "unknown form of transforms")?;
        ensure(flags < 8, "unknown flags of an array")?;
        ensure((1..1 << 31).contains(&members), "an array must have from 1 to 2^31 - 1 members")?;
        ensure(prototypes > 0, "an array has no prototype")?;
        let [has_indices, has_masks, has_tints] = [0, 1, 2].map(|bit| flags >> bit & 1 == 1);
        Ok(Self { form, members, first_id, prototypes, has_indices, has_masks, has_tints, mask, states })
    }
}

/// Writes a scene file under a temporary name in the same folder. An older file of the same name is unchanged until
/// [`SceneWriter::finish`].
pub struct SceneWriter {
    medium: OutputFile,
    buffer: Vec<u8>,
    hash: Xxh3,
    at: u64,
    file_len: u64,
}

impl SceneWriter {
    /// Begins the file that will be `path` and will have `file_len` bytes. It replaces none of `inputs`. Fails with
    /// [`Error::Io`] or [`Error::BadArgument`].
    pub fn create(path: &Path, inputs: &Inputs, header: &SceneHeader, file_len: u64) -> Result<Self> {
        let medium = OutputFile::create(path)?.guarded(inputs, &Quota::default())?;
        let buffer = room(PIECE, "writing a scene")?;
        let mut writer = Self { medium, buffer, hash: Xxh3::new(), at: 0, file_len };
        writer.put(|out| out.put_bytes(&header.encode(file_len)))?;
        Ok(writer)
    }

    /// Appends what `put` appends, at most a few kilobytes.
    pub fn put(&mut self, put: impl FnOnce(&mut Vec<u8>)) -> Result<()> {
        if self.buffer.len() > PIECE / 2 {
            self.flush()?;
        }
        put(&mut self.buffer);
        Ok(())
    }

    /// Appends a row.
    pub fn row(&mut self, row: &impl SceneFileRow) -> Result<()> {
        self.put(|out| row.put(out))
    }

    /// Appends zeros up to the next table.
    pub fn pad(&mut self) -> Result<()> {
        let zeros = padding(self.at + self.buffer.len() as u64) as usize;
        self.put(|out| out.put_zeros_to(out.len() + zeros))
    }

    fn flush(&mut self) -> Result<()> {
        self.hash.update(&self.buffer);
        self.at += self.buffer.len() as u64;
        self.medium.append(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }

    /// Appends the checksum, makes the file durable and gives it its name.
    pub fn finish(mut self) -> Result<()> {
        self.flush()?;
        let checksum = self.hash.digest();
        self.put(|out| out.put_u64(checksum))?;
        self.flush()?;
        if self.at != self.file_len {
            return Err(Error::Internal(format!("a scene file of {} bytes, not {}", self.at, self.file_len)));
        }
        self.medium.publish()
    }
}

/// Reads a scene file from front to back. Its size is compared with what rows claim before memory is taken for them.
pub struct SceneReader {
    source: Arc<dyn Source>,
    buffer: Vec<u8>,
    /// Offset in the buffer of the first byte that was not taken, and in the file of the first that was not read.
    at: usize,
    next: u64,
    /// Offset of the checksum.
    end: u64,
    hash: Xxh3,
}

impl SceneReader {
    /// Reads and checks the header. Fails with [`Error::Corrupt`], [`Error::NewerFormat`] or [`Error::Io`].
    pub fn open(source: Arc<dyn Source>) -> Result<(Self, SceneHeader)> {
        let (name, len) = (source.name().to_path_buf(), source.len());
        let fail = |why: Malformed| Error::corrupt(&name, None, why.0);
        let mut head = [0; SCENE_HEADER_LEN];
        let there = len.min(SCENE_HEADER_LEN as u64) as usize;
        source.read_at(0, &mut head[..there]).map_err(|e| Error::io(&name, "read", e))?;
        check_magic(&head[..there]).map_err(fail)?;
        let version = (u16::from_le_bytes([head[8], head[9]]), u16::from_le_bytes([head[10], head[11]]));
        if there >= 12 && version > SCENE_VERSION {
            return Err(Error::NewerFormat { file: name, found: version, supported: SCENE_VERSION });
        }
        ensure(there == SCENE_HEADER_LEN, "truncated: shorter than its header").map_err(fail)?;
        let is_known = version == SCENE_VERSION || version == PLAIN_VERSION;
        ensure(is_known, "written in an early format that is no longer supported").map_err(fail)?;
        let (header, file_len) = SceneHeader::decode(&head).map_err(fail)?;
        if file_len != len {
            let why = format!("the file has {len} bytes instead of {file_len}: truncated or damaged");
            return Err(Error::corrupt(&name, None, why));
        }
        let end = len.checked_sub(SCENE_FOOTER_LEN as u64).filter(|end| *end >= SCENE_HEADER_LEN as u64);
        let end = end.ok_or_else(|| Error::corrupt(&name, None, "truncated: it has no checksum"))?;
        let mut hash = Xxh3::new();
        hash.update(&head);
        let buffer = room(PIECE, "reading a scene")?;
        Ok((Self { source, buffer, at: 0, next: SCENE_HEADER_LEN as u64, end, hash }, header))
    }

    /// Offset in the file of the next byte.
    pub fn offset(&self) -> u64 {
        self.next - (self.buffer.len() - self.at) as u64
    }

    /// An [`Error::Corrupt`] that names the file and the place of byte `at`.
    pub fn corrupt_at(&self, at: u64, why: impl std::fmt::Display) -> Error {
        Error::corrupt(self.source.name(), None, format!("byte {at}: {why}"))
    }

    /// Fails with [`Error::Corrupt`] if the rest of the file has no room for `count` rows of `each` bytes.
    pub fn claim(&self, count: u64, each: usize, what: &str) -> Result<()> {
        let left = self.end - self.offset();
        match count.checked_mul(each as u64) {
            Some(bytes) if bytes <= left => Ok(()),
            _ => {
                let why = format!("{count} {what} of {each} bytes or more, but the file has {left} bytes left");
                Err(self.corrupt_at(self.offset(), why))
            }
        }
    }

    /// Takes the next `count` bytes, at most a few kilobytes.
    pub fn take(&mut self, count: usize) -> Result<&[u8]> {
        if self.buffer.len() - self.at < count {
            self.claim(count as u64, 1, "values")?;
            let had = self.buffer.len() - self.at;
            self.buffer.copy_within(self.at.., 0);
            let more = (self.end - self.next).min((PIECE - had) as u64) as usize;
            self.buffer.resize(had + more, 0);
            self.at = 0;
            if let Err(why) = self.source.read_at(self.next, &mut self.buffer[had..]) {
                self.buffer.truncate(had);
                return Err(self.io(why));
            }
            self.next += more as u64;
            self.hash.update(&self.buffer[had..]);
        }
        self.at += count;
        Ok(&self.buffer[self.at - count..self.at])
    }

    fn io(&self, e: io::Error) -> Error {
        match e.kind() {
            io::ErrorKind::UnexpectedEof => Error::corrupt(self.source.name(), None, "truncated"),
            _ => Error::io(self.source.name(), "read", e),
        }
    }

    /// Takes the next row.
    pub fn row<T: SceneFileRow>(&mut self) -> Result<T> {
        let at = self.offset();
        let row = T::get(&mut ByteReader::new(self.take(T::LEN)?));
        row.map_err(|why| self.corrupt_at(at, why))
    }

    /// Takes the next `count` rows, whose number was claimed.
    pub fn rows<T: SceneFileRow>(&mut self, count: u32) -> Result<Vec<T>> {
        let mut all = room(count as usize, "reading a scene")?;
        for _ in 0..count {
            all.push(self.row()?);
        }
        Ok(all)
    }

    /// Skips the zeros up to the next table.
    pub fn pad(&mut self) -> Result<()> {
        let at = self.offset();
        match is_zero(self.take(padding(at) as usize)?) {
            true => Ok(()),
            false => Err(self.corrupt_at(at, "the padding is not zero")),
        }
    }

    /// Reads what is left, and compares the checksum.
    fn has_checksum(&mut self) -> Result<bool> {
        self.at = self.buffer.len();
        while self.next < self.end {
            self.take(1)?;
            self.at = self.buffer.len();
        }
        let mut footer = [0; SCENE_FOOTER_LEN];
        self.source.read_at(self.end, &mut footer).map_err(|e| self.io(e))?;
        Ok(u64::from_le_bytes(footer) == self.hash.digest())
    }

    /// Ends the reading. Fails with `error` if that is given, unless the checksum shows that the file is damaged: what
    /// rows say is then of no interest.
    pub fn finish(mut self, error: Option<Error>) -> Result<()> {
        let is_of_file = matches!(error, None | Some(Error::Corrupt { .. } | Error::OverBudget { .. }));
        let left = self.end - self.offset();
        if is_of_file && !self.has_checksum()? {
            return Err(Error::corrupt(self.source.name(), None, "damaged (checksum mismatch)"));
        }
        match error {
            Some(error) => Err(error),
            None if left > 0 => Err(self.corrupt_at(self.end - left, "unused bytes at the end")),
            None => Ok(()),
        }
    }
}

fn check_magic(bytes: &[u8]) -> Checked<()> {
    if bytes.starts_with(&SCENE_MAGIC) {
        return Ok(());
    }
    ensure(!bytes.starts_with(&super::header::MAGIC), "a model file, not a scene file")?;
    let name_only = |b: &[u8]| b.get(1..4) == Some(b"OCS".as_slice()) && b[0] & 0x7f == SCENE_MAGIC[0] & 0x7f;
    ensure(!name_only(bytes), "the first bytes are damaged, for example by a transfer in text mode")?;
    ensure(!SCENE_MAGIC.starts_with(bytes), "truncated or empty")?;
    Err(Malformed::new("not an outcrop scene"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_relative_and_in_their_shortest_form() {
        for good in ["a.oc", "a/b.oc", "../a.oc", "../../a b/c.oc", "..a/.b"] {
            assert_eq!(check_path(good), Ok(()), "{good}");
        }
        for bad in ["", "/a", "..", "../", "a//b", "a/", "./a", "a/./b", "a/../b", "../a/..", "a\0b"] {
            assert!(check_path(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn rows_come_back() {
        fn check<T: SceneFileRow + PartialEq + std::fmt::Debug>(row: T) {
            let mut bytes = Vec::new();
            row.put(&mut bytes);
            assert_eq!(bytes.len(), T::LEN);
            assert_eq!(T::get(&mut ByteReader::new(&bytes)), Ok(row));
        }
        check(LightRow { kind: 2, shadows: true, colour: [0.5; 3], intensity: 2.0, vector: [1.0, 2.0, -3.0] });
        check(ModelFileRow { bytes: 7, fingerprint: 8, path_len: 9 });
        check(SceneRow { singles: 1, single_states: 2, scenes: 3, scene_states: 4, arrays: 5, scene_arrays: 6 });
        check(SingleRow { id: u64::MAX, of: 4, map: [0.25; 12] });
        let colour = Some([1.0, 0.5, 0.25, 0.0]);
        check(StateRow { index: 3, mask: 6, visible: false, selected: true, colour });
        check(StateRow { index: 3, mask: 6, visible: true, selected: false, colour: None });
        for (has_indices, has_masks, has_tints) in [(true, false, false), (false, true, false), (false, false, true)] {
            let (members, first_id, prototypes, mask, states) = (5, 9, 2, 1, 3);
            check(ArrayRow { form: 2, members, first_id, prototypes, has_indices, has_masks, has_tints, mask, states });
        }
    }
}
