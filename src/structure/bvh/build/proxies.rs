//! Samples the proxies of subtrees (`lod::proxy`): lines from outside into the cell of each, uniform over all lines
//! that cross it, tested against all triangles of the chunk within the cell. So a subtree that others surround has the
//! look of these where they hide it.
//!
//! Subtrees of a number of triangles and more get a proxy; all nodes below show that of the last such subtree on the
//! way, as triangles do in the paper. (It has a proxy for each reference between blocks. A fine block of this tree has
//! some fifty subtrees of about forty triangles, so that would be two bytes for each triangle.) Nodes that join chunks
//! have no proxies, because no chunk holds all triangles below them; they show their voxels.
//!
//! All subtrees are sampled with the same lines, shifted by a hash of the cell's position. The result does not depend
//! on the number of threads.

use super::refs::Ref;
use super::tree::{InnerNode, NO_PROXY, Piece, Sub};
use crate::base::error::Result;
use crate::base::progress::Stretch;
use crate::lod::{Sampler, halton, line_into};
use crate::math::Bounds;
use crate::simd::{Isa, Lanes, Mask, Op, Simd, dispatch};
use crate::structure::bake::{BakedProxy, ProxyOptions, TreeInput};
use crate::structure::bvh::layout::{Node, WIDTH};
use crate::structure::par::Par;
use glam::Vec3;

/// Triangles of the chunk for each proxy, if no number is asked for: 80 bytes of a proxy, and about 2.2 runs of 10
/// bytes in the file, are 0.31 bytes for each triangle.
const TRIANGLES_A_PROXY: usize = 330;
/// Fewest triangles of a subtree with a proxy, if no number is asked for.
const FEWEST: u32 = 32;
/// Length by which a line's part in the cell is longer at both ends, as a fraction of the cell's diagonal: content in
/// the faces of the cell is met whatever the rounding.
const ROUNDED: f32 = 1.0 / 1024.0;
/// Bases of the four numbers of a line.
const BASES: [u32; 4] = [2, 3, 5, 7];

/// A subtree that may get a proxy.
struct Candidate<'a> {
    inner: &'a InnerNode,
    /// Number of its root among all inner nodes, in preorder.
    number: u32,
    /// References to triangles in it.
    count: u32,
}

/// The geometry that lines are tested against.
struct Scene<'a> {
    pieces: &'a [Piece],
    input: TreeInput<'a>,
    refs: &'a [Ref],
    /// The numbers of all lines.
    lines: Vec<[f32; 4]>,
}

/// Samples the proxies of the subtrees of a chunk, and sets the proxy of each node. The first proxy has number
/// `options.first`. Fails only with [`crate::Error::Cancelled`].
pub fn sample(
    pieces: &mut [Piece],
    input: TreeInput,
    refs: &[Ref],
    options: &ProxyOptions,
    isa: Isa,
    par: &Par,
    work: &Stretch,
) -> Result<Vec<BakedProxy>> {
    let lines = (0..options.rays).map(|i| BASES.map(|base| halton(i, base))).collect();
    let scene = Scene { pieces, input, refs, lines };
    let chosen = chosen(pieces, input.triangles.len(), options.triangles);
    let numbers: Vec<u32> = chosen.iter().map(|c| c.number).collect();
    let work = work.part(0.0, 1.0, chosen.len() as u64);
    let sampled = par.map(chosen.len(), |i| {
        work.begin()?;
        Ok(dispatch(isa, OfSubtree { scene: &scene, inner: chosen[i].inner }))
    });
    let sampled = sampled.into_iter().collect::<Result<Vec<_>>>()?;
    let (mut proxies, mut of_node) = (Vec::with_capacity(sampled.len()), Vec::with_capacity(sampled.len()));
    for (number, proxy) in numbers.into_iter().zip(sampled) {
        // A subtree that no line meets has none of its own.
        if let Some(proxy) = proxy {
            of_node.push((number, options.first + proxies.len() as u32));
            proxies.push(proxy);
        }
    }
    let (mut next, mut number) = (of_node.into_iter().peekable(), 0);
    for piece in pieces {
        if let Sub::InnerNode(inner) = &mut piece.sub {
            assign(inner, NO_PROXY, &mut number, &mut next);
        }
    }
    Ok(proxies)
}

/// Returns the subtrees that get a proxy, in preorder: those of `least` triangles and more, or of so many that there is
/// one for [`TRIANGLES_A_PROXY`] triangles.
fn chosen(pieces: &[Piece], triangles: usize, least: u32) -> Vec<Candidate<'_>> {
    let (mut all, mut number) = (Vec::new(), 0);
    for piece in pieces {
        if let Sub::InnerNode(inner) = &piece.sub {
            gather(inner, if least > 0 { least } else { FEWEST }, &mut number, &mut all);
        }
    }
    if least == 0 {
        let most = triangles / TRIANGLES_A_PROXY;
        let mut counts: Vec<u32> = all.iter().map(|c| c.count).collect();
        counts.sort_unstable_by(|a, b| b.cmp(a));
        // Of subtrees of equal size all get a proxy or none.
        let too_few = counts.get(most).copied().unwrap_or(0);
        all.retain(|c| c.count > too_few);
    }
    all
}

/// Appends the subtrees of a node that have at least `least` references to triangles, in preorder. Returns the number
/// of references.
fn gather<'a>(inner: &'a InnerNode, least: u32, number: &mut u32, out: &mut Vec<Candidate<'a>>) -> u32 {
    let at = out.len();
    out.push(Candidate { inner, number: *number, count: 0 });
    *number += 1;
    let mut sum = 0;
    for (_, sub) in &inner.children {
        sum += match sub {
            Sub::InnerNode(below) => gather(below, least, number, out),
            Sub::Leaf { count, .. } => *count,
            Sub::Placed(_) => 0,
        };
    }
    if sum < least {
        // Neither have the subtrees below.
        out.truncate(at);
    } else {
        out[at].count = sum;
    }
    sum
}

/// Sets the proxy of each node: its own, or the one on the way. The voxels of its children then need no samples of
/// sides.
fn assign(
    inner: &mut InnerNode,
    above: u32,
    number: &mut u32,
    next: &mut std::iter::Peekable<std::vec::IntoIter<(u32, u32)>>,
) {
    let own = next.next_if(|(of, _)| of == number);
    inner.proxy = own.map_or(above, |(_, proxy)| proxy);
    *number += 1;
    for (voxel, sub) in &mut inner.children {
        // What is below a node with a proxy shows one, too.
        if inner.proxy != NO_PROXY {
            voxel.without_sides();
        }
        if let Sub::InnerNode(below) = sub {
            assign(below, inner.proxy, number, next);
        }
    }
    inner.measure();
}

/// Samples one subtree.
struct OfSubtree<'a> {
    scene: &'a Scene<'a>,
    inner: &'a InnerNode,
}

impl Op for OfSubtree<'_> {
    type Out = Option<BakedProxy>;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Option<BakedProxy> {
        let Self { scene, inner } = self;
        let cell = (0..inner.children.len()).fold(Bounds::EMPTY, |all, slot| all.union(inner.node.stored_box(slot)));
        let area = scene.area(inner) as f32;
        if !(area.is_finite() && area > 0.0) {
            return None;
        }
        let (near, shifts) = (scene.around(&cell), shifts(&cell));
        let (mut sampler, mut stack) = (Sampler::default(), Vec::new());
        for numbers in &scene.lines {
            let mut at = *numbers;
            for i in 0..4 {
                at[i] = (at[i] + shifts[i]).fract();
            }
            let line = Line::into(&cell, at);
            if let Some(triangle) = scene.first(s, &line, &near, &mut stack) {
                let [a, b, c] = scene.input.triangles[triangle];
                if let Some(normal) = (b - a).cross(c - a).try_normalize() {
                    sampler.push(line.dir, normal, scene.input.colour(triangle).0);
                }
            }
        }
        sampler.looks().map(|looks| BakedProxy { looks, area })
    }
}

/// Returns four numbers in [0, 1) that depend on a cell's position.
fn shifts(cell: &Bounds) -> [f32; 4] {
    let mut hash = 0x9E37_79B9_7F4A_7C15u64;
    for word in [cell.min, cell.max].map(|v| v.to_array().map(f32::to_bits)).as_flattened() {
        hash = (hash ^ u64::from(*word)).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
        hash ^= hash >> 29;
    }
    [0, 16, 32, 48].map(|from| (hash >> from & 0xffff) as f32 / 65536.0)
}

/// A line into a cell.
struct Line {
    org: Vec3,
    dir: Vec3,
    inv: Vec3,
    /// The interval inside of the cell, a little longer.
    way: [f32; 2],
}

impl Line {
    fn into(cell: &Bounds, at: [f32; 4]) -> Self {
        let (org, dir) = line_into(cell, at);
        let inv = dir.abs().max(Vec3::splat(1e-12)).copysign(dir).recip();
        let (rounded, mut line) = (cell.extent().length() * ROUNDED, Self { org, dir, inv, way: [0.0; 2] });
        line.way = [-rounded, line.leaves(cell).max(0.0) + rounded];
        line
    }

    /// Distance at which the line leaves a box that it enters.
    fn leaves(&self, b: &Bounds) -> f32 {
        ((b.min - self.org) * self.inv).max((b.max - self.org) * self.inv).min_element()
    }

    /// Distance at which the line enters a box; `None` if it does not before `end`.
    fn enters(&self, b: &Bounds, end: f32) -> Option<f32> {
        let (low, high) = ((b.min - self.org) * self.inv, (b.max - self.org) * self.inv);
        let (enter, leave) = (low.min(high).max_element().max(self.way[0]), low.max(high).min_element().min(end));
        (enter <= leave + (enter.abs() + leave.abs()) * 1e-5).then_some(enter)
    }

    /// Returns the children of a node that the line crosses before `end`, and the distances at which it enters them.
    #[inline(always)]
    fn boxes<S: Simd>(&self, s: S, node: &Node, end: f32) -> (u32, [f32; WIDTH]) {
        let (mut enter, mut leave) = (s.splat8(self.way[0]), s.splat8(end));
        for (axis, step) in s.powers8(node.exponents()).into_iter().enumerate() {
            let inv = s.splat8(self.inv[axis]);
            let from = s.splat8(node.origin[axis]) - s.splat8(self.org[axis]);
            let a = (s.bytes8(&node.planes[axis]) * step + from) * inv;
            let b = (s.bytes8(&node.planes[axis + 3]) * step + from) * inv;
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        // Flat boxes are hit only up to rounding.
        let zero = s.splat8(0.0);
        let sizes = enter.max(zero - enter) + leave.max(zero - leave);
        (enter.le(leave + sizes * s.splat8(1e-5)).bits() & u32::from(node.valid), enter.to_array())
    }

    /// Distance at which the line hits a triangle before `end`. (Möller and Trumbore, "Fast, Minimum Storage
    /// Ray/Triangle Intersection", 1997.)
    #[inline(always)]
    fn hits(&self, [a, b, c]: &[Vec3; 3], end: f32) -> Option<f32> {
        let (ab, ac, from) = (*b - *a, *c - *a, self.org - *a);
        let (p, q) = (self.dir.cross(ac), from.cross(ab));
        let inv = 1.0 / ab.dot(p);
        let (u, v, t) = (from.dot(p) * inv, self.dir.dot(q) * inv, ac.dot(q) * inv);
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= self.way[0] && t < end).then_some(t)
    }
}

impl<'a> Scene<'a> {
    fn refs(&self, first: u32, count: u32) -> &[Ref] {
        &self.refs[first as usize..(first + count) as usize]
    }

    /// Surface area of the triangles below a node. A triangle counts as often as leaves refer to it.
    fn area(&self, inner: &InnerNode) -> f64 {
        let of_triangle = |r: &Ref| {
            let [a, b, c] = self.input.triangles[r.triangle()];
            f64::from((b - a).cross(c - a).length() * 0.5)
        };
        let below = inner.children.iter().map(|(_, sub)| match sub {
            Sub::InnerNode(below) => self.area(below),
            Sub::Leaf { first, count, .. } => self.refs(*first, *count).iter().map(of_triangle).sum(),
            Sub::Placed(_) => 0.0,
        });
        below.sum()
    }

    /// Returns nodes and leaves that together hold all triangles in a cell: not larger than the cell where possible, so
    /// that lines need not begin at the top of the tree.
    fn around(&self, cell: &Bounds) -> Vec<(Bounds, &'a Sub)> {
        let (size, mut near) = (cell.half_area(), Vec::new());
        let mut stack: Vec<(Bounds, &Sub)> = self.pieces.iter().map(|p| (p.cell, &p.sub)).collect();
        while let Some((bounds, sub)) = stack.pop() {
            match sub {
                _ if !bounds.overlaps(cell) => {}
                Sub::InnerNode(inner) if bounds.half_area() > size => {
                    let children = inner.children.iter().enumerate();
                    stack.extend(children.map(|(slot, (_, sub))| (inner.node.stored_box(slot), sub)));
                }
                _ => near.push((bounds, sub)),
            }
        }
        near
    }

    /// Returns the first triangle that a line hits, below the nodes `near`.
    #[inline(always)]
    fn first<S: Simd>(
        &self,
        s: S,
        line: &Line,
        near: &[(Bounds, &'a Sub)],
        stack: &mut Vec<(f32, &'a Sub)>,
    ) -> Option<usize> {
        let (mut end, mut found) = (line.way[1], None);
        for (bounds, sub) in near {
            if let Some(enter) = line.enters(bounds, end) {
                stack.push((enter, sub));
            }
        }
        stack.sort_by(|a, b| b.0.total_cmp(&a.0));
        while let Some((enter, sub)) = stack.pop() {
            if enter > end {
                continue;
            }
            match sub {
                Sub::Leaf { first, count, .. } => {
                    for r in self.refs(*first, *count) {
                        if let Some(t) = line.hits(&self.input.triangles[r.triangle()], end) {
                            (end, found) = (t, Some(r.triangle()));
                        }
                    }
                }
                Sub::InnerNode(inner) => {
                    let (mut met, enters) = line.boxes(s, &inner.node, end);
                    let from = stack.len();
                    while met != 0 {
                        let slot = met.trailing_zeros() as usize;
                        met &= met - 1;
                        let Some((_, sub)) = inner.children.get(slot) else { continue };
                        // Sorted: the nearest is last.
                        let mut at = stack.len();
                        stack.push((enters[slot], sub));
                        while at > from && stack[at - 1].0 < stack[at].0 {
                            stack.swap(at - 1, at);
                            at -= 1;
                        }
                    }
                }
                Sub::Placed(_) => {}
            }
        }
        found
    }
}

/// The runs of nodes of a block that show the same proxy: first node and proxy.
pub fn runs(of_nodes: &[u32]) -> Vec<(u16, u32)> {
    let mut runs: Vec<(u16, u32)> = Vec::new();
    for (node, &proxy) in of_nodes.iter().enumerate() {
        if runs.last().map_or(NO_PROXY, |last| last.1) != proxy {
            runs.push((node as u16, proxy));
        }
    }
    runs
}

#[cfg(test)]
#[path = "proxies_tests.rs"]
mod tests;
