//! Reading and writing the small numbers of a block's file form.

/// A payload being read; every call fails where bytes run out.
pub struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// From the first byte of `payload`.
    pub fn new(payload: &'a [u8]) -> Self {
        Self { rest: payload }
    }

    /// Bytes not yet read.
    pub fn left(&self) -> usize {
        self.rest.len()
    }

    /// The next `n` bytes.
    pub fn take(&mut self, n: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self.rest.split_at_checked(n).ok_or("it ends too early")?;
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (taken, rest) = self.rest.split_first_chunk::<N>().ok_or("it ends too early")?;
        self.rest = rest;
        Ok(*taken)
    }

    /// The next byte.
    pub fn u8(&mut self) -> Result<u8, String> {
        self.array::<1>().map(|b| b[0])
    }

    /// The next two bytes.
    pub fn u16(&mut self) -> Result<u16, String> {
        self.array().map(u16::from_le_bytes)
    }

    /// The next four bytes.
    pub fn u32(&mut self) -> Result<u32, String> {
        self.array().map(u32::from_le_bytes)
    }

    /// The next variable-length number: 7 bits a byte, lowest first, top bit set on all but the last.
    #[inline]
    pub fn varint(&mut self) -> Result<u32, String> {
        let mut value = 0u32;
        for shift in [0, 7, 14, 21, 28] {
            let byte = self.u8()?;
            value |= u32::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                let fits = shift < 28 || byte < 16;
                return if fits { Ok(value) } else { Err("a number in it is too long".into()) };
            }
        }
        Err("a number in it is too long".into())
    }

    /// The next `count` variable-length numbers, in turn.
    #[inline]
    pub fn varints(&mut self, count: usize, mut each: impl FnMut(u32)) -> Result<(), String> {
        for _ in 0..count {
            match *self.rest {
                // Mostly they take one byte or two, which cannot be foreseen: without a branch.
                [a, b, ..] if a & b < 0x80 => {
                    let is_long = a >> 7;
                    each(u32::from(a & 0x7f) | u32::from(b & (0x7f * is_long)) << 7);
                    self.rest = &self.rest[1 + usize::from(is_long)..];
                }
                _ => each(self.varint()?),
            }
        }
        Ok(())
    }

    /// Fails unless all bytes were read.
    pub fn end(&self) -> Result<(), String> {
        if self.rest.is_empty() { Ok(()) } else { Err("it has bytes that nothing uses".into()) }
    }
}

/// Appends `value` as a variable-length number.
#[inline]
pub fn push_varint(out: &mut Vec<u8>, mut value: u32) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// Small magnitudes to small numbers: 0, -1, 1, -2, ... to 0, 1, 2, 3, ...
#[inline]
pub fn zigzag(value: i32) -> u32 {
    (value << 1 ^ value >> 31) as u32
}

/// Undoes [`zigzag`].
#[inline]
pub fn unzigzag(value: u32) -> i32 {
    (value >> 1) as i32 ^ -((value & 1) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
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
            let (mut together, mut all) = (Reader::new(&bytes), Vec::new());
            prop_assert_eq!(together.varints(values.len(), |v| all.push(unzigzag(v))), Ok(()));
            prop_assert_eq!((all, together.left()), (values, 0));
            prop_assert_eq!(reader.end(), Ok(()));
            prop_assert!(reader.u8().is_err());
        }

        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..8)) {
            let mut alone = Reader::new(&bytes);
            let one_by_one: Result<Vec<u32>, String> = (0..4).map(|_| alone.varint()).collect();
            let mut all = Vec::new();
            let together = Reader::new(&bytes).varints(4, |v| all.push(v));
            prop_assert_eq!(one_by_one, together.map(|()| all));
        }
    }
}
