//! Computes the share of rays that each cell stops, of those that enter its region (its box inside its oriented slabs).
//!
//! Lines through the region, uniform over all of them, are tested against the triangles below: the share of a cell is
//! not made of those of its children. Two effects come from outside the cell:
//!
//! - A cell of a closed wall must transmit nothing, however ragged its piece of the wall is. So all cells of a treelet
//!   (see [`super::tree::TREELET`]) are **walls** if their content continues next to them: of the lines that cross a
//!   cell's first slab steeply, or pass it as near as an eighth of its size ([`Region`]), and hit nothing in it, most
//!   hit other, **near surface** within that distance ([`FOUND`]).
//! - A line that passes the end of a piece of a wire hits the next piece. Overlapping cells mostly decide alike about a
//!   ray (`trace/coverage.rs`), so the next cell would transmit it too. So a part of these lines counts as stopped:
//!   [`BESIDE`].
//!
//! Neither holds for **loose** content, such as needles and leaves ([`FREE`]): what is next to it is there by chance.
//!
//! All cells are tested with the same lines, shifted by a hash of the cell's position, so that a random error in one
//! cell does not repeat in the next. The result does not depend on the number of threads.

use super::content::{Scene, push_crossed};
use super::lines::{Lines, NONE, Region, Set, numbers, put};
use super::refs::Ref;
use super::tree::{InnerNode, Piece, Place, Sub};
use crate::base::error::Result;
use crate::base::progress::Stretch;
use crate::lod::{OrientedSlabs, loosened, stop_bits, stop_code};
use crate::math::Bounds;
use crate::simd::{Isa, Op, Simd, dispatch};
use crate::structure::bake::TreeInput;
use crate::structure::par::Par;

/// Approximate number of groups of lines that the first test of a treelet spreads over its cells.
const PROBES: usize = 16;
/// Least cosine between a steep line and the normal of the slab.
const STEEP: f32 = 0.6;
/// The cells of a treelet are walls if this share of the lines that hit nothing find near surface in the first test.
const SURE: f32 = 0.7;
/// The first test may end after near surface was sought for this number of these lines.
const ENOUGH: f32 = 16.0;
/// The same share for the second test, after a further group of lines through each cell. (Measured shares: 0.5 to 1 in
/// treelets of spheres and a scan of a million triangles, 0.1 to 0.4 among plates, less than 0.2 among wires, less than
/// 0.05 among leaf cards; in terrains of cubes any value. All treelets of a Mandelbulb of a million find 0.5 or more, 2
/// of 5,745 less than this, see [`agree`]. With 0.45, small steps in a terrain of cubes close, which brightens it by
/// 1.3 % at half a pixel of error, 1.7 % with shadows; now 0.7 and 1.0 %.)
const FOUND: f32 = 0.55;
/// The content of a treelet is **loose**, as needles and leaves are, if more than this share of its edges is free
/// (`edges.rs`). It is no wall if less than [`CLOSED`] of the lines that hit nothing find near surface: that is there
/// by chance, so no line counts as stopped for it. (Measured shares: at most 0.1 in closed surfaces, terrains, plates
/// and a skin over ribs, 0.2 to 0.45 in pines, of which 0.65 to 0.9 of the lines find near surface. As walls, pines
/// covered 1.02, 1.09 and 1.27 of the oracle's coverage at 1, 3 and 10 pixels of error, else 1.00, 1.02 and 1.06.)
const FREE: f32 = 0.15;
/// See [`FREE`].
const CLOSED: f32 = 0.9;
/// Distance of near surface, as a fraction of the cell's size: for cells in treelets, and for **larger** cells, which
/// are those of nodes above treelets and of the uppermost nodes of treelets.
const NEAR: [f32; 2] = [0.125, 0.25];
/// Share that counts as stopped, of the lines that miss a cell's content and find near surface: for leaves, other nodes
/// in treelets, and larger cells. (Coverage of two forests of wires at PoE 0.5, 1, 3 and 10, greatest error of six
/// views: 0.02, 0.02, 0.03 and 0.03, and 0.05, 0.04, 0.02 and 0.04. Plates need less, wires as much, so the value of
/// leaves depends on their treelet.)
const BESIDE: Beside = Beside { of_nodes: 0.5, of_larger: 0.75, of_leaves: 2.0 };
/// Greatest number of nodes and leaves in which near surface is sought for a line.
const SEEK: usize = 64;
/// The lines of a group for which near surface is sought.
const HALF: u8 = 0b0101_0101;
/// Groups of eight lines through a cell in a treelet, and through a larger one. Near surface is sought for [`HALF`] of
/// the lines of the first group, or of the first quarter of the groups.
const LINES: [usize; 2] = [4, 16];
/// A larger cell that stops at most this share of its lines is sampled [`ROUNDS`] times.
const SPARSE: f32 = 0.5;
/// See [`SPARSE`].
const ROUNDS: usize = 4;

/// See [`BESIDE`].
#[derive(Clone, Copy)]
pub(super) struct Beside {
    of_nodes: f32,
    of_larger: f32,
    /// For leaves: factor of the share of the lines next to their treelet's cells that find near surface, which is low
    /// among plates and cards, and higher along wires.
    of_leaves: f32,
}

/// A cell to be sampled.
#[derive(Clone, Copy)]
struct Cell<'a> {
    bounds: Bounds,
    slabs: OrientedSlabs<f32>,
    sub: &'a Sub,
}

/// Computes the share of rays that each cell below `pieces` stops, the same with any instruction set. Fails only with
/// [`crate::Error::Cancelled`].
///
/// In a model of several chunks, cells over more than one chunk and those right below a chunk's root (`join`) transmit
/// nothing. Near surface is sought in the same chunk only, so fewer cells at its ends become walls.
/// (`tests/stability/awkward.rs`: closed meshes of several chunks stay closed all the same.)
pub fn mark(pieces: &mut [Piece], input: TreeInput, refs: &[Ref], isa: Isa, par: &Par, work: &Stretch) -> Result<()> {
    mark_with(BESIDE, pieces, input, refs, isa, par, work)
}

fn mark_with(
    beside: Beside,
    pieces: &mut [Piece],
    input: TreeInput,
    refs: &[Ref],
    isa: Isa,
    par: &Par,
    work: &Stretch,
) -> Result<()> {
    let scene = Scene { pieces, input, refs, beside };
    let (mut treelets, mut large) = (vec![], vec![]);
    inners(pieces).for_each(|inner| gather_treelets(inner, &mut treelets));
    let below = work.part(0.0, 0.8, treelets.len() as u64);
    let known = par.map(treelets.len(), |i| {
        below.begin()?;
        Ok(dispatch(isa, OfTreelet { scene: &scene, treelet: treelets[i] }))
    });
    let mut known = known.into_iter().collect::<Result<Vec<_>>>()?;
    let mut next = known.iter_mut();
    inners(pieces).for_each(|inner| agree(inner, &mut next));
    let mut next = known.iter();
    inners(pieces).for_each(|inner| {
        gather_large(inner, None, &mut next, &mut large);
    });
    let above = work.part(0.8, 1.0, large.len() as u64);
    let codes = par.map(large.len(), |i| {
        above.begin()?;
        Ok(large[i].map_or((0, false), |large| (dispatch(isa, OfLarge { scene: &scene, large }), large.is_loose)))
    });
    let (mut known, mut codes) = (known.into_iter(), codes.into_iter().collect::<Result<Vec<_>>>()?.into_iter());
    for piece in pieces {
        if let Sub::InnerNode(inner) = &mut piece.sub {
            apply(inner, &mut known, &mut codes);
        }
    }
    debug_assert!(known.len() == 0 && codes.len() == 0, "some results were not assigned");
    Ok(())
}

pub(super) fn inners(pieces: &[Piece]) -> impl Iterator<Item = &InnerNode> {
    pieces.iter().filter_map(|p| if let Sub::InnerNode(inner) = &p.sub { Some(&**inner) } else { None })
}

/// A treelet: neighbours in one node, and all nodes below them.
#[derive(Clone, Copy)]
struct Treelet<'a> {
    inner: &'a InnerNode,
    /// First and end slot of the neighbours.
    slots: [usize; 2],
}

impl<'a> Treelet<'a> {
    /// Returns the triangles of its cells.
    fn triangles(&self, scene: &Scene) -> Vec<u32> {
        let mut out = Vec::new();
        let slots = self.inner.children.iter().take(self.slots[1]).skip(self.slots[0]);
        slots.for_each(|(_, sub)| scene.below(sub, &mut out));
        out
    }

    /// Returns its cells, in order, without those of its uppermost nodes, which are sampled as larger cells.
    fn cells(&self) -> Vec<Cell<'a>> {
        let mut out = Vec::new();
        for cell in cells(self.inner).take(self.slots[1]).skip(self.slots[0]) {
            match cell.sub {
                Sub::InnerNode(below) => all_cells(below, &mut out),
                _ => out.push(cell),
            }
        }
        out
    }
}

/// Returns the children of a node in runs (first and end slot); those of a treelet form one run.
fn runs(inner: &InnerNode) -> Vec<[usize; 2]> {
    let mut end = 0;
    let run = |run: &[Place]| {
        end += run.len();
        [end - run.len(), end]
    };
    inner.places[..inner.children.len()].chunk_by(|_, next| *next == Place::GoesOn).map(run).collect()
}

/// Returns a child that is larger than treelets.
fn above_treelets(inner: &InnerNode, slot: usize) -> Option<&InnerNode> {
    match &inner.children[slot].1 {
        Sub::InnerNode(below) if inner.places[slot] == Place::Above => Some(below),
        _ => None,
    }
}

/// Appends the treelets below a node, in order.
fn gather_treelets<'a>(inner: &'a InnerNode, out: &mut Vec<Treelet<'a>>) {
    for slots in runs(inner) {
        match above_treelets(inner, slots[0]) {
            Some(below) => gather_treelets(below, out),
            None => out.push(Treelet { inner, slots }),
        }
    }
}

/// Makes all treelets in one node walls if those with half of their cells or more are: a small piece of a wall, at its
/// corner, may look different. (Two of a Mandelbulb of a million do. One of them was a hole of one pixel where three
/// quarters had to agree. A treelet that is alone in its node decides alone: a wire may lie next to a wall.)
fn agree(inner: &InnerNode, treelets: &mut std::slice::IterMut<Known>) {
    let (mut here, mut sums) = (Vec::new(), [0; 2]);
    for slots in runs(inner) {
        match above_treelets(inner, slots[0]) {
            Some(below) => agree(below, treelets),
            None => here.extend(treelets.next()),
        }
    }
    for known in &here {
        sums = [sums[0] + known.cells, sums[1] + known.of_walls()];
    }
    if 2 * sums[1] >= sums[0] {
        here.iter_mut().filter(|known| !known.is_loose).for_each(|known| known.codes.clear());
    }
}

/// Appends all larger cells, in order; `None` for those with walls as a quarter or more of the cells below. Returns the
/// number of cells below, and the numbers of walls and of loose cells among them.
fn gather_large<'a>(
    inner: &'a InnerNode,
    above: Option<&'a InnerNode>,
    treelets: &mut std::slice::Iter<Known>,
    out: &mut Vec<Large<'a>>,
) -> [usize; 3] {
    let (mut sums, all) = ([0; 3], cells(inner).collect::<Vec<_>>());
    for slots in runs(inner) {
        let at = out.len();
        out.extend(
            (slots[0]..slots[1])
                .filter(|slot| matches!(all[*slot].sub, Sub::InnerNode(_)))
                .map(|slot| Some(LargeCell { cell: all[slot], above, is_loose: false })),
        );
        let end = out.len();
        let counts = match above_treelets(inner, slots[0]) {
            Some(below) => gather_large(below, Some(inner), treelets, out),
            // The treelets come in the same order: there is one for each run.
            None => treelets.next().map_or([0; 3], |known| [known.cells, known.of_walls(), known.of_loose()]),
        };
        if 4 * counts[1] >= counts[0] {
            out[at..end].fill(None);
        }
        if 2 * counts[2] >= counts[0] {
            out[at..end].iter_mut().flatten().for_each(|large| large.is_loose = true);
        }
        sums = [0, 1, 2].map(|k| sums[k] + counts[k]);
    }
    sums
}

fn cells(inner: &InnerNode) -> impl Iterator<Item = Cell<'_>> {
    let all = inner.children.iter().enumerate();
    all.map(|(slot, (_, sub))| Cell {
        bounds: inner.node.stored_box(slot),
        slabs: inner.node.stored_oriented_slabs(slot),
        sub: lone_leaf(sub).unwrap_or(sub),
    })
}

/// Returns the leaf that a node was put over ([`super::tree::wrap_leaves`]): both have the same cell, which is sampled
/// once.
fn lone_leaf(sub: &Sub) -> Option<&Sub> {
    match sub {
        Sub::InnerNode(inner) if matches!(inner.children[..], [(_, Sub::Leaf { .. })]) => Some(&inner.children[0].1),
        _ => None,
    }
}

impl Cell<'_> {
    fn region(&self) -> Region {
        Region::around(&self.bounds, &self.slabs, 0.0)
    }
}

/// Appends all cells below a node, in order.
fn all_cells<'a>(inner: &'a InnerNode, out: &mut Vec<Cell<'a>>) {
    for cell in cells(inner) {
        out.push(cell);
        if let Sub::InnerNode(below) = cell.sub {
            all_cells(below, out);
        }
    }
}

/// Result for the cells of a treelet.
struct Known {
    /// Number of cells.
    cells: usize,
    /// True if the content is loose.
    is_loose: bool,
    /// A stop code for each cell, in order; empty if all are walls.
    codes: Vec<u8>,
}

impl Known {
    /// Returns the number of its cells if their content is loose.
    fn of_loose(&self) -> usize {
        if self.is_loose { self.cells } else { 0 }
    }

    /// Returns the number of its cells that are walls.
    fn of_walls(&self) -> usize {
        if self.codes.is_empty() { self.cells } else { 0 }
    }
}

/// Computes the stop codes of a treelet.
struct OfTreelet<'a> {
    scene: &'a Scene<'a>,
    treelet: Treelet<'a>,
}

impl Op for OfTreelet<'_> {
    type Out = Known;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Known {
        let Self { scene, treelet } = self;
        let (all, mut asker) = (treelet.cells(), Asker::new(scene, Some(treelet.inner)));
        let triangles = treelet.triangles(scene);
        let free = if scene.has_few_parts(&triangles) { scene.free_edges(&triangles) } else { 0.0 };
        let is_free = free > FREE;
        let walls = Known { cells: all.len(), is_loose: false, codes: Vec::new() };
        let mut sums = Asked::default();
        // One group is left for the second test.
        let (groups, step) = (PROBES.div_ceil(all.len()).min(PROBES - 1), (all.len() / PROBES).max(1));
        // A quarter of the cells at a time, from all over the treelet: for most of a scan the first quarter is enough.
        for quarter in 0..4 {
            for cell in all.iter().skip(quarter * step).step_by(4 * step) {
                sums.add(asker.beside(s, cell, [0, groups]));
            }
            if (sums.sought >= ENOUGH || quarter == 3) && sums.is_wall(if is_free { CLOSED } else { SURE }) {
                return walls;
            }
        }
        // The result may be due to chance: more lines are tested.
        for cell in &all {
            sums.add(asker.beside(s, cell, [groups, groups + 1]));
        }
        if sums.is_wall(if is_free { CLOSED } else { FOUND }) {
            return walls;
        }
        let of_leaves = (scene.beside.of_leaves * sums.near()).min(1.0);
        // No iterator: its closure is compiled without the vector instructions, and takes twice the time.
        let mut codes = Vec::new();
        for cell in &all {
            let beside = match cell.sub {
                _ if is_free => 0.0,
                Sub::InnerNode(_) => scene.beside.of_nodes,
                _ => of_leaves,
            };
            codes.push(asker.together(s, cell, LINES[0]).code(beside));
        }
        Known { codes, is_loose: is_free, ..walls }
    }
}

/// A larger cell.
#[derive(Clone, Copy)]
struct LargeCell<'a> {
    cell: Cell<'a>,
    /// The parent of the node that holds it, unless that node is a piece.
    above: Option<&'a InnerNode>,
    /// True if most of its content is loose.
    is_loose: bool,
}

/// A larger cell to be sampled, if it is.
type Large<'a> = Option<LargeCell<'a>>;

/// Computes the stop code of a larger cell.
struct OfLarge<'a> {
    scene: &'a Scene<'a>,
    large: LargeCell<'a>,
}

impl Op for OfLarge<'_> {
    type Out = u8;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> u8 {
        let Self { scene, large: LargeCell { cell, above, is_loose } } = self;
        let beside = if is_loose { 0.0 } else { scene.beside.of_larger };
        let (mut region, mut asker, mut sums) = (cell.region(), Asker::new(scene, above), Asked::default());
        for _ in 0..ROUNDS {
            sums.add(asker.alone(s, cell.sub, &region, LINES[1], LINES[1] / 4));
            if sums.stops(beside) > SPARSE {
                break;
            }
            region.go_on();
        }
        sums.code(beside)
    }
}

/// Results of lines through a cell's region.
#[derive(Clone, Copy, Default)]
struct Asked {
    /// Weight of all lines.
    all: f32,
    /// Weight of the lines that hit nothing in the cell.
    transmitted: f32,
    /// Weight of those of them for which near surface was sought.
    sought: f32,
    /// Weight of those that found some.
    found: f32,
}

impl Asked {
    fn add(&mut self, o: Self) {
        (self.all, self.transmitted) = (self.all + o.all, self.transmitted + o.transmitted);
        (self.sought, self.found) = (self.sought + o.sought, self.found + o.found);
    }

    /// True for a wall. It is also true if no line misses the content, but false if there is no line.
    fn is_wall(&self, least: f32) -> bool {
        self.all > 0.0 && self.found >= least * self.sought
    }

    /// Share of those that find near surface, among the lines that hit nothing in the cell.
    fn near(&self) -> f32 {
        self.found / self.sought.max(f32::MIN_POSITIVE)
    }

    /// Share of all lines that counts as stopped.
    fn stops(&self, beside: f32) -> f32 {
        1.0 - self.transmitted * (1.0 - beside * self.near()) / self.all.max(f32::MIN_POSITIVE)
    }

    /// Returns the stop code, see [`stop_bits`].
    fn code(&self, beside: f32) -> u8 {
        // Results that are too small for single precision are not finite.
        stop_code(self.stops(beside))
    }
}

/// Tests lines through cells.
struct Asker<'a> {
    scene: &'a Scene<'a>,
    /// Near surface is first sought below this node.
    above: Option<&'a InnerNode>,
    lines: Lines,
    triangles: Vec<u32>,
    stack: Vec<&'a Sub>,
}

impl<'a> Asker<'a> {
    fn new(scene: &'a Scene<'a>, above: Option<&'a InnerNode>) -> Self {
        Self { scene, above, lines: Lines::new(), triangles: Vec::new(), stack: Vec::new() }
    }

    /// Tests the lines of `groups` groups one by one, down the tree. Seeks near surface for the first `seek` groups.
    #[inline(always)]
    fn alone<S: Simd>(&mut self, s: S, sub: &'a Sub, region: &Region, groups: usize, seek: usize) -> Asked {
        self.lines.through(s, region, [0, groups]);
        let mut transmitted = NONE;
        for i in numbers(self.lines.all) {
            self.stack.push(sub);
            put(&mut transmitted, i, !self.scene.meets(s, &self.lines.one(i, 0.0), usize::MAX, &mut self.stack));
        }
        self.asked(s, &transmitted, seek, HALF, region.size * NEAR[1])
    }

    /// Tests those lines of `groups` (first, end) that go steeply through a cell or near it. Seeks near surface for all
    /// lines that hit nothing in the cell.
    #[inline(always)]
    fn beside<S: Simd>(&mut self, s: S, cell: &Cell<'a>, groups: [usize; 2]) -> Asked {
        let region = Region::around(&cell.bounds, &cell.slabs, NEAR[0]);
        self.lines.through(s, &region, groups);
        // Otherwise a few short lines through the smallest cells outweigh all others.
        self.lines.weigh_alike();
        self.lines.keep_steep(s, &region, STEEP);
        let transmitted = self.pass_all(s, cell);
        self.asked(s, &transmitted, transmitted.len(), 0xff, region.size * NEAR[0])
    }

    /// Returns the lines that hit none of the triangles in a cell, of which there are few.
    #[inline(always)]
    fn pass_all<S: Simd>(&mut self, s: S, cell: &Cell) -> Set {
        self.triangles.clear();
        self.scene.below(cell.sub, &mut self.triangles);
        let mut transmitted = self.lines.all;
        for triangle in &self.triangles {
            if !self.lines.leave(s, &mut transmitted, &self.scene.input.triangles[*triangle as usize]) {
                break;
            }
        }
        transmitted
    }

    /// Tests the lines of `groups` groups at once against each of the triangles in a cell, of which there are few.
    /// Seeks near surface for the first group.
    #[inline(always)]
    fn together<S: Simd>(&mut self, s: S, cell: &Cell, groups: usize) -> Asked {
        let region = cell.region();
        self.lines.through(s, &region, [0, groups]);
        let transmitted = self.pass_all(s, cell);
        self.asked(s, &transmitted, 1, HALF, region.size * NEAR[0])
    }

    /// Sums up the results of lines of which `transmitted` hit nothing in the cell. For `some` lines of each of the
    /// first groups, it tests whether they hit anything in the chunk within their intervals, lengthened by `near` at
    /// both ends: first below `above`, where such surface mostly is. (A search there alone leaves holes in closed
    /// spheres and rooms, because it misses surface outside the outermost cells.)
    #[inline(always)]
    fn asked<S: Simd>(&mut self, s: S, transmitted: &Set, groups: usize, some: u8, near: f32) -> Asked {
        let (mut sought, mut found) = (NONE, NONE);
        for group in 0..groups {
            sought[group] = transmitted[group] & some;
        }
        for i in numbers(sought) {
            let line = self.lines.one(i, near);
            self.stack.extend(self.scene.pieces.iter().map(|p| &p.sub));
            if let Some(inner) = self.above {
                push_crossed(s, &line, inner, &mut self.stack);
            }
            put(&mut found, i, self.scene.meets(s, &line, SEEK, &mut self.stack));
        }
        let sets = [&self.lines.all, transmitted, &sought, &found];
        let [all, transmitted, sought, found] = sets.map(|set| self.lines.weight(set));
        Asked { all, transmitted, sought, found }
    }
}

/// Assigns codes to cells, in the order in which they were gathered.
fn apply(inner: &mut InnerNode, treelets: &mut std::vec::IntoIter<Known>, large: &mut std::vec::IntoIter<(u8, bool)>) {
    for slots in runs(inner) {
        let is_treelet = above_treelets(inner, slots[0]).is_none();
        let known = if is_treelet { treelets.next() } else { None };
        let is_loose = known.as_ref().is_some_and(|known| known.is_loose);
        let mut codes = known.map_or_else(Vec::new, |known| known.codes).into_iter();
        for slot in slots[0]..slots[1] {
            if is_leaf(&inner.children[slot].1) {
                set(inner, slot, (codes.next().unwrap_or(0), is_loose));
                continue;
            }
            set(inner, slot, large.next().unwrap_or_default());
            match &mut inner.children[slot].1 {
                Sub::InnerNode(below) if is_treelet => apply_all(below, &mut codes, is_loose),
                Sub::InnerNode(below) => apply(below, treelets, large),
                _ => {}
            }
        }
        debug_assert!(codes.len() == 0, "some codes of a treelet were not assigned");
    }
}

fn apply_all(inner: &mut InnerNode, codes: &mut std::vec::IntoIter<u8>, is_loose: bool) {
    for slot in 0..inner.children.len() {
        let Some(code) = codes.next() else { return };
        set(inner, slot, (code, is_loose));
        match &mut inner.children[slot].1 {
            sub if is_leaf(sub) => {}
            Sub::InnerNode(below) => apply_all(below, codes, is_loose),
            _ => {}
        }
    }
}

/// True for a leaf, and for a node that was put over one.
fn is_leaf(sub: &Sub) -> bool {
    matches!(sub, Sub::Leaf { .. }) || lone_leaf(sub).is_some()
}

/// Sets a stop code, and whether the content is loose.
fn set(inner: &mut InnerNode, slot: usize, (code, is_loose): (u8, bool)) {
    if code > 0 {
        let first = &mut inner.children[slot].0.words[0];
        *first |= stop_bits(code);
        if is_loose {
            *first = loosened(*first);
        }
        inner.node.set_transmitting(slot);
    }
    match &mut inner.children[slot].1 {
        sub if lone_leaf(sub).is_none() => {}
        Sub::InnerNode(over) => set(over, 0, (code, is_loose)),
        _ => {}
    }
}

#[cfg(test)]
#[path = "coverage_tests.rs"]
mod tests;
