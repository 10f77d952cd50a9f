//! Optional values at the corners of triangles: colours and normals.

use super::normals::MADE;
use crate::base::error::Result;
use crate::base::memory;

/// Values of one triangle.
#[derive(Debug, Clone, Copy, Default)]
pub struct Value {
    /// sRGB colours of the corners.
    pub colours: Option<[[u8; 4]; 3]>,
    /// Normals of the corners, see [`super::normals`].
    pub normals: Option<[u32; 3]>,
}

/// The values that any triangle of a mesh has.
#[derive(Debug, Clone, Copy, Default)]
pub struct Has {
    pub colours: bool,
    pub normals: bool,
}

/// Values of some triangles. Each list is empty if no triangle has the value, and otherwise has an entry for each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Values {
    /// sRGB colours of the corners. Alpha 0: the colour of the part's material.
    pub colours: Vec<[[u8; 4]; 3]>,
    /// Normals of the corners, see [`super::normals`].
    pub normals: Vec<[u32; 3]>,
}

/// Colours of a triangle without colours.
pub const NO_COLOURS: [[u8; 4]; 3] = [[0; 4]; 3];
/// Normals of a triangle without normals.
pub const NO_NORMALS: [u32; 3] = [MADE; 3];

impl Values {
    /// Makes room for so many more triangles behind the first `before`; the last of them have values like `next`.
    /// Fails with `NoMemory`.
    pub fn make_room(&mut self, before: usize, triangles: usize, next: &Value) -> Result<()> {
        fn of<T>(all: &mut Vec<T>, len: usize, has_value: bool) -> Result<()> {
            let more = if has_value || !all.is_empty() { len - all.len() } else { 0 };
            memory::make_room(all, more, "the triangles of the input")
        }
        of(&mut self.colours, before + triangles, next.colours.is_some())?;
        of(&mut self.normals, before + triangles, next.normals.is_some())
    }

    /// Adds the values of the triangle behind the first `before`.
    pub fn push(&mut self, before: usize, value: Value) {
        fn of<T: Copy>(all: &mut Vec<T>, before: usize, value: Option<T>, none: T) {
            if value.is_some() || !all.is_empty() {
                all.resize(before, none);
                all.push(value.unwrap_or(none));
            }
        }
        of(&mut self.colours, before, value.colours, NO_COLOURS);
        of(&mut self.normals, before, value.normals, NO_NORMALS);
    }

    /// Adds the values of `count` triangles behind the first `before`.
    pub fn append(&mut self, before: usize, from: &Self, count: usize) {
        fn of<T: Copy>(to: &mut Vec<T>, from: &[T], [before, end]: [usize; 2], none: T) {
            if !to.is_empty() || !from.is_empty() {
                to.resize(before, none);
                to.extend(from);
                to.resize(end, none);
            }
        }
        let ends = [before, before + count];
        of(&mut self.colours, &from.colours, ends, NO_COLOURS);
        of(&mut self.normals, &from.normals, ends, NO_NORMALS);
    }

    /// The values of triangle `i`.
    pub fn get(&self, i: usize) -> Value {
        Value {
            colours: self.colours.get(i).copied().filter(|c| *c != NO_COLOURS),
            normals: self.normals.get(i).copied().filter(|n| *n != NO_NORMALS),
        }
    }

    /// Number of bytes of memory.
    pub fn bytes(&self) -> usize {
        12 * (self.colours.capacity() + self.normals.capacity())
    }
}
