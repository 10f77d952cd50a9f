//! How many of the rays that enter a cell's region, its box inside of its slabs, pass what it holds.
//!
//! Lines through the region, uniform over all of them, are asked of the triangles below: no cell's share is made of
//! those of its pieces. Two things are beside the cell:
//!
//! - A cell of a closed wall must let nothing through, however ragged the piece of the wall in it. So all cells of a
//!   treelet (see [`super::tree::TREELET`]) are **walls** if what they hold goes on beside them: of the lines that go
//!   steeply through a cell's first slab, or as near beside it as an eighth of its size ([`Region`]), and meet nothing
//!   in it, most find other surface as near again ([`FOUND`]). Measured, by treelets: 0.5 to 1 of them in spheres and a
//!   scan of a million triangles, 0.1 to 0.4 among plates, less than 0.2 among wires, less than 0.05 among leaf cards;
//!   in terrains of cubes anything.
//! - A line that passes a piece of a wire beside its end finds the next piece. As cells that overlap mostly decide
//!   alike about a ray (`trace::pass`), the next one would let it pass too. So a part of these lines counts as stopped:
//!   [`BESIDE`].
//!
//! All cells are tested with the same lines, turned by the position of the cell: an error by chance in one cell does
//! not repeat in the next. The result does not depend on the number of threads.
//!
//! Of a model of several chunks, cells over more than one of them and those right below a chunk's root (`join`) let
//! nothing pass; and what is near is sought in the chunk alone, so that at its ends fewer cells are walls of
//! themselves. (`tests/stability/awkward.rs`: closed meshes of several chunks stay closed all the same.)

use super::lines::{Line, Lines, NONE, Region, Set, numbers, put};
use super::refs::Ref;
use super::tree::{InnerNode, Piece, Place, Sub};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::lod::{OrientedSlabs, stop_bits};
use crate::math::Bounds;
use crate::simd::{Isa, Op, Simd, dispatch};
use crate::structure::bake::TreeInput;
use crate::structure::par::Par;

/// Through about so many of a treelet's cells lines are asked, a group through each,
const PROBES: usize = 16;
/// those that go through the slab at so much of a cosine.
const STEEP: f32 = 0.6;
/// Its cells are walls if so many of those that pass find other surface near,
const SURE: f32 = 0.7;
/// as soon as it is known of so many of these;
const ENOUGH: f32 = 16.0;
/// or, once a group was asked through each of them, so many. (Of the treelets of a Mandelbulb of a million all find 0.5
/// or more, 2 of 5,745 less than this, see [`agree`]. With 0.45 small steps in a terrain of cubes close, which
/// brightens it by 1.3 % at half a pixel of error, 1.7 % with shadows; now 0.7 and 1.0 %.)
const FOUND: f32 = 0.55;
/// How near, as a part of the cell's size: to cells in treelets, and to **larger** ones, which are those of nodes above
/// treelets and of each treelet's uppermost.
const NEAR: [f32; 2] = [0.125, 0.25];
/// How many of the lines that pass a cell, and find other surface near it, count as stopped: of leaves, of other nodes
/// in treelets, and of larger ones. (Coverage of two forests of wires at PoE 0.5, 1, 3 and 10, of six views that
/// farthest from 1: 0.02, 0.02, 0.03 and 0.03 off, and 0.05, 0.04, 0.02 and 0.04. Plates need fewer, wires as many: so
/// leaves go by their treelet.)
const BESIDE: Beside = Beside { of_nodes: 0.5, of_larger: 0.75, of_leaves: 2.0 };
/// In so many nodes and leaves what is near a line is sought.
const SEEK: usize = 64;
/// Of a group of lines those of which it is asked what is near.
const HALF: u8 = 0b0101_0101;
/// Groups of eight lines through a cell in a treelet, and through a larger one; of half of the lines of the first of
/// these, or of a quarter of them, it is asked what is near.
const LINES: [usize; 2] = [4, 16];
/// A larger cell that stops no more than this share of its lines is sampled [`ROUNDS`] times.
const SPARSE: f32 = 0.5;
/// See [`SPARSE`].
const ROUNDS: usize = 4;

/// See [`BESIDE`].
#[derive(Clone, Copy)]
struct Beside {
    of_nodes: f32,
    of_larger: f32,
    /// Of leaves so many times the share of the lines beside their treelet's cells that find other surface near: few
    /// among plates and cards, more along wires.
    of_leaves: f32,
}

/// What lines meet.
struct Scene<'a> {
    pieces: &'a [Piece],
    input: TreeInput<'a>,
    refs: &'a [Ref],
    beside: Beside,
}

/// A cell that is asked about.
#[derive(Clone, Copy)]
struct Cell<'a> {
    bounds: Bounds,
    slabs: OrientedSlabs<f32>,
    sub: &'a Sub,
}

/// Works out how many rays all cells below `pieces` stop, the same with any vectors. Fails only with
/// [`crate::Error::Cancelled`].
pub fn mark(pieces: &mut [Piece], input: TreeInput, refs: &[Ref], isa: Isa, par: &Par, cancel: &Cancel) -> Result<()> {
    mark_with(BESIDE, pieces, input, refs, isa, par, cancel)
}

fn mark_with(
    beside: Beside,
    pieces: &mut [Piece],
    input: TreeInput,
    refs: &[Ref],
    isa: Isa,
    par: &Par,
    cancel: &Cancel,
) -> Result<()> {
    let scene = Scene { pieces, input, refs, beside };
    let (mut treelets, mut large) = (vec![], vec![]);
    inners(pieces).for_each(|inner| gather_treelets(inner, &mut treelets));
    let known = par.map(treelets.len(), |i| {
        cancel.check()?;
        Ok(dispatch(isa, OfTreelet { scene: &scene, treelet: treelets[i] }))
    });
    let mut known = known.into_iter().collect::<Result<Vec<_>>>()?;
    let mut next = known.iter_mut();
    inners(pieces).for_each(|inner| agree(inner, &mut next));
    let mut next = known.iter();
    inners(pieces).for_each(|inner| {
        gather_large(inner, None, &mut next, &mut large);
    });
    let codes = par.map(large.len(), |i| {
        cancel.check()?;
        Ok(large[i].map_or(0, |(cell, above)| dispatch(isa, OfLarge { scene: &scene, cell, above })))
    });
    let codes = codes.into_iter().collect::<Result<Vec<_>>>()?;
    let (mut known, mut codes) = (known.into_iter(), codes.into_iter());
    for piece in pieces {
        if let Sub::InnerNode(inner) = &mut piece.sub {
            apply(inner, &mut known, &mut codes);
        }
    }
    debug_assert!(known.len() == 0 && codes.len() == 0, "each was handed to its own");
    Ok(())
}

fn inners(pieces: &[Piece]) -> impl Iterator<Item = &InnerNode> {
    pieces.iter().filter_map(|p| if let Sub::InnerNode(inner) = &p.sub { Some(&**inner) } else { None })
}

/// A treelet: neighbours in one node, and all below them.
#[derive(Clone, Copy)]
struct Treelet<'a> {
    inner: &'a InnerNode,
    /// The neighbours, first and end.
    slots: [usize; 2],
}

impl<'a> Treelet<'a> {
    /// Its cells, in their order, but for its uppermost nodes', which are asked as larger ones.
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

/// The children of a node, those of a treelet together: first and end.
fn runs(inner: &InnerNode) -> Vec<[usize; 2]> {
    let mut end = 0;
    let run = |run: &[Place]| {
        end += run.len();
        [end - run.len(), end]
    };
    inner.places[..inner.children.len()].chunk_by(|_, next| *next == Place::GoesOn).map(run).collect()
}

/// A child that is larger than treelets.
fn above_treelets(inner: &InnerNode, slot: usize) -> Option<&InnerNode> {
    match &inner.children[slot].1 {
        Sub::InnerNode(below) if inner.places[slot] == Place::Above => Some(below),
        _ => None,
    }
}

/// The treelets below a node, in their order.
fn gather_treelets<'a>(inner: &'a InnerNode, out: &mut Vec<Treelet<'a>>) {
    for slots in runs(inner) {
        match above_treelets(inner, slots[0]) {
            Some(below) => gather_treelets(below, out),
            None => out.push(Treelet { inner, slots }),
        }
    }
}

/// Of treelets in one node all are walls if those with half of their cells or more are: a small piece of a wall, at a
/// corner of it, may look otherwise. (Two of a Mandelbulb of a million do. One of them was a hole of one pixel where
/// three quarters had to agree. One that is alone in its node decides alone: beside a wall there may be a wire.)
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
        here.iter_mut().for_each(|known| known.codes.clear());
    }
}

/// Of all larger cells, in their order, those to be asked; nothing for those of whose cells a quarter or more are
/// walls. How many cells are below, and how many of these are walls.
fn gather_large<'a>(
    inner: &'a InnerNode,
    above: Option<&'a InnerNode>,
    treelets: &mut std::slice::Iter<Known>,
    out: &mut Vec<Large<'a>>,
) -> [usize; 2] {
    let (mut sums, all) = ([0; 2], cells(inner).collect::<Vec<_>>());
    for slots in runs(inner) {
        let at = out.len();
        out.extend(
            (slots[0]..slots[1])
                .filter(|slot| matches!(all[*slot].sub, Sub::InnerNode(_)))
                .map(|slot| Some((all[slot], above))),
        );
        let end = out.len();
        let counts = match above_treelets(inner, slots[0]) {
            Some(below) => gather_large(below, Some(inner), treelets, out),
            // They come in the same order: there is one for each.
            None => treelets.next().map_or([0; 2], |known| [known.cells, known.of_walls()]),
        };
        if 4 * counts[1] >= counts[0] {
            out[at..end].fill(None);
        }
        sums = [sums[0] + counts[0], sums[1] + counts[1]];
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

/// The leaf that a node was put over ([`super::tree::wrap_leaves`]): its cell is that leaf's, asked once for both.
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

/// Of all cells below, in their order.
fn all_cells<'a>(inner: &'a InnerNode, out: &mut Vec<Cell<'a>>) {
    for cell in cells(inner) {
        out.push(cell);
        if let Sub::InnerNode(below) = cell.sub {
            all_cells(below, out);
        }
    }
}

/// What is known of a treelet's cells.
struct Known {
    /// How many there are.
    cells: usize,
    /// A code for each, in their order; none if all are walls.
    codes: Vec<u8>,
}

impl Known {
    /// How many of its cells are walls.
    fn of_walls(&self) -> usize {
        if self.codes.is_empty() { self.cells } else { 0 }
    }
}

/// Finds the codes of a treelet.
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
        let (mut sums, walls) = (Asked::default(), Known { cells: all.len(), codes: Vec::new() });
        // One is left for what is asked further.
        let (groups, step) = (PROBES.div_ceil(all.len()).min(PROBES - 1), (all.len() / PROBES).max(1));
        // A quarter of them at a time, from all over the treelet: of most of a scan the first are enough.
        for quarter in 0..4 {
            for cell in all.iter().skip(quarter * step).step_by(4 * step) {
                sums.add(asker.beside(s, cell, [0, groups]));
            }
            if (sums.sought >= ENOUGH || quarter == 3) && sums.is_wall(SURE) {
                return walls;
            }
        }
        // By chance not, perhaps: the more is looked at.
        for cell in &all {
            sums.add(asker.beside(s, cell, [groups, groups + 1]));
        }
        if sums.is_wall(FOUND) {
            return walls;
        }
        let of_leaves = (scene.beside.of_leaves * sums.near()).min(1.0);
        let mut code = |cell: &Cell| {
            let beside = if matches!(cell.sub, Sub::InnerNode(_)) { scene.beside.of_nodes } else { of_leaves };
            asker.together(s, cell, LINES[0]).code(beside)
        };
        Known { codes: all.iter().map(&mut code).collect(), ..walls }
    }
}

/// A larger cell that is to be asked, and what its node hangs in, if that is no piece.
type Large<'a> = Option<(Cell<'a>, Option<&'a InnerNode>)>;

/// The code of a cell that is larger.
struct OfLarge<'a> {
    scene: &'a Scene<'a>,
    cell: Cell<'a>,
    above: Option<&'a InnerNode>,
}

impl Op for OfLarge<'_> {
    type Out = u8;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> u8 {
        let Self { scene, cell, above } = self;
        let (mut region, mut asker, mut sums) = (cell.region(), Asker::new(scene, above), Asked::default());
        for _ in 0..ROUNDS {
            sums.add(asker.alone(s, cell.sub, &region, LINES[1], LINES[1] / 4));
            if sums.stops(scene.beside.of_larger) > SPARSE {
                break;
            }
            region.go_on();
        }
        sums.code(scene.beside.of_larger)
    }
}

/// Of the lines through a cell's region, some looked at.
#[derive(Clone, Copy, Default)]
struct Asked {
    /// How many there are, in some unit.
    all: f32,
    /// How many of these pass what it holds.
    transmitted: f32,
    /// Of how many of those it was asked whether they find other surface near it.
    sought: f32,
    /// How many do.
    found: f32,
}

impl Asked {
    fn add(&mut self, o: Self) {
        (self.all, self.transmitted) = (self.all + o.all, self.transmitted + o.transmitted);
        (self.sought, self.found) = (self.sought + o.sought, self.found + o.found);
    }

    /// Where no line passes there is nothing to be let through; not so if there was no line.
    fn is_wall(&self, least: f32) -> bool {
        self.all > 0.0 && self.found >= least * self.sought
    }

    /// Of those that pass, the share that finds other surface near.
    fn near(&self) -> f32 {
        self.found / self.sought.max(f32::MIN_POSITIVE)
    }

    /// The share of them that counts as stopped.
    fn stops(&self, beside: f32) -> f32 {
        1.0 - self.transmitted * (1.0 - beside * self.near()) / self.all.max(f32::MIN_POSITIVE)
    }

    /// The stop code, see [`stop_bits`].
    fn code(&self, beside: f32) -> u8 {
        let stops = self.stops(beside);
        // The greatest stops all, as no code does; and so does what is too small for single precision.
        if stops.is_finite() { (stops.max(0.0).sqrt() * 63.0).round().max(1.0) as u8 % 63 } else { 0 }
    }
}

/// Asks lines through cells.
struct Asker<'a> {
    scene: &'a Scene<'a>,
    /// Below this what is near is sought first.
    above: Option<&'a InnerNode>,
    lines: Lines,
    triangles: Vec<u32>,
    stack: Vec<&'a Sub>,
}

impl<'a> Asker<'a> {
    fn new(scene: &'a Scene<'a>, above: Option<&'a InnerNode>) -> Self {
        Self { scene, above, lines: Lines::new(), triangles: Vec::new(), stack: Vec::new() }
    }

    /// Asks the lines of so many groups, each alone, down the tree; and of the first `seek` of these groups what is
    /// near.
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

    /// Asks `groups` (first, end) of the lines that go through a cell or near beside it, if they do so steeply; and of
    /// all that meet nothing in it what is near.
    #[inline(always)]
    fn beside<S: Simd>(&mut self, s: S, cell: &Cell<'a>, groups: [usize; 2]) -> Asked {
        let region = Region::around(&cell.bounds, &cell.slabs, NEAR[0]);
        self.lines.through(s, &region, groups);
        // Else a few short ones through the smallest cells outweigh all others.
        self.lines.weigh_alike();
        self.lines.keep_steep(s, &region, STEEP);
        let transmitted = self.pass_all(s, cell);
        self.asked(s, &transmitted, transmitted.len(), 0xff, region.size * NEAR[0])
    }

    /// Those of the lines that meet none of the triangles in a cell, of which there are few.
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

    /// Asks the lines of so many groups together about each of the triangles in a cell, of which there are few; and of
    /// the first group what is near.
    #[inline(always)]
    fn together<S: Simd>(&mut self, s: S, cell: &Cell, groups: usize) -> Asked {
        let region = cell.region();
        self.lines.through(s, &region, [0, groups]);
        let transmitted = self.pass_all(s, cell);
        self.asked(s, &transmitted, 1, HALF, region.size * NEAR[0])
    }

    /// What there is to be said of lines of which some passed; `some` of each of the first groups are asked if they
    /// meet anything in the chunk on their ways, each longer by `near` at both ends: first below `above`, where mostly
    /// it is. (Nowhere else: closed spheres and rooms have holes, for what is beside the cells at its ends is not
    /// found.)
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
        let weight = |set| self.lines.weight(set);
        Asked {
            all: weight(&self.lines.all),
            transmitted: weight(transmitted),
            sought: weight(&sought),
            found: weight(&found),
        }
    }
}

impl<'a> Scene<'a> {
    /// Whether a line meets a triangle below those on the stack, which is left empty: in the first `at_most` nodes and
    /// leaves that it crosses.
    #[inline(always)]
    fn meets<S: Simd>(&self, s: S, line: &Line, at_most: usize, stack: &mut Vec<&'a Sub>) -> bool {
        let mut left = at_most;
        while let Some(sub) = stack.pop() {
            if left == 0 {
                stack.clear();
                return false;
            }
            left -= 1;
            match sub {
                Sub::Leaf { first, count, .. } => {
                    for r in self.refs(*first, *count) {
                        if line.crosses(r) && line.meets(s, &self.input.triangles[r.triangle()]) {
                            stack.clear();
                            return true;
                        }
                    }
                }
                Sub::InnerNode(inner) => {
                    push_crossed(s, line, inner, stack);
                }
                Sub::Placed(_) => {}
            }
        }
        false
    }

    fn refs(&self, first: u32, count: u32) -> &[Ref] {
        &self.refs[first as usize..(first + count) as usize]
    }

    /// The triangles below.
    fn below(&self, sub: &Sub, out: &mut Vec<u32>) {
        match sub {
            Sub::Leaf { first, count, .. } => out.extend(self.refs(*first, *count).iter().map(|r| r.triangle() as u32)),
            Sub::InnerNode(inner) => inner.children.iter().for_each(|(_, sub)| self.below(sub, out)),
            Sub::Placed(_) => {}
        }
    }
}

/// Puts the children whose boxes a line crosses onto the stack.
#[inline(always)]
fn push_crossed<'a, S: Simd>(s: S, line: &Line, inner: &'a InnerNode, stack: &mut Vec<&'a Sub>) {
    let mut met = line.boxes(s, &inner.node);
    while met != 0 {
        let slot = met.trailing_zeros() as usize;
        met &= met - 1;
        stack.extend(inner.children.get(slot).map(|(_, sub)| sub));
    }
}

/// Hands codes to cells, in the order in which they were gathered.
fn apply(inner: &mut InnerNode, treelets: &mut std::vec::IntoIter<Known>, large: &mut std::vec::IntoIter<u8>) {
    for slots in runs(inner) {
        let is_clump = above_treelets(inner, slots[0]).is_none();
        let known = if is_clump { treelets.next() } else { None };
        let mut codes = known.map_or_else(Vec::new, |known| known.codes).into_iter();
        for slot in slots[0]..slots[1] {
            if is_leaf(&inner.children[slot].1) {
                set(inner, slot, codes.next().unwrap_or(0));
                continue;
            }
            set(inner, slot, large.next().unwrap_or(0));
            match &mut inner.children[slot].1 {
                Sub::InnerNode(below) if is_clump => apply_all(below, &mut codes),
                Sub::InnerNode(below) => apply(below, treelets, large),
                _ => {}
            }
        }
        debug_assert!(codes.len() == 0, "each of a treelet's codes is handed to its cell");
    }
}

fn apply_all(inner: &mut InnerNode, codes: &mut std::vec::IntoIter<u8>) {
    for slot in 0..inner.children.len() {
        let Some(code) = codes.next() else { return };
        set(inner, slot, code);
        match &mut inner.children[slot].1 {
            sub if is_leaf(sub) => {}
            Sub::InnerNode(below) => apply_all(below, codes),
            _ => {}
        }
    }
}

/// Itself, or with a node of its own over it.
fn is_leaf(sub: &Sub) -> bool {
    matches!(sub, Sub::Leaf { .. }) || lone_leaf(sub).is_some()
}

fn set(inner: &mut InnerNode, slot: usize, code: u8) {
    if code > 0 {
        inner.children[slot].0.words[0] |= stop_bits(code);
        inner.node.set_transmitting(slot);
    }
    match &mut inner.children[slot].1 {
        sub if lone_leaf(sub).is_none() => {}
        Sub::InnerNode(over) => set(over, 0, code),
        _ => {}
    }
}

#[cfg(test)]
#[path = "coverage_tests.rs"]
mod tests;
