//! Logical lines of OBJ and MTL files: a backslash at the end joins a line with the next. In lines of names it does so
//! only behind white space: `g C:\parts\` is a name. (Blender and assimp join all lines, tinyobjloader joins none.)

use crate::base::error::Result;
use crate::import::input::{Input, MARK};
use crate::import::text;

/// Reader of logical lines, without leading white space, and without the byte order marks that lines begin with where
/// files were put one behind the other.
#[derive(Default)]
pub(crate) struct Lines {
    joined: Vec<u8>,
}

impl Lines {
    /// Returns the next logical line, or `None` at the end of the file. Comments are not continued.
    #[inline]
    pub(crate) fn next<'a>(&'a mut self, input: &'a mut Input) -> Result<Option<&'a [u8]>> {
        // The line is fetched again below, because the borrow of this match would last as long as the returned line.
        match input.next_line()? {
            None => return Ok(None),
            Some(line) if !continues(line) => {}
            Some(line) => {
                self.joined.clear();
                self.joined.extend_from_slice(head(line));
                return self.join(input).map(Some);
            }
        }
        Ok(Some(start(input.last_line())))
    }

    #[cold]
    fn join(&mut self, input: &mut Input) -> Result<&[u8]> {
        while let Some(line) = input.next_line()? {
            self.joined.push(b' ');
            self.joined.extend_from_slice(head(line));
            if !continues(line) {
                break;
            }
            if self.joined.len() > crate::import::input::MAX_LINE {
                return Err(input.line_fault("a continued line is too long"));
            }
        }
        Ok(start(&self.joined))
    }
}

/// Returns the line from its first word on.
#[inline]
fn start(line: &[u8]) -> &[u8] {
    let mut line = line.trim_ascii_start();
    while let Some(rest) = line.strip_prefix(MARK) {
        line = rest.trim_ascii_start();
    }
    line
}

#[inline]
fn continues(line: &[u8]) -> bool {
    line.trim_ascii_end().strip_suffix(b"\\").is_some_and(is_joined)
}

/// Keywords that names follow, besides those of textures.
const NAMED: [&[u8]; 6] = [b"g", b"o", b"usemtl", b"mtllib", b"newmtl", b"usemap"];

/// True if the backslash behind `head` continues the line. A backslash that ends a comment does not, nor does one that
/// ends a name, or that is the second byte of a letter, as in names in Shift-JIS and GBK.
#[cold]
fn is_joined(head: &[u8]) -> bool {
    let letter = head.last().is_some_and(|b| !b.is_ascii()) && str::from_utf8(head).is_err();
    let ends_name = head.last().is_some_and(|b| !b.is_ascii_whitespace()) && has_names(head);
    !letter && !ends_name && text::name_before_comment(head).is_none()
}

/// True if names follow the line's keyword.
fn has_names(line: &[u8]) -> bool {
    let mut rest = start(line);
    text::word(&mut rest).is_some_and(|word| NAMED.contains(&word) || word.starts_with(b"map_"))
}

/// Returns the line without the backslash at its end.
fn head(line: &[u8]) -> &[u8] {
    let line = line.trim_ascii_end();
    line.strip_suffix(b"\\").unwrap_or(line)
}
