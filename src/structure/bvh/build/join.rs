//! Joins the trees of chunks into one: wide nodes over the children of the chunks' roots.
//!
//! The roots themselves are not created. The children of the roots are the items, so the division into chunks, which
//! depends on memory, has little influence on the top of the tree. Planes between items are swept exactly, on all axes.
//! The weight of an item is the estimated number of references below it.

use super::Top;
use super::cluster::{Home, UnitId};
use super::tree::{InnerNode, Piece, Place, Sub};
use crate::base::error::{Error, Result};
use crate::math::Bounds;
use crate::structure::bake::Counts;
use crate::structure::bvh::layout::WIDTH;

/// Result of [`join`].
pub struct Joined {
    pub root: Box<InnerNode>,
    /// Units of all chunks.
    pub units: Vec<Home>,
    pub counts: Counts,
}

/// A subtree to be put below the top.
struct Item {
    piece: Piece,
    depth: u32,
    weight: f32,
}

/// Joins the trees of chunks. Their units and fine blocks are numbered one after the other in this order.
pub fn join(tops: Vec<Top>) -> Result<Joined> {
    let (mut units, mut items, mut counts, mut blocks) = (Vec::new(), Vec::new(), Counts::default(), 0);
    for Top { pieces, units: homes, fine_blocks, counts: Counts { depth, nodes, leaves, references } } in tops {
        let words: u32 = pieces.iter().map(|p| p.sub.words()).sum();
        for mut piece in pieces {
            renumber(&mut piece.sub, units.len() as u32);
            let weight = references as f32 * piece.sub.words() as f32 / words.max(1) as f32;
            items.push(Item { piece, depth, weight });
        }
        units.extend(homes.into_iter().map(|h| Home { block: blocks + h.block, ..h }));
        blocks += fine_blocks;
        counts.nodes += nodes;
        counts.leaves += leaves;
        counts.references += references;
    }
    let (piece, depth, nodes) = match items.pop() {
        Some(Item { piece, depth, .. }) if items.is_empty() && matches!(piece.sub, Sub::InnerNode(_)) => {
            (piece, depth, 0)
        }
        last => {
            items.extend(last);
            over(items)
        }
    };
    let Sub::InnerNode(root) = piece.sub else { return Err(Error::Internal("a tree has no root".into())) };
    Ok(Joined { root, units, counts: Counts { depth, nodes: counts.nodes + nodes, ..counts } })
}

fn renumber(sub: &mut Sub, by: u32) {
    match sub {
        Sub::InnerNode(inner) => inner.children.iter_mut().for_each(|(_, child)| renumber(child, by)),
        Sub::Placed(UnitId(id)) => *id += by,
        Sub::Leaf { .. } => {}
    }
}

/// Creates a node over all items. Returns it with its depth and the number of nodes that were created.
fn over(items: Vec<Item>) -> (Piece, u32, u64) {
    let (mut pieces, mut depth, mut nodes) = (Vec::with_capacity(WIDTH), 0, 1);
    for mut group in groups(items) {
        let (piece, its_depth, its_nodes) = match group.pop() {
            Some(item) if group.is_empty() => (item.piece, item.depth, 0),
            last => {
                group.extend(last);
                over(group)
            }
        };
        pieces.push(piece);
        depth = depth.max(its_depth);
        nodes += its_nodes;
    }
    (InnerNode::over(pieces, Place::Above), depth + 1, nodes)
}

/// Splits items into up to eight groups, the group with the largest box first.
fn groups(items: Vec<Item>) -> Vec<Vec<Item>> {
    if items.len() <= WIDTH {
        return items.into_iter().map(|i| vec![i]).collect();
    }
    let bounds = |g: &Vec<Item>| g.iter().fold(Bounds::EMPTY, |all, i| all.union(i.piece.cell));
    let mut groups = vec![items];
    while groups.len() < WIDTH {
        let area = |i: usize| bounds(&groups[i]).half_area();
        let open = (0..groups.len()).filter(|&i| groups[i].len() > 1);
        let Some(at) = open.reduce(|a, b| if area(b) > area(a) { b } else { a }) else { break };
        let (left, right) = halve(std::mem::take(&mut groups[at]));
        groups[at] = left;
        groups.insert(at + 1, right);
    }
    groups
}

/// Splits two or more items where the surface area heuristic is least.
fn halve(mut items: Vec<Item>) -> (Vec<Item>, Vec<Item>) {
    let mut best = (f32::INFINITY, 0, items.len() / 2);
    for axis in 0..3 {
        sort(&mut items, axis);
        let mut right = vec![0.0; items.len()];
        let (mut all, mut weight) = (Bounds::EMPTY, 0.0);
        for i in (1..items.len()).rev() {
            all = all.union(items[i].piece.cell);
            weight += items[i].weight;
            right[i] = all.half_area() * weight;
        }
        (all, weight) = (Bounds::EMPTY, 0.0);
        for i in 1..items.len() {
            all = all.union(items[i - 1].piece.cell);
            weight += items[i - 1].weight;
            let cost = all.half_area() * weight + right[i];
            if cost < best.0 {
                best = (cost, axis, i);
            }
        }
    }
    sort(&mut items, best.1);
    let right = items.split_off(best.2);
    (items, right)
}

/// Sorts items by their centres on an axis. The sort is stable: equal items keep their order.
fn sort(items: &mut [Item], axis: usize) {
    let middle = |i: &Item| i.piece.cell.min[axis] * 0.5 + i.piece.cell.max[axis] * 0.5;
    items.sort_by(|a, b| middle(a).total_cmp(&middle(b)));
}
