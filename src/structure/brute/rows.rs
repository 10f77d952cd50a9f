//! Index blocks and lists in rows of eight. Most blocks have more rows or triangles than a place may have in this form:
//! the children of such a place are groups of them. A group is a place of the block. Its item is [`GROUP`], the number
//! of its first row or triangle, and how many it has.

use super::layout::{Block, LIST, Row, triangle};
use super::trace::TreeView;
use crate::base::ids::BlockId;
use crate::math::Bounds;
use crate::structure::hit::TriHit;
use crate::structure::place::Place;
use crate::structure::rows::{COLUMNS, PartsBelow, Rows, VERTICES};
use std::ops::Range;

/// Marks the item of a group. Its number of rows or triangles is above bit 8, its first below.
const GROUP: u32 = 1 << 16;
/// Triangles of a leaf: each has vertices of its own.
const TRIANGLES: usize = VERTICES / 3;

fn group(first: usize, count: usize) -> u32 {
    GROUP | (count as u32) << 8 | first as u32
}

/// The rows or triangles of a place in a block with `count`.
fn range(item: u32, count: usize) -> Range<usize> {
    match item & GROUP {
        0 => 0..count,
        _ => {
            let first = (item & 0xff) as usize;
            first..first + (item >> 8 & 0xff) as usize
        }
    }
}

impl TreeView<'_> {
    /// See [`crate::structure::Tree::rows`].
    pub fn rows(&self, place: Place, rows: &mut Rows) -> Result<(), BlockId> {
        (rows.mask, rows.is_leaf, rows.leaves) = (0, false, 0);
        rows.below = [PartsBelow::UNKNOWN; COLUMNS];
        match Block::new(self.visited(place.block).ok_or(BlockId(place.block))?) {
            Block::Index(all) => {
                let range = range(place.item, all.len());
                let bounds = |some: Range<usize>| all[some].iter().map(|row| Row(row).bounds());
                if range.len() > COLUMNS {
                    groups(place, range, COLUMNS, rows, bounds);
                    return Ok(());
                }
                for (row, b) in all[range.clone()].iter().map(Row).zip(bounds(range)) {
                    // A list is a place over groups.
                    let (block, item) = row.below();
                    push(rows, Place { block, item }, &b, false);
                }
            }
            Block::List(all) => {
                let range = range(place.item, all.len());
                if place.item == LIST || range.len() > TRIANGLES {
                    let bounds = |some: Range<usize>| all[some].iter().map(|t| Bounds::of(&triangle(t).vertices));
                    groups(place, range, TRIANGLES, rows, bounds);
                    return Ok(());
                }
                (rows.mask, rows.is_leaf) = ((1 << range.len()) - 1, true);
                rows.first = TriHit { block: place.block, tri: range.start as u32, ..TriHit::none(0.0) };
                for (i, t) in all[range].iter().map(triangle).enumerate() {
                    rows.parts[i] = t.part;
                    for (corner, v) in t.vertices.iter().enumerate() {
                        rows.corners[corner][i] = (3 * i + corner) as u8;
                        (0..3).for_each(|axis| rows.vertices[axis][3 * i + corner] = v[axis]);
                    }
                }
            }
        }
        Ok(())
    }
}

/// Divides rows or triangles into groups of at least `least`, if there are as many. `bounds` returns their boxes.
fn groups<I: Iterator<Item = Bounds>>(
    place: Place,
    range: Range<usize>,
    least: usize,
    rows: &mut Rows,
    bounds: impl Fn(Range<usize>) -> I,
) {
    let each = range.len().div_ceil(COLUMNS).max(least);
    for first in range.clone().step_by(each) {
        let some = first..range.end.min(first + each);
        let item = group(first, some.len());
        let is_leaf = least == TRIANGLES && some.len() <= TRIANGLES;
        let around = bounds(some).fold(Bounds::EMPTY, |all, b| all.union(b));
        push(rows, Place { item, ..place }, &around, is_leaf);
    }
}

/// Adds a child.
fn push(rows: &mut Rows, place: Place, b: &Bounds, is_leaf: bool) {
    let at = rows.mask.trailing_ones() as usize;
    rows.places[at] = place;
    rows.leaves |= u32::from(is_leaf) << at;
    let ends = [b.min, b.max];
    (0..6).for_each(|row| rows.bounds[row][at] = ends[row / 3][row % 3]);
    rows.mask |= 1 << at;
}
