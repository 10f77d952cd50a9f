//! Lines of OBJ and MTL files, joined where a backslash continues them.

use crate::base::error::Result;
use crate::import::input::Input;

/// Hands out logical lines without leading white space.
#[derive(Default)]
pub(crate) struct Lines {
    joined: Vec<u8>,
}

impl Lines {
    /// The next logical line, or `None` at the end of the file. Comments are not continued.
    #[inline]
    pub(crate) fn next<'a>(&'a mut self, input: &'a mut Input) -> Result<Option<&'a [u8]>> {
        // Looked at twice because the borrow of the first look would last as long as the line.
        match input.next_line()? {
            None => return Ok(None),
            Some(line) if !continues(line) => {}
            Some(line) => {
                self.joined.clear();
                self.joined.extend_from_slice(head(line));
                return self.join(input).map(Some);
            }
        }
        Ok(Some(input.last_line().trim_ascii_start()))
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
                return Err(input.line_fault("a line continued without end"));
            }
        }
        Ok(self.joined.trim_ascii_start())
    }
}

#[inline]
fn continues(line: &[u8]) -> bool {
    line.trim_ascii_end().last() == Some(&b'\\') && line.trim_ascii_start().first() != Some(&b'#')
}

/// Without the backslash.
fn head(line: &[u8]) -> &[u8] {
    let line = line.trim_ascii_end();
    line.strip_suffix(b"\\").unwrap_or(line)
}
