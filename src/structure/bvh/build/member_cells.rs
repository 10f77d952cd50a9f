//! The cells of a tree over members: gives each inner node boxes that nest as they are stored, and a voxel that shows
//! what is met first of the members below, as those of triangles do (`tree::InnerNode::over`).
//!
//! Differences from those: a voxel's part is the number of the member with the greatest visible area. All voxels have
//! colours of their own. A cell whose content is not all described never stands in. The share of rays that a cell stops
//! comes from those that its children stop, not from lines through triangles (`stops.rs`).

use super::members::{Kind, WHAT, Wide, each_child};
use super::quantise::quantise;
use super::refs::Ref;
use super::stops::{Part, closed, share_of_group};
use crate::base::error::Result;
use crate::base::memory::{make_room, room};
use crate::lod::{Coded, Content, Fill, OrientedSlabs, SIDES_WORDS, Voxel, loosened, stop_bits, stop_code};
use crate::math::Bounds;
use crate::structure::bvh::appearance::{Appearance, Described, MemberLook, Whole};
use crate::structure::bvh::layout::{LONG_VOXEL, Node, WIDTH};

/// Members with this number or a greater one are not described: it does not fit into a voxel.
const NUMBERS: u32 = 1 << 30;

/// The voxels of all nodes.
#[derive(Default)]
pub(super) struct MemberCells {
    /// Those of the inner children of a node follow each other ([`Wide::voxels`]).
    pub voxels: Vec<[u32; LONG_VOXEL]>,
    /// The sides of voxels that have six. Word 1 of such a voxel is the index here.
    pub sides: Vec<[u32; SIDES_WORDS]>,
    /// What the whole tree looks like, if all of it is described.
    pub appearance: Option<Appearance>,
}

/// A node, for the node above.
struct Below {
    /// The box around its children's boxes as stored.
    cell: Bounds,
    look: Option<Box<Look>>,
}

/// What is known of the content of a node if all of it is described.
struct Look {
    voxel: Voxel,
    content: Content,
    parts: Vec<Part>,
    is_loose: bool,
}

/// A child of a node as a part of the node's content.
struct Piece {
    voxel: Voxel,
    slabs: OrientedSlabs<f32>,
    fill: Fill,
    part: Part,
    is_loose: bool,
}

/// Gives all nodes boxes and voxels. Each node comes before those below it, the last child with all below it first.
/// Where a child is a member, it is given as the index of its box in `refs`. Fails with `NoMemory`.
pub(super) fn add<'a>(
    nodes: &mut [Wide],
    refs: &[Ref],
    look_of: &mut dyn FnMut(u32) -> Option<MemberLook<'a>>,
) -> Result<MemberCells> {
    let mut cells = MemberCells { voxels: room(nodes.len(), WHAT)?, ..MemberCells::default() };
    let mut below: Vec<Below> = Vec::new();
    for wide in nodes.iter_mut().rev() {
        let inner = each_child(wide).filter(|(_, sub)| sub.inner().is_some()).count();
        // The last child comes first in `nodes`, so it was done last.
        let inners = below.split_off(below.len() - inner);
        below.push(one(wide, inners, refs, look_of, &mut cells)?);
    }
    let root = below.pop();
    cells.appearance = root.and_then(|Below { cell, look }| look.map(|look| look.appearance(cell)));
    Ok(cells)
}

/// Gives one node boxes and voxels. `inners` are its inner children, which have the first slots.
fn one<'a>(
    wide: &mut Wide,
    inners: Vec<Below>,
    refs: &[Ref],
    look_of: &mut dyn FnMut(u32) -> Option<MemberLook<'a>>,
    cells: &mut MemberCells,
) -> Result<Below> {
    let members = each_child(wide).filter_map(|(_, sub)| match sub.kind() {
        Kind::Member(at) => Some(&refs[at as usize]),
        Kind::Node(_) | Kind::Stored(..) => None,
    });
    let members: Vec<&Ref> = members.collect();
    let boxes: Vec<Bounds> = inners.iter().map(|it| it.cell).chain(members.iter().map(|r| r.bounds())).collect();
    wide.node = quantise(boxes.iter().copied());
    (0..WIDTH).for_each(|slot| wide.node.keep_from_standing_in(slot));
    let stored: Vec<Bounds> = (0..boxes.len()).map(|slot| wide.node.stored_box(slot)).collect();
    let mut pieces = Vec::with_capacity(boxes.len());
    if inners.iter().any(|it| it.look.is_some()) {
        wide.voxels = cells.voxels.len() as u32;
        for (slot, it) in inners.into_iter().enumerate() {
            let (voxel, piece) = it.look.map_or((None, None), |look| {
                let (voxel, piece) = look.stands_in(&mut wide.node, slot, &stored[slot]);
                (Some(voxel), Some(piece))
            });
            pieces.extend(piece);
            cells.push(voxel)?;
        }
    }
    for (r, cell) in members.iter().zip(&stored[boxes.len() - members.len()..]) {
        let number = r.triangle() as u32;
        let look = look_of(number).filter(|_| number < NUMBERS);
        pieces.extend(look.and_then(|it| it.describe(cell)).map(|it| Piece::of_member(it, number)));
    }
    let cell = stored.iter().fold(Bounds::EMPTY, |all, b| all.union(*b));
    let look = (pieces.len() == boxes.len()).then(|| Box::new(Look::over(&stored, pieces)));
    Ok(Below { cell, look })
}

impl MemberCells {
    /// Appends a voxel, or room for one that is never looked at.
    fn push(&mut self, voxel: Option<Coded>) -> Result<()> {
        let Some(Coded { mut words, sides, .. }) = voxel else {
            self.voxels.push([0; LONG_VOXEL]);
            return Ok(());
        };
        if let Some(sides) = sides {
            words[1] = self.sides.len() as u32;
            make_room(&mut self.sides, 1, WHAT)?;
            self.sides.push(*sides);
        }
        self.voxels.push(words);
        Ok(())
    }
}

impl Piece {
    fn of_member(Described { slabs, sides, fill, part, is_loose }: Described, number: u32) -> Self {
        Self { voxel: Voxel::of_sides(sides, number), slabs, fill, part, is_loose }
    }
}

impl Look {
    /// The look of pieces in their boxes.
    fn over(boxes: &[Bounds], pieces: Vec<Piece>) -> Self {
        let voxel = Voxel::over(boxes.iter().zip(pieces.iter().map(|it| &it.voxel)));
        let content = boxes.iter().zip(&pieces).map(|(b, it)| (*b, it.slabs, it.fill)).collect();
        let parts = pieces.iter().map(|it| it.part).collect();
        let area = |only_loose: bool| -> f32 {
            let some = boxes.iter().zip(&pieces).filter(|(_, it)| it.is_loose || !only_loose);
            some.map(|(b, _)| b.half_area()).sum()
        };
        let is_loose = 2.0 * area(true) > area(false);
        Self { voxel, content: Content::of_cells(content), parts, is_loose }
    }

    /// What a whole tree looks like; `cell` is the box around its root's children.
    fn appearance(self, cell: Bounds) -> Appearance {
        let Self { voxel, content, parts, is_loose } = self;
        let points = Fill::of(&content, &cell).middles(&cell);
        Appearance::of(Whole { cell, voxel, content, parts: &parts, is_loose, points })
    }

    /// Makes the cell in `slot` of a node, which is stored as `cell`, stand in for the content. Returns its voxel, and
    /// the cell as a part of the node's content.
    fn stands_in(self, node: &mut Node, slot: usize, cell: &Bounds) -> (Coded, Piece) {
        let Self { voxel, content, parts, is_loose } = self;
        let mut coded = Coded::of(&voxel, &node.stored_middle(slot), &content, true);
        node.set_oriented_slabs(slot, coded.slabs, coded.words[0] as u16);
        let (slabs, fill) = (node.stored_oriented_slabs(slot), Fill::of(&content, cell));
        node.set_level(slot, fill.level(cell, &slabs));
        let share = share_of_group(cell, &slabs, &parts);
        let stops = closed(share, is_loose);
        let code = stop_code(stops);
        if code > 0 {
            let first = coded.words[0] | stop_bits(code);
            coded.words[0] = if is_loose { loosened(first) } else { first };
            node.set_transmitting(slot);
        }
        (coded, Piece { voxel, slabs, fill, part: Part::new(*cell, slabs, stops), is_loose })
    }
}
