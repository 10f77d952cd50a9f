//! Samples what is seen of each cell's region from outside, where the region holds surface of other parts too.
//!
//! The look of a cell is first composited from the samples of its own triangles (`lod::Voxel`). Where surfaces of
//! several parts lie in one region, such as the ribs and the skin of a hull, lines through the region decide what the
//! cell shows from which direction: the surface that they meet first, of all surface in the region (`lod::Curtain`).
//! Sources: Áfra 2012, section 4.2; Wald and others 2004, section 5.3.
//!
//! Cells of few references test all lines against lists of the references in their regions, which get shorter from node
//! to node. Larger cells follow each line through the tree. See-through parts hide nothing: lines pass them. Lines are
//! traced in one chunk: cells over several chunks show what their children show. The result does not depend on the
//! number of threads.

use super::content::push_crossed;
use super::coverage::inners;
use super::lines::{Ends, Lines, Region, numbers};
use super::refs::Ref;
use super::tree::{InnerNode, Piece, Sub};
use crate::base::error::Result;
use crate::base::progress::Stretch;
use crate::lod::{Coded, FirstHit, hang_curtains};
use crate::math::Bounds;
use crate::simd::{Isa, Op, Simd, dispatch};
use crate::structure::bake::TreeInput;
use crate::structure::par::Par;
use glam::Vec3;

/// Groups of eight lines that are tested first: if they meet one part only, the others are not tested.
const FIRST: usize = 3;
/// Groups of eight lines through a cell.
const GROUPS: usize = 8;
/// A cell is unclear if more than this share of its lines meet another part first than the one that it shows to them.
/// Unclear cells count with all of their area where they may stand in. (An airliner of a million triangles, whole, at
/// 10 and 30 pixels of error: 3.1 and 8.7 % of its pixels showed parts that are hidden there without this, 2.2 and 7.3
/// % with it; in the same time.)
const UNCLEAR: f32 = 0.1;
/// Greatest number of references of a cell that is sampled with a list of the references in its region.
const LISTED: u32 = 2048;

/// The geometry that lines are tested against.
#[derive(Clone, Copy)]
struct Scene<'a> {
    pieces: &'a [Piece],
    input: TreeInput<'a>,
    refs: &'a [Ref],
}

/// Cells that are sampled together.
#[derive(Clone, Copy)]
enum Work<'a> {
    /// All cells below a node.
    Below(&'a InnerNode),
    /// One child of a node, without the cells below it.
    Child(&'a InnerNode, usize),
}

/// What lines found out about a cell.
#[derive(Default)]
struct Found {
    /// New samples; `None` if those it has stay.
    voxel: Option<Coded>,
    /// True if no look of the cell would be right for many lines.
    is_unclear: bool,
}

/// Samples the cells below `pieces` where their regions hold surface of several parts. Fails only with
/// [`crate::Error::Cancelled`].
pub fn sample(pieces: &mut [Piece], input: TreeInput, refs: &[Ref], isa: Isa, par: &Par, work: &Stretch) -> Result<()> {
    if !input.has_several_parts() {
        return Ok(());
    }
    let scene = Scene { pieces, input, refs };
    let mut works = Vec::new();
    inners(pieces).for_each(|inner| gather(inner, &mut works));
    let done = work.part(0.0, 1.0, works.len() as u64);
    let found = par.map(works.len(), |i| {
        done.begin()?;
        Ok(dispatch(isa, Sample { scene, work: works[i] }))
    });
    let found = found.into_iter().collect::<Result<Vec<_>>>()?;
    let mut found = found.into_iter().flatten();
    for piece in pieces {
        if let Sub::InnerNode(inner) = &mut piece.sub {
            apply(inner, &mut found);
        }
    }
    debug_assert!(found.next().is_none(), "some samples were not assigned");
    Ok(())
}

/// Number of references below a node or leaf.
fn size(sub: &Sub) -> u32 {
    match sub {
        Sub::Leaf { count, .. } => *count,
        Sub::InnerNode(inner) => inner.children.iter().map(|(_, sub)| size(sub)).sum(),
        Sub::Placed(_) => 0,
    }
}

/// Divides the cells below a node into work, in the order of [`apply`].
fn gather<'a>(inner: &'a InnerNode, out: &mut Vec<Work<'a>>) {
    if inner.children.iter().map(|(_, sub)| size(sub)).sum::<u32>() <= LISTED {
        out.push(Work::Below(inner));
        return;
    }
    for (slot, (_, sub)) in inner.children.iter().enumerate() {
        out.push(Work::Child(inner, slot));
        if let Sub::InnerNode(below) = sub {
            gather(below, out);
        }
    }
}

/// Assigns samples to cells, each before those below it.
fn apply(inner: &mut InnerNode, found: &mut impl Iterator<Item = Found>) {
    for (slot, (voxel, sub)) in inner.children.iter_mut().enumerate() {
        let Found { voxel: new, is_unclear } = found.next().unwrap_or_default();
        if let Some(new) = new {
            *voxel = new;
        }
        if is_unclear {
            inner.node.clear_level(slot);
        }
        if let Sub::InnerNode(below) = sub {
            apply(below, found);
        }
    }
}

/// A reference in a region.
#[derive(Clone, Copy)]
struct Listed {
    low: Vec3,
    triangle: u32,
    high: Vec3,
    part: u32,
    /// The plane of its triangle: a normal of any length, and the product of it and the plane's points.
    normal: Vec3,
    at: f32,
}

impl Listed {
    /// True if the triangle's plane may cross a region, and its box too.
    #[inline(always)]
    fn may_be_in(&self, region: &Region) -> bool {
        let (middle, half) = (region.bounds.center(), region.bounds.extent() * 0.5);
        let reach = self.normal.abs().dot(half);
        // Rounding is small against the distances by which regions are enlarged; a normal may be zero or infinite.
        let is_apart = (self.normal.dot(middle) - self.at).abs() > reach * 1.001 + self.at.abs() * 1e-5;
        !is_apart && region.may_hold(self.low, self.high)
    }
}

struct Sample<'a> {
    scene: Scene<'a>,
    work: Work<'a>,
}

impl Op for Sample<'_> {
    type Out = Vec<Found>;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<Found> {
        let mut sampler =
            Sampler { scene: self.scene, lines: Lines::new(), stack: Vec::new(), hits: Vec::new(), out: Vec::new() };
        match self.work {
            Work::Below(inner) => {
                let bounds = (0..inner.children.len()).map(|slot| inner.node.stored_box(slot));
                let bounds = bounds.fold(Bounds::EMPTY, |all, b| all.union(b));
                let listed =
                    sampler.scene.listed(|low, high| low.cmple(bounds.max).all() && high.cmpge(bounds.min).all());
                sampler.below(s, inner, &listed);
            }
            Work::Child(inner, slot) if size(&inner.children[slot].1) <= LISTED => {
                let region = region(inner, slot);
                let mut listed = sampler.scene.listed(|low, high| region.may_hold(low, high));
                listed.retain(|r| r.may_be_in(&region));
                sampler.with_list(s, inner, slot, &region, &listed);
            }
            Work::Child(inner, slot) => sampler.large(s, inner, slot),
        }
        sampler.out
    }
}

fn region(inner: &InnerNode, slot: usize) -> Region {
    Region::around(&inner.node.stored_box(slot), &inner.node.stored_oriented_slabs(slot), 0.0)
}

impl Scene<'_> {
    /// Returns the references with boxes that `holds` accepts. It accepts all boxes around one that it accepts.
    fn listed(&self, holds: impl Fn(Vec3, Vec3) -> bool) -> Vec<Listed> {
        let (mut out, mut stack) = (Vec::new(), Vec::new());
        stack.extend(self.pieces.iter().map(|p| &p.sub));
        while let Some(sub) = stack.pop() {
            match sub {
                Sub::Leaf { first, count, .. } => {
                    for r in &self.refs[*first as usize..(first + count) as usize] {
                        let Bounds { min: low, max: high } = r.bounds();
                        let part = self.input.parts[r.triangle()];
                        if holds(low, high) && self.input.is_opaque(part) {
                            let triangle = r.triangle() as u32;
                            let [a, b, c] = self.input.triangles[r.triangle()];
                            let normal = (b - a).cross(c - a);
                            out.push(Listed { low, triangle, high, part, normal, at: normal.dot(a) });
                        }
                    }
                }
                Sub::InnerNode(inner) => {
                    for (slot, (_, sub)) in inner.children.iter().enumerate() {
                        let cell = inner.node.stored_box(slot);
                        if holds(cell.min, cell.max) {
                            stack.push(sub);
                        }
                    }
                }
                Sub::Placed(_) => {}
            }
        }
        out
    }

    fn first_hit(&self, triangle: u32, from: Vec3, weight: f32) -> FirstHit {
        let [a, b, c] = self.input.triangles[triangle as usize];
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let (colour, _) = self.input.colour(triangle as usize);
        FirstHit { from, weight, normal, colour, part: self.input.parts[triangle as usize] }
    }
}

struct Sampler<'a> {
    scene: Scene<'a>,
    lines: Lines,
    stack: Vec<&'a Sub>,
    hits: Vec<FirstHit>,
    out: Vec<Found>,
}

impl<'a> Sampler<'a> {
    /// Samples all cells below a node, given the references in its box.
    #[inline(always)]
    fn below<S: Simd>(&mut self, s: S, inner: &'a InnerNode, listed: &[Listed]) {
        // The nodes on the way down, each with its next slot and the references in its box.
        let mut open = vec![(inner, 0usize, listed.to_vec())];
        while let Some((inner, slot, listed)) = open.pop() {
            if slot >= inner.children.len() {
                continue;
            }
            let region = region(inner, slot);
            let here: Vec<Listed> = listed.iter().filter(|r| r.may_be_in(&region)).copied().collect();
            self.with_list(s, inner, slot, &region, &here);
            open.push((inner, slot + 1, listed));
            if let Sub::InnerNode(below) = &inner.children[slot].1 {
                // The regions of cells below may reach out of this one: boxes decide.
                let cell = inner.node.stored_box(slot);
                let (_, _, all) = &open[open.len() - 1];
                let inside = |r: &&Listed| r.low.cmple(cell.max).all() && r.high.cmpge(cell.min).all();
                let of_below = all.iter().filter(inside).copied().collect();
                open.push((below, 0, of_below));
            }
        }
    }

    /// Samples the child in `slot` with the references in its region.
    #[inline(always)]
    fn with_list<S: Simd>(&mut self, s: S, inner: &InnerNode, slot: usize, region: &Region, listed: &[Listed]) {
        let voxel = &inner.children[slot].0;
        let (part, is_mixed) = Coded::part(voxel.words[2]);
        // What is see-through hides nothing, and shows itself.
        let is_plain = !is_mixed && listed.iter().all(|r| r.part == part);
        if is_plain || !self.scene.input.is_opaque(part) {
            self.out.push(Found::default());
            return;
        }
        for groups in [[0, FIRST], [FIRST, GROUPS]] {
            self.lines.through(s, region, groups);
            let mut ends = Ends::NONE;
            for r in listed {
                self.lines.keep_ends(s, &self.scene.input.triangles[r.triangle as usize], r.triangle, &mut ends);
            }
            for i in numbers(self.lines.all) {
                self.add(i, ends.of(i));
            }
            if !is_mixed && self.hits.iter().all(|hit| hit.part == part) {
                break;
            }
        }
        self.hang(inner, slot);
    }

    /// Samples the child in `slot` with lines that follow the tree.
    #[inline(always)]
    fn large<S: Simd>(&mut self, s: S, inner: &InnerNode, slot: usize) {
        if !self.scene.input.is_opaque(Coded::part(inner.children[slot].0.words[2]).0) {
            self.out.push(Found::default());
            return;
        }
        let region = region(inner, slot);
        self.lines.through(s, &region, [0, GROUPS]);
        for i in numbers(self.lines.all) {
            let ends = self.end(s, i, true).and_then(|first| Some([first, self.end(s, i, false)?]));
            self.add(i, ends);
        }
        self.hang(inner, slot);
    }

    /// Returns the first triangle that line `i` meets in its interval, or the last.
    #[inline(always)]
    fn end<S: Simd>(&mut self, s: S, i: usize, is_first: bool) -> Option<u32> {
        let Self { scene, lines, stack, .. } = self;
        let mut line = lines.one(i, 0.0);
        let mut best: Option<(f32, u32)> = None;
        stack.extend(scene.pieces.iter().map(|p| &p.sub));
        while let Some(sub) = stack.pop() {
            match sub {
                Sub::Leaf { first, count, .. } => {
                    for r in &scene.refs[*first as usize..(first + count) as usize] {
                        let triangle = r.triangle() as u32;
                        if !line.crosses(r) || !scene.input.is_opaque(scene.input.parts[r.triangle()]) {
                            continue;
                        }
                        let Some(t) = line.distance(s, &scene.input.triangles[r.triangle()]) else { continue };
                        // All distances are in the interval: they are no worse than the best one.
                        if best.is_none_or(|(at, id)| t != at || triangle < id) {
                            best = Some((t, triangle));
                        }
                        line.shorten(t, !is_first);
                    }
                }
                Sub::InnerNode(inner) => push_crossed(s, &line, inner, stack),
                Sub::Placed(_) => {}
            }
        }
        best.map(|(_, triangle)| triangle)
    }

    /// Adds what line `i` meets first from both of its ends.
    fn add(&mut self, i: usize, ends: Option<[u32; 2]>) {
        let Some([first, last]) = ends else { return };
        let (dir, weight) = self.lines.direction(i);
        self.hits.push(self.scene.first_hit(first, -dir, weight));
        self.hits.push(self.scene.first_hit(last, dir, weight));
    }

    /// Gives the child in `slot` curtains, from what its lines meet first.
    fn hang(&mut self, inner: &InnerNode, slot: usize) {
        let mut voxel = inner.children[slot].0.clone();
        let (is_new, wrong) = hang_curtains(&self.hits, &mut voxel);
        self.hits.clear();
        self.out.push(Found { voxel: is_new.then_some(voxel), is_unclear: wrong > UNCLEAR });
    }
}

#[cfg(test)]
#[path = "seen_tests.rs"]
mod tests;
