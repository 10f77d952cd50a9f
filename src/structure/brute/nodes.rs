//! Nodes by their places: see [`crate::structure::nodes`]. An index block has more rows than a node may have children.
//! If it does, its node has groups of rows as children. The item of a place is [`INDEX`] or [`LIST`] for a whole block,
//! and [`GROUPS`] plus the number of a group.

use super::layout::{Block, INDEX, LIST, ROWS, Row, triangle};
use crate::lod::Coded;
use crate::structure::hit::Triangle;
use crate::structure::nodes::{CHILDREN, EMPTY_BOX, NO_PART, Node, outward};
use crate::structure::place::Place;

/// Item of the first group of rows.
const GROUPS: u32 = 8;
const _: () = assert!(ROWS <= CHILDREN * CHILDREN && INDEX < GROUPS && LIST < GROUPS);

/// See [`crate::structure::open::Nodes::node`].
pub fn node(words: &[u32], place: Place, origin: &[f64; 3], out: &mut Node) -> bool {
    match Block::new(words) {
        Block::Index(rows) => {
            let some = match place.item.checked_sub(GROUPS) {
                None if place.item == INDEX => rows,
                Some(group) if rows.len() > CHILDREN => match rows.chunks(CHILDREN).nth(group as usize) {
                    Some(some) => some,
                    None => return false,
                },
                _ => return false,
            };
            out.begin(0);
            if some.len() <= CHILDREN {
                for row in some.iter().map(Row) {
                    let ((block, item), bounds) = (row.below(), row.bounds());
                    out.push(Place { block, item }, item == LIST, &outward(origin, bounds.min, bounds.max));
                }
            } else {
                for (group, item) in some.chunks(CHILDREN).zip(GROUPS..) {
                    let boxes = group.iter().map(|row| outward(origin, Row(row).bounds().min, Row(row).bounds().max));
                    let all = boxes.fold(EMPTY_BOX, |all, one| {
                        std::array::from_fn(|i| if i < 3 { all[i].min(one[i]) } else { all[i].max(one[i]) })
                    });
                    out.push(Place { block: place.block, item }, false, &all);
                }
            }
            let mut parts = some.iter().map(|row| Coded::part(Row(row).voxel()[2]));
            out.part = match parts.next() {
                Some((part, false)) if parts.all(|other| other == (part, false)) => part,
                _ => NO_PART,
            };
            out.end();
            true
        }
        Block::List(list) => {
            out.of_triangles(list.iter().map(triangle), origin);
            place.item == LIST
        }
    }
}

/// See [`crate::structure::open::Nodes::triangles`].
pub fn triangles(words: &[u32], place: Place, mut visit: impl FnMut(u32, Triangle)) -> bool {
    match Block::new(words) {
        Block::List(list) if place.item == LIST => {
            list.iter().zip(0..).for_each(|(words, number)| visit(number, triangle(words)));
            true
        }
        _ => false,
    }
}

/// The items of a block.
pub fn items(words: &[u32]) -> Vec<u32> {
    match Block::new(words) {
        Block::Index(rows) if rows.len() > CHILDREN => {
            let groups = rows.len().div_ceil(CHILDREN) as u32;
            std::iter::once(INDEX).chain(GROUPS..GROUPS + groups).collect()
        }
        Block::Index(_) => vec![INDEX],
        Block::List(_) => vec![LIST],
    }
}
