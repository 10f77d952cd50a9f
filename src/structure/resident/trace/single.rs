//! Single rays: eight boxes or triangles at a time.

use super::Both;
use super::leaf::{LeafRay, nearest};
use crate::simd::{Lanes, Mask, Op, Simd, dispatch};
use crate::structure::filter::PartFilter;
use crate::structure::hit::{Counters, TriHit};
use crate::structure::place::Rooted;
use crate::structure::prepared::PreparedRay;
use crate::structure::resident::layout::{LEAF, Node};
use crate::structure::walk::{LINKS, Links, Walk};

pub(super) fn run<const ANY: bool>(tree: Both, filter: Option<&PartFilter>, walk: &mut Walk) -> bool {
    if walk.stack.is_empty() {
        return true;
    }
    let ended = dispatch(tree.blocks.isa(), Single::<ANY> { tree, filter, walk });
    if ended {
        walk.stack.clear();
    }
    ended
}

struct Single<'a, const ANY: bool> {
    tree: Both<'a>,
    filter: Option<&'a PartFilter<'a>>,
    walk: &'a mut Walk,
}

impl<const ANY: bool> Op for Single<'_, ANY> {
    type Out = bool;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let Self { tree, filter, walk } = self;
        let ray = RayLanes::new(s, &PreparedRay::new(&walk.ray, tree.form.max_coord));
        let links = walk.links.get_or_insert_default();
        match visit::<S, ANY>(s, tree, filter, &ray, (0, links), walk.best) {
            Some((best, counts)) => {
                walk.best = best;
                count(&mut walk.counters, counts);
                true
            }
            None => false,
        }
    }
}

/// Counts nodes, leaves and triangles.
#[inline(always)]
pub(super) fn count(counters: &mut Counters, [nodes, leaves, triangles]: [u32; 3]) {
    counters.nodes += u64::from(nodes);
    counters.leaves += u64::from(leaves);
    counters.triangles += u64::from(triangles);
}

/// A ray in all lanes.
pub(super) struct RayLanes<S: Simd> {
    leaf: LeafRay<S>,
    inv: [S::F8; 3],
    minus_off_near: [S::F8; 3],
    minus_off_far: [S::F8; 3],
    /// See [`PreparedRay::near`].
    near: [usize; 3],
}

impl<S: Simd> RayLanes<S> {
    #[inline(always)]
    pub(super) fn new(s: S, ray: &PreparedRay) -> Self {
        let k = ray.shear.k;
        Self {
            leaf: LeafRay {
                org: splat3(s, [ray.org[k[0]], ray.org[k[1]], ray.org[k[2]]]),
                shear: splat3(s, ray.shear.s),
                t_min: s.splat8(ray.t_min),
                k,
            },
            inv: splat3(s, ray.inv),
            minus_off_near: splat3(s, [-ray.off_near[0], -ray.off_near[1], -ray.off_near[2]]),
            minus_off_far: splat3(s, [-ray.off_far[0], -ray.off_far[1], -ray.off_far[2]]),
            near: ray.near,
        }
    }
}

#[inline(always)]
fn splat3<S: Simd>(s: S, v: [f32; 3]) -> [S::F8; 3] {
    [s.splat8(v[0]), s.splat8(v[1]), s.splat8(v[2])]
}

/// Walks from a link. Returns the best hit and the nodes, leaves and triangles visited; `None` if there is no result.
#[inline(always)]
pub(super) fn visit<S: Simd, const ANY: bool>(
    s: S,
    tree: Both,
    filter: Option<&PartFilter>,
    ray: &RayLanes<S>,
    (mut link, links): (u32, &mut Links),
    mut best: TriHit,
) -> Option<(TriHit, [u32; 3])> {
    let form = tree.form;
    let nodes = &form.nodes[..];
    let Links { t: ts, link: links } = links;
    let (mut top, mut count) = (0usize, [0u32; 3]);
    loop {
        if link & LEAF == 0 {
            count[0] += 1;
            let node = &nodes[link as usize];
            let (mut mask, t) = boxes(s, node, ray, best.t);
            if mask != 0 {
                let first = mask.trailing_zeros() as usize & 7;
                mask &= mask - 1;
                if mask == 0 {
                    link = node.child[first];
                    continue;
                }
                if top > LINKS - 8 {
                    return None;
                }
                let second = mask.trailing_zeros() as usize & 7;
                if mask & (mask - 1) == 0 {
                    let t = t.to_array();
                    let is_second = t[second] < t[first];
                    let (near, far) = if is_second { (second, first) } else { (first, second) };
                    (ts[top], links[top]) = (t[far], node.child[far]);
                    top += 1;
                    link = node.child[near];
                    continue;
                }
                let all = (mask | 1 << first).count_ones() as usize;
                let (Some(t_out), Some(out)) = (ts[top..].first_chunk_mut::<8>(), links[top..].first_chunk_mut::<8>())
                else {
                    unreachable!()
                };
                s.order8(t, mask | 1 << first, &node.child, t_out, out);
                top += all - 1;
                link = links[top];
                continue;
            }
        } else {
            count[1] += 1;
            let leaf = form.leaf(link);
            count[2] += leaf.triangles as u32;
            if let Some((lane, t, u, v)) = nearest(s, form, &leaf, &ray.leaf, filter, best.t) {
                let hit = leaf.hit(lane, t, u, v);
                if tree.is_better(&hit, &best)? {
                    best = hit;
                }
                if ANY {
                    return Some((best, count));
                }
            }
        }
        // Not `<`: an entry at an equal distance may hold a tie that a lower primitive id wins.
        loop {
            if top == 0 {
                return Some((best, count));
            }
            top -= 1;
            if ts[top] <= best.t {
                break;
            }
        }
        link = links[top];
    }
}

/// Returns the children with boxes that the ray hits before `t_max`, and the distances at which it enters them.
#[inline(always)]
fn boxes<S: Simd>(s: S, node: &Node, ray: &RayLanes<S>, t_max: f32) -> (u32, S::F8) {
    let mut enter = ray.leaf.t_min;
    let mut leave = s.splat8(t_max);
    for axis in 0..3 {
        // `near` is an axis, or an axis plus 3.
        let near = ray.near[axis];
        let far = if near < 3 { near + 3 } else { near - 3 };
        let near = s.load8(&node.planes[near]).mul_add(ray.inv[axis], ray.minus_off_near[axis]);
        let far = s.load8(&node.planes[far]).mul_add(ray.inv[axis], ray.minus_off_far[axis]);
        // In this order of operands a NaN (infinity times zero) leaves the interval unchanged.
        enter = near.max(enter);
        leave = far.min(leave);
    }
    (enter.le(leave).bits() & node.valid, enter)
}
