//! How many of the rays that enter a cell's region, its box inside of its slabs, pass what it holds.
//!
//! Lines through the region, uniform over all of them, are asked of the triangles below. (So cells as large as may be are right as well
//! as small ones: nothing is made of what was found for their pieces.) Two things are beside the cell:
//!
//! - A cell of a closed wall must let nothing through, however ragged the piece of the wall in it. So all cells of a small subtree are
//!   **walls** if what they hold goes on beside them: of the lines that go steeply through a cell's first slab, or as near beside it as an
//!   eighth of its diagonal, and meet nothing in it, most find other surface as near again ([`FOUND`]). Measured, over small subtrees, but for one
//!   in a hundred: 0.5 to 1 of them in spheres and scans, 0.1 to 0.5 in a terrain of cubes, 0.1 to 0.4 among machine parts, 0 to 0.2 among
//!   wires and leaf cards. (Of all lines, which mostly run along a wall, and through the cells alone, which hardly any line passes: 0.8 to 1, and 0.1
//!   to 0.5 among wires. So cells of single wires were walls, and so were lone boxes, with all cells above them, while curved walls of few triangles
//!   were none.) Of most of a scan no more is worked out than that.
//! - A line that passes a piece of a wire beside its end finds the next piece. As cells that overlap mostly decide alike about a ray
//!   (`trace::pass`), the next one would let it pass too. So a part of these lines counts as stopped: [`BESIDE`].
//!
//! The same lines for all cells, turned by where the cell is: what is off by chance in one cell is not in the next. Nothing depends on
//! the number of threads.
//!
//! Of a model of several chunks, cells over more than one of them and those right below a chunk's root (`join`) let nothing pass; and what is
//! near is sought in the chunk alone, so that at its ends fewer cells are walls of themselves. (`tests/stability/awkward.rs`: closed meshes of
//! several chunks stay closed all the same.)

use super::TreeInput;
use super::lines::{Line, Lines, NONE, Region, Set, numbers, put};
use super::par::Par;
use super::refs::Ref;
use super::tree::{Inner, Piece, Sub};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::lod::{Slabs, stop_bits};
use crate::math::Bounds;
use crate::simd::{Isa, Op, Simd, dispatch};
use std::collections::HashMap;

/// A subtree of at most so many references is looked at as a whole first.
const SMALL: u64 = 256;
/// Through so many of its cells at least lines are asked, a group through each,
const PROBES: usize = 16;
/// those that go through the slab at so much of a cosine.
const STEEP: f32 = 0.6;
/// Its cells are walls if so many of those that pass find other surface near,
const SURE: f32 = 0.65;
/// or, once a group was asked through each of them, so many.
const FOUND: f32 = 0.45;
/// How near, as a part of the cell's diagonal.
const NEAR: f32 = 0.125;
/// How many of the lines that pass a cell, and find other surface near it, count as stopped: of small subtrees' cells, and of larger ones.
/// (Coverage of a forest of wires at PoE 0.5, 3 and 10, of six views that farthest from 1: as it is 1.02, 0.99 and 0.97; with 0.5 and 0.5 0.98,
/// 0.95 and 0.96, with 0.8 and 0.8 1.07, 1.04 and 1.02, both of twice as many lines. Of another forest 1.05, 1.05 and 1.10; with 0.55 and 0.9 1.06,
/// 1.06 and 1.11. Leaf cards hardly care.)
const BESIDE: [f32; 2] = [0.5, 0.75];
/// In so many nodes and leaves what is near a line is sought. (Half and twice as many: the same coverage of wires and leaf cards.)
const SEEK: usize = 64;
/// Of a group of lines those of which it is asked what is near.
const HALF: u8 = 0b0101_0101;
/// Groups of eight lines through a cell of a small subtree, and through a larger one; of half of the lines of the first of these, or of a
/// quarter of them, it is asked what is near. (With twice as many of the first, 1 % less of the coverage of wires, and builds of CAD a tenth slower.)
const LINES: [usize; 2] = [4, 16];
/// A larger cell that stops no more than this is asked about again,
const SPARSE: f32 = 0.5;
/// so many times in all. (At PoE 10 few cells are in view: after one time wires had 1.04 of their coverage in one view of two.)
const ROUNDS: usize = 4;

/// What lines meet.
struct Scene<'a> {
    pieces: &'a [Piece],
    input: TreeInput<'a>,
    refs: &'a [Ref],
}

/// A cell that is asked about.
#[derive(Clone, Copy)]
struct Cell<'a> {
    bounds: Bounds,
    slabs: Slabs<f32>,
    sub: &'a Sub,
}

/// Works out how many rays all cells below `pieces` stop, the same with any vectors. Fails only with [`crate::Error::Cancelled`].
pub fn mark(pieces: &mut [Piece], input: TreeInput, refs: &[Ref], isa: Isa, par: &Par, cancel: &Cancel) -> Result<()> {
    let scene = Scene { pieces, input, refs };
    let (mut small, mut nodes) = (Vec::new(), 0);
    pieces.iter().for_each(|p| gather_small(&p.sub, (None, 0), &mut nodes, &mut small));
    let codes = par.map(small.len(), |i| {
        cancel.check()?;
        Ok(dispatch(isa, OfSmall { scene: &scene, small: small[i] }))
    });
    let mut codes = codes.into_iter().collect::<Result<Vec<_>>>()?;
    agree(&small, &mut codes);
    let mut large = Vec::new();
    let mut next = codes.iter();
    for piece in pieces.iter() {
        if let Sub::Inner(inner) = &piece.sub {
            gather_large(inner, None, &mut next, &mut large);
        }
    }
    let of_large = par.map(large.len(), |i| {
        cancel.check()?;
        Ok(large[i].map_or(0, |(cell, above)| dispatch(isa, OfLarge { scene: &scene, cell, above })))
    });
    let of_large = of_large.into_iter().collect::<Result<Vec<_>>>()?;
    let (mut of_small, mut of_large) = (codes.into_iter(), of_large.into_iter());
    for piece in pieces {
        if let Sub::Inner(inner) = &mut piece.sub {
            apply(inner, &mut of_small, &mut of_large);
        }
    }
    Ok(())
}

/// One of the largest subtrees of at most [`SMALL`] references.
#[derive(Clone, Copy)]
struct Small<'a> {
    inner: &'a Inner,
    /// The node that it hangs in, if it is no piece.
    above: Option<&'a Inner>,
    /// That node's number.
    number: usize,
}

/// The largest subtrees of at most [`SMALL`] references, in their order.
fn gather_small<'a>(sub: &'a Sub, (above, number): (Option<&'a Inner>, usize), nodes: &mut usize, out: &mut Vec<Small<'a>>) {
    if let Sub::Inner(inner) = sub {
        if is_small(inner) {
            out.push(Small { inner, above, number });
        } else {
            *nodes += 1;
            let here = (Some(&**inner), *nodes);
            inner.children.iter().for_each(|(_, c)| gather_small(c, here, nodes, out));
        }
    }
}

/// Of small subtrees that hang in one node all are walls if most are: a small piece of a wall, at a corner of it, may look otherwise.
fn agree(small: &[Small], known: &mut [Known]) {
    let mut cells: HashMap<usize, (usize, usize)> = HashMap::new();
    for (small, known) in small.iter().zip(known.iter()) {
        let sums = cells.entry(small.number).or_default();
        *sums = (sums.0 + known.cells, sums.1 + known.of_walls());
    }
    for (small, known) in small.iter().zip(known) {
        let (all, of_walls) = cells[&small.number];
        if 4 * of_walls >= 3 * all {
            known.codes.clear();
        }
    }
}

/// The cells above small subtrees, in their order; nothing for those of whose cells a quarter or more are walls, and for leaves beside such.
/// How many cells are below, and how many of these are walls.
fn gather_large<'a>(inner: &'a Inner, above: Option<&'a Inner>, small: &mut std::slice::Iter<Known>, out: &mut Vec<Large<'a>>) -> [usize; 2] {
    if is_small(inner) {
        // They come in the same order: there is one for each.
        return small.next().map_or([0; 2], |known| [known.cells, known.of_walls()]);
    }
    let (mut sums, mut leaves) = ([0; 2], Vec::new());
    let ask = |cell, [all, of_walls]: [usize; 2]| (4 * of_walls < all).then_some((cell, above));
    for cell in cells(inner) {
        let at = out.len();
        out.push(None);
        let Sub::Inner(below) = cell.sub else {
            leaves.push((at, cell));
            continue;
        };
        let counts = gather_large(below, Some(inner), small, out);
        out[at] = ask(cell, counts);
        sums = [sums[0] + counts[0], sums[1] + counts[1]];
    }
    for (at, cell) in leaves {
        // Beside nothing but leaves there are no walls.
        out[at] = ask(cell, [sums[0].max(1), sums[1]]);
    }
    sums
}

fn is_small(inner: &Inner) -> bool {
    inner.references <= SMALL
}

fn cells(inner: &Inner) -> impl Iterator<Item = Cell<'_>> {
    let all = inner.children.iter().enumerate();
    all.map(|(slot, (_, sub))| Cell { bounds: inner.node.stored_box(slot), slabs: inner.node.stored_slabs(slot), sub })
}

impl Cell<'_> {
    fn region(&self) -> Region {
        Region::around(&self.bounds, &self.slabs, 0.0)
    }
}

/// Of all cells below, in their order.
fn all_cells<'a>(inner: &'a Inner, out: &mut Vec<Cell<'a>>) {
    for cell in cells(inner) {
        out.push(cell);
        if let Sub::Inner(below) = cell.sub {
            all_cells(below, out);
        }
    }
}

/// What is known of the cells of a small subtree.
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

/// Finds the codes of a small subtree.
struct OfSmall<'a> {
    scene: &'a Scene<'a>,
    small: Small<'a>,
}

impl Op for OfSmall<'_> {
    type Out = Known;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Known {
        let Self { scene, small: Small { inner, above, .. } } = self;
        let (mut all, mut asked, mut asker) = (Vec::new(), Vec::new(), Asker::new(scene, above));
        all_cells(inner, &mut all);
        let (mut sums, walls) = (Asked::default(), Known { cells: all.len(), codes: Vec::new() });
        let groups = PROBES.div_ceil(all.len());
        for cell in all.iter().step_by((all.len() / PROBES).max(1)) {
            sums.add(asker.beside(s, cell, [0, groups]));
        }
        if sums.is_wall(SURE) {
            return walls;
        }
        // By chance not, perhaps: the more is looked at.
        for cell in &all {
            sums.add(asker.beside(s, cell, [groups, groups + 1]));
        }
        if sums.is_wall(FOUND) {
            return walls;
        }
        for cell in &all {
            asked.push(asker.together(s, cell, LINES[0]));
        }
        Known { codes: asked.iter().map(|asked| asked.code(BESIDE[0])).collect(), ..walls }
    }
}

/// A larger cell that is to be asked, and what its node hangs in, if that is no piece.
type Large<'a> = Option<(Cell<'a>, Option<&'a Inner>)>;

/// The code of a cell that is larger.
struct OfLarge<'a> {
    scene: &'a Scene<'a>,
    cell: Cell<'a>,
    above: Option<&'a Inner>,
}

impl Op for OfLarge<'_> {
    type Out = u8;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> u8 {
        let Self { scene, cell, above } = self;
        let (mut region, mut asker, mut sums) = (cell.region(), Asker::new(scene, above), Asked::default());
        for _ in 0..ROUNDS {
            sums.add(asker.alone(s, cell.sub, &region, LINES[1], LINES[1] / 4));
            if sums.stops(BESIDE[1]) > SPARSE {
                break;
            }
            region.go_on();
        }
        sums.code(BESIDE[1])
    }
}

/// Of the lines through a cell's region, some looked at.
#[derive(Clone, Copy, Default)]
struct Asked {
    /// How many there are, in some unit.
    all: f32,
    /// How many of these pass what it holds.
    passed: f32,
    /// Of how many of those it was asked whether they find other surface near it.
    sought: f32,
    /// How many do.
    found: f32,
}

impl Asked {
    fn add(&mut self, o: Self) {
        (self.all, self.passed) = (self.all + o.all, self.passed + o.passed);
        (self.sought, self.found) = (self.sought + o.sought, self.found + o.found);
    }

    /// Where no line passes there is nothing to be let through; not so if there was no line.
    fn is_wall(&self, least: f32) -> bool {
        self.all > 0.0 && self.found >= least * self.sought
    }

    /// The share of them that counts as stopped.
    fn stops(&self, beside: f32) -> f32 {
        let found = self.found / self.sought.max(f32::MIN_POSITIVE);
        1.0 - self.passed * (1.0 - beside * found) / self.all.max(f32::MIN_POSITIVE)
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
    above: Option<&'a Inner>,
    lines: Lines,
    triangles: Vec<u32>,
    stack: Vec<&'a Sub>,
}

impl<'a> Asker<'a> {
    fn new(scene: &'a Scene<'a>, above: Option<&'a Inner>) -> Self {
        Self { scene, above, lines: Lines::new(), triangles: Vec::new(), stack: Vec::new() }
    }

    /// Asks the lines of so many groups, each alone, down the tree; and of the first `seek` of these groups what is near.
    #[inline(always)]
    fn alone<S: Simd>(&mut self, s: S, sub: &'a Sub, region: &Region, groups: usize, seek: usize) -> Asked {
        self.lines.through(s, region, [0, groups]);
        let mut passed = NONE;
        for i in numbers(self.lines.all) {
            self.stack.push(sub);
            put(&mut passed, i, !self.scene.meets(s, &self.lines.one(i, 0.0), usize::MAX, &mut self.stack));
        }
        self.asked(s, &passed, seek, HALF, region.diagonal * NEAR)
    }

    /// Asks `groups` (first, end) of the lines that go through a cell or near beside it, if they do so steeply; and of all that meet
    /// nothing in it what is near.
    #[inline(always)]
    fn beside<S: Simd>(&mut self, s: S, cell: &Cell<'a>, groups: [usize; 2]) -> Asked {
        let region = Region::around(&cell.bounds, &cell.slabs, NEAR);
        self.lines.through(s, &region, groups);
        self.lines.keep_steep(s, &region, STEEP);
        let passed = self.pass_all(s, cell);
        self.asked(s, &passed, passed.len(), 0xff, region.diagonal * NEAR)
    }

    /// Those of the lines that meet none of the triangles in a cell, of which there are few.
    #[inline(always)]
    fn pass_all<S: Simd>(&mut self, s: S, cell: &Cell) -> Set {
        self.triangles.clear();
        self.scene.below(cell.sub, &mut self.triangles);
        let mut passed = self.lines.all;
        for triangle in &self.triangles {
            if !self.lines.leave(s, &mut passed, &self.scene.input.triangles[*triangle as usize]) {
                break;
            }
        }
        passed
    }

    /// Asks the lines of so many groups together about each of the triangles in a cell, of which there are few; and of the first group what
    /// is near.
    #[inline(always)]
    fn together<S: Simd>(&mut self, s: S, cell: &Cell, groups: usize) -> Asked {
        let region = cell.region();
        self.lines.through(s, &region, [0, groups]);
        let passed = self.pass_all(s, cell);
        self.asked(s, &passed, 1, HALF, region.diagonal * NEAR)
    }

    /// What there is to be said of lines of which some passed; `some` of each of the first groups are asked if they meet anything in the
    /// chunk on their ways, each longer by `near` at both ends: first below `above`, where mostly it is. (Nowhere else: closed spheres and
    /// rooms have holes, for what is beside the cells at its ends is not found.)
    #[inline(always)]
    fn asked<S: Simd>(&mut self, s: S, passed: &Set, groups: usize, some: u8, near: f32) -> Asked {
        let (mut sought, mut found) = (NONE, NONE);
        for group in 0..groups {
            sought[group] = passed[group] & some;
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
        Asked { all: weight(&self.lines.all), passed: weight(passed), sought: weight(&sought), found: weight(&found) }
    }
}

impl<'a> Scene<'a> {
    /// Whether a line meets a triangle below those on the stack, which is left empty: in the first `at_most` nodes and leaves that it crosses.
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
                Sub::Inner(inner) => {
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
            Sub::Inner(inner) => inner.children.iter().for_each(|(_, sub)| self.below(sub, out)),
            Sub::Placed(_) => {}
        }
    }
}

/// Puts the children whose boxes a line crosses onto the stack.
#[inline(always)]
fn push_crossed<'a, S: Simd>(s: S, line: &Line, inner: &'a Inner, stack: &mut Vec<&'a Sub>) {
    let mut met = line.boxes(s, &inner.node);
    while met != 0 {
        let slot = met.trailing_zeros() as usize;
        met &= met - 1;
        stack.extend(inner.children.get(slot).map(|(_, sub)| sub));
    }
}

/// Hands codes to cells, in the order in which they were gathered.
fn apply(inner: &mut Inner, small: &mut std::vec::IntoIter<Known>, large: &mut std::vec::IntoIter<u8>) {
    if is_small(inner) {
        apply_all(inner, &mut small.next().map_or_else(Vec::new, |small| small.codes).into_iter());
        return;
    }
    for slot in 0..inner.children.len() {
        set(inner, slot, large.next().unwrap_or(0));
        if let Sub::Inner(below) = &mut inner.children[slot].1 {
            apply(below, small, large);
        }
    }
}

fn apply_all(inner: &mut Inner, codes: &mut std::vec::IntoIter<u8>) {
    for slot in 0..inner.children.len() {
        let Some(code) = codes.next() else { return };
        set(inner, slot, code);
        if let Sub::Inner(below) = &mut inner.children[slot].1 {
            apply_all(below, codes);
        }
    }
}

fn set(inner: &mut Inner, slot: usize, code: u8) {
    if code > 0 {
        inner.children[slot].0.words[0] |= stop_bits(code);
        inner.node.may_pass(slot);
    }
}

#[cfg(test)]
#[path = "pass_tests.rs"]
mod tests;
