//! Little-endian bytes: a reader that cannot run past the end, and writing into a `Vec<u8>`.

use std::borrow::Cow;
use std::fmt;

/// The reason why bytes do not have the expected form. The caller, which knows the file, makes an
/// [`Error::Corrupt`](super::error::Error::Corrupt) of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Malformed(pub Cow<'static, str>);

impl Malformed {
    /// An error with any text.
    pub fn new(why: impl Into<Cow<'static, str>>) -> Self {
        Self(why.into())
    }
}

impl fmt::Display for Malformed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Malformed {}

/// The result of reading bytes.
pub type Checked<T> = Result<T, Malformed>;

/// Fails with `why` unless `holds`.
pub fn ensure(holds: bool, why: &'static str) -> Result<(), Malformed> {
    if holds { Ok(()) } else { Err(Malformed::new(why)) }
}

/// Reads little-endian values from the front of a slice. Every method fails, and consumes nothing, if the slice is too
/// short.
#[derive(Debug, Clone)]
pub struct ByteReader<'a> {
    rest: &'a [u8],
}

impl<'a> ByteReader<'a> {
    /// Reads from the first byte of `bytes`.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }
    /// Number of bytes that are not yet read.
    pub fn remaining(&self) -> usize {
        self.rest.len()
    }
    /// The next `count` bytes.
    pub fn take(&mut self, count: usize) -> Result<&'a [u8], Malformed> {
        let (head, rest) =
            self.rest.split_at_checked(count).ok_or(Malformed(Cow::Borrowed("unexpected end of data")))?;
        self.rest = rest;
        Ok(head)
    }
    fn array<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        let (head, rest) =
            self.rest.split_first_chunk::<N>().ok_or(Malformed(Cow::Borrowed("unexpected end of data")))?;
        self.rest = rest;
        Ok(*head)
    }
    /// The next byte.
    pub fn u8(&mut self) -> Result<u8, Malformed> {
        self.array::<1>().map(|b| b[0])
    }
    /// The next two bytes.
    pub fn u16(&mut self) -> Result<u16, Malformed> {
        self.array().map(u16::from_le_bytes)
    }
    /// The next four bytes.
    pub fn u32(&mut self) -> Result<u32, Malformed> {
        self.array().map(u32::from_le_bytes)
    }
    /// The next eight bytes.
    pub fn u64(&mut self) -> Result<u64, Malformed> {
        self.array().map(u64::from_le_bytes)
    }
    /// The next four bytes; may be NaN or infinite.
    pub fn f32(&mut self) -> Result<f32, Malformed> {
        self.array().map(f32::from_le_bytes)
    }
    /// The next eight bytes; may be NaN or infinite.
    pub fn f64(&mut self) -> Result<f64, Malformed> {
        self.array().map(f64::from_le_bytes)
    }
    /// The next `4 * N` bytes; may hold NaN or infinity.
    pub fn f32s<const N: usize>(&mut self) -> Result<[f32; N], Malformed> {
        let mut out = [0.0; N];
        for value in &mut out {
            *value = self.f32()?;
        }
        Ok(out)
    }
    /// The next `8 * N` bytes; may hold NaN or infinity.
    pub fn f64s<const N: usize>(&mut self) -> Result<[f64; N], Malformed> {
        let mut out = [0.0; N];
        for value in &mut out {
            *value = self.f64()?;
        }
        Ok(out)
    }
    /// Skips `count` bytes, which must be zero.
    pub fn zeros(&mut self, count: usize) -> Result<(), Malformed> {
        ensure(is_zero(self.take(count)?), "reserved bytes are not zero")
    }
    /// Fails if unread bytes are left.
    pub fn finish(self) -> Result<(), Malformed> {
        ensure(self.rest.is_empty(), "unused bytes at the end")
    }
}

/// True if every byte is zero.
pub fn is_zero(bytes: &[u8]) -> bool {
    bytes.iter().fold(0, |all, &b| all | b) == 0
}

/// Appends little-endian values.
pub trait PutBytes {
    /// Appends `bytes` as they are.
    fn put_bytes(&mut self, bytes: &[u8]);
    /// Appends zeros until the length is `len`; does nothing if it is longer already.
    fn put_zeros_to(&mut self, len: usize);
    /// Appends one byte.
    fn put_u8(&mut self, v: u8) {
        self.put_bytes(&[v]);
    }
    /// Appends two bytes.
    fn put_u16(&mut self, v: u16) {
        self.put_bytes(&v.to_le_bytes());
    }
    /// Appends four bytes.
    fn put_u32(&mut self, v: u32) {
        self.put_bytes(&v.to_le_bytes());
    }
    /// Appends eight bytes.
    fn put_u64(&mut self, v: u64) {
        self.put_bytes(&v.to_le_bytes());
    }
    /// Appends four bytes.
    fn put_f32(&mut self, v: f32) {
        self.put_bytes(&v.to_le_bytes());
    }
    /// Appends eight bytes.
    fn put_f64(&mut self, v: f64) {
        self.put_bytes(&v.to_le_bytes());
    }
    /// Appends four bytes for each value.
    fn put_f32s(&mut self, values: &[f32]) {
        values.iter().for_each(|&v| self.put_f32(v));
    }
    /// Appends eight bytes for each value.
    fn put_f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|&v| self.put_f64(v));
    }
}

/// Appends `value` as a variable-length number: seven bits a byte, the lowest first; the top bit is set in all but
/// the last.
#[inline]
pub fn push_varint(out: &mut Vec<u8>, mut value: u32) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// Removes a number that [`push_varint`] appended from the front; `None` if the bytes end within it, or it has more
/// than 32 bits.
#[inline]
pub fn take_varint(bytes: &mut &[u8]) -> Option<u32> {
    let mut value = 0u32;
    for shift in [0, 7, 14, 21, 28] {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u32::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return (shift < 28 || byte < 16).then_some(value);
        }
    }
    None
}

impl PutBytes for Vec<u8> {
    fn put_bytes(&mut self, bytes: &[u8]) {
        self.extend_from_slice(bytes);
    }
    fn put_zeros_to(&mut self, len: usize) {
        if len > self.len() {
            self.resize(len, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_values_are_read_back_and_no_more() {
        let mut bytes = Vec::new();
        bytes.put_u8(1);
        bytes.put_u16(0x0203);
        bytes.put_u32(4);
        bytes.put_u64(5);
        bytes.put_f32s(&[1.5, -2.5]);
        bytes.put_f64s(&[1e300]);
        bytes.put_zeros_to(36);
        assert_eq!(&bytes[..3], &[1, 3, 2]);
        for len in 0..bytes.len() {
            assert!(read(&bytes[..len]).is_err(), "{len} of {} bytes", bytes.len());
        }
        assert_eq!(read(&bytes), Ok(([1.5, -2.5], [1e300])));
        bytes.push(0);
        assert_eq!(read(&bytes), Err(Malformed::new("unused bytes at the end")));
    }

    fn read(bytes: &[u8]) -> Result<([f32; 2], [f64; 1]), Malformed> {
        let mut r = ByteReader::new(bytes);
        assert!(r.clone().take(usize::MAX).is_err());
        let head = (r.u8()?, r.u16()?, r.u32()?, r.u64()?);
        assert_eq!(head, (1, 0x0203, 4, 5));
        let floats = (r.f32s()?, r.f64s()?);
        r.zeros(5)?;
        r.finish()?;
        Ok(floats)
    }

    #[test]
    fn reserved_bytes_must_be_zero() {
        assert!(ByteReader::new(&[0, 0, 1]).zeros(3).is_err());
        assert!(ByteReader::new(&[0, 0, 1]).zeros(2).is_ok());
    }
}
