//! Reads and writes the small numbers of a block's file form.

use crate::base::bytes::take_varint;

/// Reader of a payload. Each call fails if the payload has too few bytes left.
pub struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// Starts at the first byte of `payload`.
    pub fn new(payload: &'a [u8]) -> Self {
        Self { rest: payload }
    }

    /// Number of bytes not yet read.
    pub fn left(&self) -> usize {
        self.rest.len()
    }

    /// Reads the next `n` bytes.
    pub fn take(&mut self, n: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self.rest.split_at_checked(n).ok_or("unexpected end of data")?;
        self.rest = rest;
        Ok(taken)
    }

    /// Returns the next `n` bytes without advancing.
    pub fn ahead(&self, n: usize) -> Result<&'a [u8], String> {
        Ok(self.rest.get(..n).ok_or("unexpected end of data")?)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (taken, rest) = self.rest.split_first_chunk::<N>().ok_or("unexpected end of data")?;
        self.rest = rest;
        Ok(*taken)
    }

    /// Reads the next byte.
    pub fn u8(&mut self) -> Result<u8, String> {
        self.array::<1>().map(|b| b[0])
    }

    /// Reads the next two bytes.
    pub fn u16(&mut self) -> Result<u16, String> {
        self.array().map(u16::from_le_bytes)
    }

    /// Reads the next four bytes.
    pub fn u32(&mut self) -> Result<u32, String> {
        self.array().map(u32::from_le_bytes)
    }

    /// Reads a variable-length number, see [`take_varint`].
    #[inline]
    pub fn varint(&mut self) -> Result<u32, String> {
        Ok(take_varint(&mut self.rest).ok_or("a variable-length integer has no end or too many bits")?)
    }

    /// Reads `count` words that [`push_planes`] wrote, and appends `zeros` zeros.
    #[inline(always)]
    pub fn words(&mut self, count: usize, zeros: usize) -> Result<Vec<u32>, String> {
        let (a, b) = (self.take(count)?, self.take(count)?);
        let (c, d) = (self.take(count)?, self.take(count)?);
        let mut words = vec![0; count + zeros];
        // A plain loop instead of `collect`: code in closures is not compiled for the caller's instruction set. All
        // slices are `count` long, so the loop is vectorised.
        let to = &mut words[..count];
        for i in 0..count {
            to[i] = u32::from_le_bytes([a[i], b[i], c[i], d[i]]);
        }
        Ok(words)
    }

    /// Fails unless all bytes were read.
    pub fn end(&self) -> Result<(), String> {
        if self.rest.is_empty() { Ok(()) } else { Err("unused bytes at the end".into()) }
    }
}

/// Appends words as four byte planes: the lowest bytes of all words, then the next bytes of all words, and so on.
pub fn push_planes(out: &mut Vec<u8>, words: impl Iterator<Item = u32> + Clone) {
    (0..4).for_each(|byte| out.extend(words.clone().map(|w| (w >> (8 * byte)) as u8)));
}

/// Collects the items and appends `zeros` zeros.
#[inline(always)]
pub fn padded<T: Copy + Default>(items: impl ExactSizeIterator<Item = T>, zeros: usize) -> Vec<T> {
    let mut out = Vec::with_capacity(items.len() + zeros);
    out.extend(items);
    out.resize(out.len() + zeros, T::default());
    out
}

/// Returns the `N` items from `at` on.
#[inline(always)]
pub fn piece<T, const N: usize>(from: &[T], at: usize) -> &[T; N] {
    match from[at..at + N].first_chunk() {
        Some(piece) => piece,
        None => unreachable!(),
    }
}

/// Maps numbers of small magnitude to small numbers: 0, -1, 1, -2, ... to 0, 1, 2, 3, ...
#[inline]
pub fn zigzag(value: i32) -> u32 {
    (value << 1 ^ value >> 31) as u32
}

/// Inverse of [`zigzag`].
#[inline(always)]
pub fn unzigzag(value: u32) -> i32 {
    (value >> 1) as i32 ^ -((value & 1) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::bytes::push_varint;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_round_trip(values in prop::collection::vec(any::<i32>(), 0..50)) {
            let mut bytes = Vec::new();
            values.iter().for_each(|v| push_varint(&mut bytes, zigzag(*v)));
            let mut reader = Reader::new(&bytes);
            for v in &values {
                prop_assert_eq!(reader.varint().map(unzigzag), Ok(*v));
            }
            prop_assert_eq!(reader.end(), Ok(()));
            prop_assert!(reader.u8().is_err());
        }
    }
}
