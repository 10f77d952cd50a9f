//! The appearance of a tree's content as a whole: what a group of members is made of, in a tree over members
//! (`build/member_cells.rs`). It is composited from the cells of the root's children.

use super::build::stops::{Part, closed, share_of_tree};
use super::layout::{Block, Child};
use super::trace::{TreeView, cell_hit};
use crate::base::ids::BlockId;
use crate::lod::{
    Coded, Content, Fill, Middle, OrientedSlab, OrientedSlabs, PlacedSides, Sample, Seen, Shares, Voxel, farthest,
    fields, normal_bytes, oriented_slabs, placed_sides, side_seen,
};
use crate::math::{Bounds, bits};
use crate::structure::cell::Cells;
use glam::{DAffine3, DMat3, DVec3, Vec3};

/// Number of points that tell where the content is, at most: those of two levels of nodes.
const POINTS: usize = WIDTH * WIDTH + WIDTH;
/// Children of a node.
const WIDTH: usize = super::layout::WIDTH;

/// What the content of a tree looks like from outside, and where it is, in the tree's frame.
#[derive(Debug, Clone)]
pub struct Appearance {
    /// The box around the cells of the root's children. All content is in it, and inside of the slabs.
    cell: Bounds,
    slabs: OrientedSlabs<f32>,
    /// The samples of its six sides.
    sides: [Sample; 6],
    /// Points that are each `within` this distance of some content.
    points: Vec<DVec3>,
    within: f64,
    /// Share of the lines through the box, inside of the slabs, that the content stops.
    stops: f32,
    /// True if most of the content is loose, as leaves are.
    is_loose: bool,
}

/// A member as it looks in the frame of the tree over members.
#[derive(Debug, Clone, Copy)]
pub struct MemberLook<'a> {
    /// The appearance of what is placed there.
    pub appearance: &'a Appearance,
    /// The map from the appearance's frame to that of the tree over members.
    pub map: DAffine3,
    /// Greatest factor by which the map lengthens: its greatest singular value, or more.
    pub stretch: f64,
    /// Factors to its linear colours, 0 to 1.
    pub tint: Vec3,
}

/// The content of a tree.
pub(super) struct Whole<'a> {
    /// The box around the cells of the root's children.
    pub cell: Bounds,
    /// The voxel over these cells, and the cells.
    pub voxel: Voxel,
    pub content: Content,
    pub parts: &'a [Part],
    pub is_loose: bool,
    /// Points near the content, and how near.
    pub points: (Vec<DVec3>, f64),
}

impl Appearance {
    pub(super) fn of(it: Whole) -> Self {
        let Whole { cell, voxel, content, parts, is_loose, points: (points, within) } = it;
        let middle = Middle::of(&cell);
        let Coded { words, slabs, .. } = Coded::of(&voxel, &middle, &content, true);
        let slabs = oriented_slabs(fields(slabs), normal_bytes(words[0]), &middle);
        let stops = closed(share_of_tree(&cell, &slabs, parts), is_loose);
        Self { cell, slabs, sides: voxel.sides, points, within, stops, is_loose }
    }
}

impl TreeView<'_> {
    /// The root with its block, if that is in memory; `None` also for trees of one triangle or of none.
    fn root_node(&self) -> Option<(Block<'_>, usize)> {
        let Child::Node(index) = Child::from_bits(self.root) else { return None };
        let words = self.snapshot.block(BlockId(self.root_block)).filter(|_| !self.is_empty())?;
        Some((Block::new(words), index))
    }

    /// See [`crate::structure::Tree::root_parts`].
    pub fn root_parts(&self) -> Option<[Option<(u32, f32)>; WIDTH]> {
        let (block, index) = self.root_node()?;
        let node = block.node(index);
        let mut parts = [None; WIDTH];
        for slot in bits(node.valid.into()) {
            parts[slot] = Some((block.voxel(index, slot).part().0, node.stored_box(slot).half_area()));
        }
        Some(parts)
    }

    /// See [`crate::structure::Tree::appearance`].
    pub fn appearance(&self, colour_of: &dyn Fn(u32) -> Vec3) -> Option<Appearance> {
        let (block, index) = self.root_node().filter(|_| !self.has_members)?;
        let node = block.node(index);
        let slots: Vec<usize> = bits(node.valid.into()).collect();
        let boxes: Vec<Bounds> = slots.iter().map(|slot| node.stored_box(*slot)).collect();
        let slabs: Vec<_> = slots.iter().map(|slot| node.stored_oriented_slabs(*slot)).collect();
        let cell = boxes.iter().fold(Bounds::EMPTY, |all, b| all.union(*b));
        let (sides, loose) = self.sides_of_children(block, index, colour_of)?;
        let voxels: Vec<Voxel> = slots.iter().map(|slot| Voxel::of_sides(sides[*slot], 0)).collect();
        let empty = Fill::of_points(std::iter::empty(), 0.0, &cell);
        let parts: Vec<Part> = slots
            .iter()
            .zip(boxes.iter().zip(&slabs))
            .map(|(slot, (b, slabs))| Part::new(*b, *slabs, block.voxel(index, *slot).share_stopped()))
            .collect();
        let area = |slot: &usize| node.stored_box(*slot).half_area();
        let of_loose: f32 = slots.iter().filter(|slot| loose >> **slot & 1 == 1).map(area).sum();
        Some(Appearance::of(Whole {
            cell,
            voxel: Voxel::over(boxes.iter().zip(&voxels)),
            content: Content::of_cells(boxes.iter().zip(&slabs).map(|(b, slabs)| (*b, *slabs, empty)).collect()),
            parts: &parts,
            is_loose: 2.0 * of_loose > slots.iter().map(area).sum::<f32>(),
            points: points_of(block, index),
        }))
    }

    /// Returns the samples of the sides of a node's children, and the children with loose content. `None` if the
    /// node's block is not in memory.
    fn sides_of_children(
        &self,
        block: Block,
        index: usize,
        colour_of: &dyn Fn(u32) -> Vec3,
    ) -> Option<([[Sample; 6]; WIDTH], u32)> {
        const OUT: [DVec3; 6] = [DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X, DVec3::Y, DVec3::Z];
        let (valid, mut sides) = (u32::from(block.node(index).valid), [[Sample::NOTHING; 6]; WIDTH]);
        let mut cells = Cells::<WIDTH>::NONE;
        for (side, out) in OUT.into_iter().enumerate() {
            let hit = |slot: usize| cell_hit(self.root_block, index, slot);
            if self.cells(valid, hit, |_| -out, (true, 0), &mut cells) != 0 {
                return None;
            }
            for slot in bits(valid) {
                let shares = match (cells.have_three >> slot & 1, cells.have_shares >> slot & 1) {
                    (0, _) => Shares::One,
                    (_, 0) => Shares::OfSides,
                    _ => Shares::Given(cells.shares.map(|row| row[slot])),
                };
                let three = |rows: &[[u32; WIDTH]; 3]| match shares {
                    Shares::One => [rows[0][slot]; 3],
                    _ => rows.map(|row| row[slot]),
                };
                let seen = Seen { firsts: three(&cells.firsts), seconds: three(&cells.seconds), shares };
                let colour = if cells.coloured >> slot & 1 == 1 { None } else { Some(colour_of(cells.part[slot])) };
                let voxel = block.voxel(index, slot);
                let is_of_sides = shares == Shares::OfSides && voxel.has_sides();
                let cover = if is_of_sides { None } else { Some(voxel.share_stopped()) };
                sides[slot][side] = side_seen(side, cells.bounds_of(slot).extent(), &seen, colour, cover);
            }
        }
        Some((sides, cells.loose))
    }
}

/// Returns points near the content below a node, and how near: the middles of cells, which all hold some content. Large
/// cells are replaced by those below, as far as the block goes.
fn points_of(block: Block, root: usize) -> (Vec<DVec3>, f64) {
    let below = |index: usize| {
        let node = block.node(index);
        bits(node.valid.into()).map(move |slot| {
            let child = Child::from_bits(u32::from(node.child[slot]));
            (node.stored_box(slot), if let Child::Node(index) = child { Some(index) } else { None })
        })
    };
    let diagonal = |b: &Bounds| (b.max.as_dvec3() - b.min.as_dvec3()).length();
    let mut cells: Vec<(Bounds, Option<usize>)> = below(root).collect();
    while cells.len() + WIDTH <= POINTS {
        // The first of the largest.
        let larger = |a: usize, b: usize| if diagonal(&cells[b].0) > diagonal(&cells[a].0) { b } else { a };
        let Some(at) = (0..cells.len()).reduce(larger) else { break };
        let Some(index) = cells[at].1 else { break };
        cells.swap_remove(at);
        cells.extend(below(index));
    }
    let middle = |b: &Bounds| (b.min.as_dvec3() + b.max.as_dvec3()) * 0.5;
    let within = cells.iter().map(|(b, _)| diagonal(b) * 0.5).fold(0.0, f64::max);
    (cells.iter().map(|(b, _)| middle(b)).collect(), within)
}

/// A member in the frame of the tree over members.
pub(super) struct Described {
    /// Bounds of its content.
    pub slabs: OrientedSlabs<f32>,
    /// The samples of the sides of its box.
    pub sides: [Sample; 6],
    /// Where its content is in its box.
    pub fill: Fill,
    /// The lines that it stops.
    pub part: Part,
    /// See [`Appearance`].
    pub is_loose: bool,
}

impl MemberLook<'_> {
    /// Describes the member in its box; `None` if its map cannot be inverted.
    pub(super) fn describe(&self, cell: &Bounds) -> Option<Described> {
        let Self { appearance: it, map, stretch, tint } = self;
        let inverse = map.inverse();
        if !(inverse.is_finite() && map.is_finite() && stretch.is_finite()) {
            return None;
        }
        let slabs = it.placed_slabs(map, &inverse.matrix3)?;
        let sides =
            PlacedSides { sides: &it.sides, extent: it.cell.extent(), linear: map.matrix3, inverse: inverse.matrix3 };
        let points = it.points.iter().map(|p| map.transform_point3(*p));
        Some(Described {
            slabs,
            sides: placed_sides(&sides, cell.extent()).map(|it| Sample { colour: it.colour * *tint, ..it }),
            fill: Fill::of_points(points, it.within * stretch, cell),
            part: Part::new(it.cell, it.slabs, it.stops).placed(inverse),
            is_loose: it.is_loose,
        })
    }
}

impl Appearance {
    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        (size_of::<Self>() + size_of_val(&self.points[..])) as u64
    }

    /// The slabs in another frame. Their axes turn through the inverse transpose. In single precision these are not
    /// quite the images of the old ones, so the planes are bounds of the content along the axes as they are stored.
    fn placed_slabs(&self, map: &DAffine3, inverse: &DMat3) -> Option<OrientedSlabs<f32>> {
        let mut slabs = self.slabs;
        for (slab, old) in slabs.iter_mut().zip(&self.slabs) {
            let turned = inverse.transpose() * Vec3::from(old.axis).as_dvec3();
            let axis = (turned / turned.abs().element_sum()).as_vec3();
            let along = axis.as_dvec3();
            let local = map.matrix3.transpose() * along;
            let at = along.dot(map.translation);
            let [low, high] = [-local, local].map(|way| farthest(&self.cell, &self.slabs, way));
            let (low, high) = (((at - low) as f32).next_down(), ((at + high) as f32).next_up());
            if !(axis.is_finite() && low.is_finite() && high.is_finite()) {
                return None;
            }
            *slab = OrientedSlab { axis: axis.to_array(), low, high };
        }
        Some(slabs)
    }
}
