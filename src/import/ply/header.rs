//! The header of a PLY file: its elements, their properties and the coding.

use super::table::Tables;
use crate::base::error::Result;
use crate::import::ignored::Ignored;
use crate::import::input::{Ends, Input, Parsed};
use crate::import::text;

/// Type of a number in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Type {
    fn of(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"char" | b"int8" => Type::I8,
            b"uchar" | b"uint8" => Type::U8,
            b"short" | b"int16" => Type::I16,
            b"ushort" | b"uint16" => Type::U16,
            b"int" | b"int32" => Type::I32,
            b"uint" | b"uint32" => Type::U32,
            b"long" | b"int64" => Type::I64,
            b"ulong" | b"uint64" => Type::U64,
            b"float" | b"float32" => Type::F32,
            b"double" | b"float64" => Type::F64,
            _ => return None,
        })
    }

    /// Size in bytes in a binary file.
    pub(crate) fn size(self) -> u64 {
        match self {
            Type::I8 | Type::U8 => 1,
            Type::I16 | Type::U16 => 2,
            Type::I32 | Type::U32 | Type::F32 => 4,
            Type::I64 | Type::U64 | Type::F64 => 8,
        }
    }

    pub(crate) fn is_float(self) -> bool {
        matches!(self, Type::F32 | Type::F64)
    }

    /// True if single precision represents every value.
    pub(crate) fn fits_single(self) -> bool {
        matches!(self, Type::I8 | Type::U8 | Type::I16 | Type::U16 | Type::F32)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Scalar(Type),
    List { count: Type, item: Type },
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Property {
    pub(crate) name: String,
    pub(crate) kind: Kind,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Element {
    pub(crate) name: String,
    /// Number of rows according to the header. It is not trusted: nothing is allocated by it.
    pub(crate) count: u64,
    pub(crate) properties: Vec<Property>,
}

impl Element {
    /// Returns index and type of the scalar property with one of these names.
    pub(crate) fn scalar(&self, names: &[&str]) -> Option<(usize, Type)> {
        self.properties.iter().enumerate().find_map(|(i, p)| match p.kind {
            Kind::Scalar(ty) if names.contains(&p.name.as_str()) => Some((i, ty)),
            _ => None,
        })
    }

    /// Returns the index of the list property with one of these names.
    pub(crate) fn list(&self, names: &[&str]) -> Option<usize> {
        let is_it = |p: &Property| matches!(p.kind, Kind::List { .. }) && names.contains(&p.name.as_str());
        self.properties.iter().position(is_it)
    }

    /// Returns the size of a row in a binary file, if all rows have the same size.
    pub(crate) fn row_bytes(&self) -> Option<u64> {
        self.properties.iter().try_fold(0, |sum, p| match p.kind {
            Kind::Scalar(ty) => Some(sum + ty.size()),
            Kind::List { .. } => None,
        })
    }

    /// Returns a lower bound of the bytes of a row: its binary size with empty lists, or a digit and a space per value
    /// in text.
    pub(crate) fn least_bytes(&self, coding: Coding) -> u64 {
        let least = |ty: Type| if coding == Coding::Ascii { 2 } else { ty.size() };
        let of = |p: &Property| match p.kind {
            Kind::Scalar(ty) => least(ty),
            Kind::List { count, .. } => least(count),
        };
        self.properties.iter().map(of).sum()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Coding {
    Ascii,
    Little,
    Big,
}

#[derive(Debug)]
pub(crate) struct Header {
    pub(crate) coding: Coding,
    pub(crate) elements: Vec<Element>,
    /// Tables in the comments that the generators of this crate write.
    pub(crate) tables: Tables,
    pub(crate) ignored: Ignored,
}

impl Header {
    pub(crate) fn element(&self, name: &str) -> Option<usize> {
        self.elements.iter().position(|e| e.name == name)
    }
}

/// Reads up to and including the line `end_header`.
pub(crate) fn read(input: &mut Input) -> Result<Header> {
    choose_line_ends(input)?;
    let first = input.next_line()?.map(<[u8]>::trim_ascii) == Some(b"ply");
    if !first {
        return Err(input.line_fault("does not begin with \"ply\""));
    }
    let mut coding = None;
    let mut header =
        Header { coding: Coding::Ascii, elements: Vec::new(), tables: Tables::default(), ignored: Ignored::default() };
    loop {
        let number = input.line() + 1;
        let Some(line) = input.next_line()? else {
            return Err(input.line_fault("the header has no end_header"));
        };
        match header_line(line, number, &mut header, &mut coding) {
            Ok(false) => {}
            Ok(true) => break,
            Err(why) => return Err(input.line_fault(why)),
        }
    }
    if coding == Some(Coding::Ascii) {
        input.set_ends(Ends::Any);
    }
    match coding {
        Some(coding) => Ok(Header { coding, ..header }),
        None => Err(input.line_fault("the header has no format line")),
    }
}

/// Sets the ending of the first line for all lines. In a binary file a lone `\r` may be followed by any byte, so a
/// later `\n` proves nothing.
fn choose_line_ends(input: &mut Input) -> Result<()> {
    let head = input.peek(256)?;
    let cr = head.iter().position(|&b| b == b'\r');
    let lf = head.iter().position(|&b| b == b'\n');
    let old_mac = match (cr, lf) {
        (Some(cr), Some(lf)) => lf > cr + 1,
        (Some(_), None) => true,
        _ => false,
    };
    input.set_ends(if old_mac { Ends::Cr } else { Ends::Lf });
    Ok(())
}

/// Parses one line. Returns `true` at the end of the header.
fn header_line(line: &[u8], number: u64, header: &mut Header, coding: &mut Option<Coding>) -> Parsed<bool, String> {
    let mut rest = line;
    match text::word(&mut rest) {
        None | Some(b"obj_info") => {}
        Some(word) if word.starts_with(b"#") => {}
        Some(b"comment") => header.tables.comment(rest),
        Some(b"end_header") => return Ok(true),
        Some(b"format") => {
            *coding = Some(match text::word(&mut rest) {
                Some(b"ascii") => Coding::Ascii,
                Some(b"binary_little_endian") => Coding::Little,
                Some(b"binary_big_endian") => Coding::Big,
                other => return Err(format!("unknown format {}", text::shown(other.unwrap_or(b"")))),
            });
        }
        Some(b"element") => {
            let (name, count) = (text::word(&mut rest), text::word(&mut rest).and_then(text::integer));
            let (Some(name), Some(count)) = (name, count.and_then(|n| u64::try_from(n).ok())) else {
                return Err("an element needs a name and a count".into());
            };
            header.elements.push(Element { name: text::name(name), count, properties: Vec::new() });
        }
        Some(b"property") => {
            let property = property(rest)?;
            let Some(element) = header.elements.last_mut() else {
                return Err("a property before any element".into());
            };
            element.properties.push(property);
        }
        Some(other) if declares(other, rest) => {
            return Err(format!("unknown header keyword {}", text::shown(other)));
        }
        // Text that some programs write without "comment" before it.
        Some(other) => header.ignored.add(&format!("header lines with {}", text::shown(other)), number),
    }
    Ok(false)
}

/// True if an unknown line may declare data, as a misspelt `property` or `element` does. Rows would be read wrongly
/// without it.
fn declares(keyword: &[u8], mut rest: &[u8]) -> bool {
    let words: Vec<&[u8]> = std::iter::from_fn(|| text::word(&mut rest)).collect();
    match words[..] {
        [ty, ..] if ty == b"list" || Type::of(ty).is_some() => true,
        [_, count] => keyword.to_ascii_lowercase().starts_with(b"e") && text::integer(count).is_some(),
        _ => false,
    }
}

fn property(mut rest: &[u8]) -> Parsed<Property, String> {
    let ty = |rest: &mut &[u8]| {
        let word = text::word(rest).unwrap_or(b"");
        Type::of(word).ok_or_else(|| format!("unknown type {}", text::shown(word)))
    };
    let mut look = rest;
    let kind = if text::word(&mut look) == Some(b"list") {
        rest = look;
        let (count, item) = (ty(&mut rest)?, ty(&mut rest)?);
        if count.is_float() {
            return Err("the length of a list must have an integer type".into());
        }
        Kind::List { count, item }
    } else {
        Kind::Scalar(ty(&mut rest)?)
    };
    match text::word(&mut rest) {
        Some(name) => Ok(Property { name: text::name(name), kind }),
        None => Err("a property needs a name".into()),
    }
}
