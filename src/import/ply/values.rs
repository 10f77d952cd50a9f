//! Values of PLY elements in sequence, from text or from bytes in either order.

use super::header::Type;
use crate::base::error::{Error, Place, Result};
use crate::import::ignored::Ignored;
use crate::import::input::Input;
use crate::import::text;

/// Reads the values of rows in file order.
pub(crate) trait Values {
    /// Reads the next value as a floating-point number: `f32` values exactly, integers rounded.
    fn float(&mut self, ty: Type) -> Result<f64>;
    /// Reads the next value, of an integer type. A text file may write `3.0`.
    fn int(&mut self, ty: Type) -> Result<i64>;
    /// Skips `n` values.
    fn skip(&mut self, ty: Type, n: u64) -> Result<()>;
    /// Ends a row.
    fn end_row(&mut self) -> Result<()>;
    /// Creates an error at the current position.
    fn fault(&self, why: String) -> Error;
    /// Returns the underlying input.
    fn input(&mut self) -> &mut Input;
    /// Returns data that was skipped.
    fn ignored(&self) -> Option<&Ignored> {
        None
    }
}

/// Binary values; `BIG` selects big-endian byte order.
pub(crate) struct Binary<'a, const BIG: bool> {
    input: &'a mut Input,
}

impl<'a, const BIG: bool> Binary<'a, BIG> {
    pub(crate) fn new(input: &'a mut Input) -> Self {
        Self { input }
    }

    #[inline]
    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        match self.input.take::<N>()? {
            Some(mut bytes) => {
                if BIG {
                    bytes.reverse();
                }
                Ok(bytes)
            }
            None => Err(truncated(self.input)),
        }
    }
}

/// The error of a file that is shorter than its header announces.
pub(crate) fn truncated(input: &Input) -> Error {
    Error::parse(input.path(), Place::Byte(input.total()), "the file ends before the data that its header announces")
}

impl<const BIG: bool> Values for Binary<'_, BIG> {
    #[inline]
    fn float(&mut self, ty: Type) -> Result<f64> {
        Ok(match ty {
            Type::F32 => f64::from(f32::from_le_bytes(self.take()?)),
            Type::F64 => f64::from_le_bytes(self.take()?),
            Type::U64 => u64::from_le_bytes(self.take()?) as f64,
            other => self.int(other)? as f64,
        })
    }

    #[inline]
    fn int(&mut self, ty: Type) -> Result<i64> {
        Ok(match ty {
            Type::I8 => i64::from(i8::from_le_bytes(self.take()?)),
            Type::U8 => i64::from(u8::from_le_bytes(self.take()?)),
            Type::I16 => i64::from(i16::from_le_bytes(self.take()?)),
            Type::U16 => i64::from(u16::from_le_bytes(self.take()?)),
            Type::I32 => i64::from(i32::from_le_bytes(self.take()?)),
            Type::U32 => i64::from(u32::from_le_bytes(self.take()?)),
            Type::I64 => i64::from_le_bytes(self.take()?),
            // No count or index is valid in the upper half of the range.
            Type::U64 => u64::from_le_bytes(self.take()?).try_into().unwrap_or(i64::MAX),
            Type::F32 | Type::F64 => return Err(self.fault("an index has a floating-point type".into())),
        })
    }

    #[inline]
    fn skip(&mut self, ty: Type, n: u64) -> Result<()> {
        let there = match n.checked_mul(ty.size()) {
            Some(bytes) => self.input.skip(bytes)?,
            None => false,
        };
        if there { Ok(()) } else { Err(truncated(self.input)) }
    }

    fn end_row(&mut self) -> Result<()> {
        Ok(())
    }

    fn fault(&self, why: String) -> Error {
        self.input.fault(why)
    }

    fn input(&mut self) -> &mut Input {
        self.input
    }
}

/// Values as text. A row begins on a new line and may span several lines.
pub(crate) struct Ascii<'a> {
    input: &'a mut Input,
    /// The current line and the number of its bytes that were consumed.
    line: Vec<u8>,
    used: usize,
    /// Number of lines with values of the present row.
    lines: u32,
    ignored: Ignored,
    /// The last line of a row that was too long: a second reading of the rows counts them once.
    too_long: u64,
}

impl<'a> Ascii<'a> {
    pub(crate) fn new(input: &'a mut Input) -> Self {
        Self { input, line: Vec::new(), used: 0, lines: 0, ignored: Ignored::default(), too_long: 0 }
    }

    #[inline]
    fn parse<T>(&mut self, parse: impl Fn(&[u8]) -> Option<T>, why: impl Fn(&[u8]) -> String) -> Result<T> {
        loop {
            let mut rest = &self.line[self.used..];
            if let Some(word) = text::word(&mut rest) {
                self.used = self.line.len() - rest.len();
                return match parse(word) {
                    Some(value) => Ok(value),
                    None => Err(self.input.line_fault(why(word))),
                };
            }
            self.next_line()?;
        }
    }

    fn next_line(&mut self) -> Result<()> {
        self.line.clear();
        self.used = 0;
        match self.input.next_line()? {
            // A comment between the rows, or between the lines of one.
            Some(line) if line.trim_ascii_start().starts_with(b"#") => {}
            Some(line) => {
                self.lines += u32::from(!line.trim_ascii().is_empty());
                self.line.extend_from_slice(line);
            }
            None => return Err(self.input.line_fault("the file ends before the data that its header announces")),
        }
        Ok(())
    }
}

/// Parses an integer, also in the form `3.0`.
fn whole(word: &[u8]) -> Option<i64> {
    text::integer(word).or_else(|| {
        let x = text::double(word)?;
        (x.fract() == 0.0 && x.abs() < 9e15).then_some(x as i64)
    })
}

impl Values for Ascii<'_> {
    #[inline]
    fn float(&mut self, ty: Type) -> Result<f64> {
        match ty {
            Type::F32 => self.parse(text::single, text::not_a_number).map(f64::from),
            _ => self.parse(text::double, text::not_a_number),
        }
    }

    #[inline]
    fn int(&mut self, _ty: Type) -> Result<i64> {
        self.parse(whole, |word| format!("{} is not a whole number", text::shown(word)))
    }

    fn skip(&mut self, _ty: Type, n: u64) -> Result<()> {
        for _ in 0..n {
            self.parse(|word| word.first().copied(), text::not_a_number)?;
        }
        Ok(())
    }

    /// Ends a row at the end of its line. Some programs write more columns than they declare. In a row of several lines
    /// such a column may be the next row's, so it is refused.
    fn end_row(&mut self) -> Result<()> {
        let mut rest = &self.line[self.used..];
        let lines = std::mem::take(&mut self.lines);
        if let Some(word) = text::word(&mut rest).filter(|word| !word.starts_with(b"#")) {
            if lines > 1 {
                let why = format!("{} follows the last property of a row of several lines", text::shown(word));
                return Err(self.input.line_fault(why));
            }
            let line = self.input.line();
            if line > self.too_long {
                self.ignored.add("values behind the last property of a row", line);
                self.too_long = line;
            }
        }
        self.used = self.line.len();
        Ok(())
    }

    fn ignored(&self) -> Option<&Ignored> {
        Some(&self.ignored)
    }

    fn fault(&self, why: String) -> Error {
        self.input.line_fault(why)
    }

    fn input(&mut self) -> &mut Input {
        self.input
    }
}
