//! An independent f64 BVH: median splits over centroids, plain boxes, nothing clever.
//!
//! Boxes are widened by 10^-12 of their largest coordinate, far above the rounding of
//! [`super::brute::meet_line`], so that no triangle that brute force finds is culled;
//! `tests/oracle.rs` holds it to brute force.

use super::brute::{Oracle, Ray64, Tri};
use super::rounding::point_distance;
use glam::DVec3;

const LEAF: usize = 4;
const WIDEN: f64 = 1e-12;

#[derive(Clone, Copy)]
struct Node {
    min: DVec3,
    max: DVec3,
    /// Inner node: index of the second child (the first follows its parent). Leaf: first of `order`.
    next: u32,
    /// 0 for an inner node.
    count: u32,
}

/// The tree.
pub struct Bvh64 {
    tris: Vec<Tri>,
    order: Vec<u32>,
    nodes: Vec<Node>,
}

impl Bvh64 {
    /// Builds the tree; triangles must be finite.
    pub fn new(tris: Vec<Tri>) -> Self {
        let centroids: Vec<DVec3> = tris.iter().map(|t| (t[0] + t[1] + t[2]) / 3.0).collect();
        let order = (0..tris.len() as u32).collect();
        let mut tree = Self { tris, order, nodes: Vec::new() };
        if !tree.tris.is_empty() {
            tree.build(0, tree.tris.len(), &centroids);
        }
        tree
    }

    fn build(&mut self, first: usize, end: usize, centroids: &[DVec3]) {
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut c_min, mut c_max) = (min, max);
        for &i in &self.order[first..end] {
            for v in self.tris[i as usize] {
                (min, max) = (min.min(v), max.max(v));
            }
            let c = centroids[i as usize];
            (c_min, c_max) = (c_min.min(c), c_max.max(c));
        }
        let pad = DVec3::splat(WIDEN * min.abs().max(max.abs()).max_element());
        let me = self.nodes.len();
        let (min, max) = (min - pad, max + pad);
        self.nodes.push(Node { min, max, next: first as u32, count: (end - first) as u32 });
        if end - first <= LEAF {
            return;
        }
        let extent = c_max - c_min;
        let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
        let mid = (end - first) / 2;
        self.order[first..end].select_nth_unstable_by(mid, |&a, &b| {
            let key = |i: u32| centroids[i as usize][axis];
            key(a).total_cmp(&key(b)).then(a.cmp(&b))
        });
        self.nodes[me].count = 0;
        self.build(first, first + mid, centroids);
        self.nodes[me].next = self.nodes.len() as u32;
        self.build(first + mid, end, centroids);
    }

    /// The distance of `p` to the nearest triangle, `most` if that is less.
    pub fn distance(&self, p: DVec3, most: f64) -> f64 {
        let to_box = |n: &Node| (p.clamp(n.min, n.max) - p).length();
        let mut nearest = most;
        let mut stack = vec![0u32];
        while let Some(at) = stack.pop() {
            let Some(node) = self.nodes.get(at as usize).filter(|n| to_box(n) < nearest) else { continue };
            if node.count > 0 {
                let leaf = &self.order[node.next as usize..(node.next + node.count) as usize];
                nearest = leaf.iter().fold(nearest, |d, &i| d.min(point_distance(p, &self.tris[i as usize])));
                continue;
            }
            // The nearer child is looked at first.
            let mut pair = [at + 1, node.next];
            if to_box(&self.nodes[pair[0] as usize]) < to_box(&self.nodes[pair[1] as usize]) {
                pair.swap(0, 1);
            }
            stack.extend(pair);
        }
        nearest
    }

    /// Visits every triangle of leaves whose boxes, grown by `grow`, the line meets in `[t_lo, limit]`; nearer
    /// children first. `visit` returns the new limit.
    fn walk(&self, ray: &Ray64, grow: f64, t_lo: f64, t_hi: f64, visit: &mut dyn FnMut(u32) -> f64) {
        let slabs = Slabs { org: ray.org, inv: ray.dir.recip(), grow, t_lo: t_lo - t_lo.abs() * SLACK };
        let enter = |n: u32, limit: f64| slabs.enter(&self.nodes[n as usize], limit);
        // Median splits: no path is longer than the bits of a count.
        let mut stack = [(0u32, 0.0f64); 64];
        let mut top = 0;
        let mut limit = t_hi;
        if let Some(t) = (!self.nodes.is_empty()).then(|| enter(0, limit)).flatten() {
            stack[0] = (0, t);
            top = 1;
        }
        while top > 0 {
            top -= 1;
            let (at, t) = stack[top];
            if t > loose(limit) {
                continue;
            }
            let node = self.nodes[at as usize];
            if node.count > 0 {
                for &prim in &self.order[node.next as usize..(node.next + node.count) as usize] {
                    limit = visit(prim);
                }
                continue;
            }
            let mut pair = [at + 1, node.next].map(|c| (c, enter(c, limit).unwrap_or(f64::INFINITY)));
            if pair[0].1 < pair[1].1 {
                pair.swap(0, 1);
            }
            for child in pair.into_iter().filter(|c| c.1 < f64::INFINITY) {
                stack[top] = child;
                top += 1;
            }
        }
    }
}

const SLACK: f64 = 1e-12;

/// A limit widened beyond the rounding of distances.
fn loose(t: f64) -> f64 {
    t + t.abs() * SLACK
}

/// What the box tests of one ray need.
struct Slabs {
    org: DVec3,
    inv: DVec3,
    grow: f64,
    t_lo: f64,
}

impl Slabs {
    /// Where the line enters the grown box up to `t_hi`; `None` when it does not.
    #[inline]
    fn enter(&self, node: &Node, t_hi: f64) -> Option<f64> {
        let (mut near, mut far) = (self.t_lo, loose(t_hi));
        for k in 0..3 {
            let lo = node.min[k] - self.grow - self.org[k];
            let hi = node.max[k] + self.grow - self.org[k];
            if self.inv[k].is_infinite() {
                // Along the slab: within it always or never (an infinite reciprocal of a denormal
                // asks for distances that nothing here has).
                if lo > 0.0 || hi < 0.0 {
                    return None;
                }
                continue;
            }
            let (a, b) = (lo * self.inv[k], hi * self.inv[k]);
            near = near.max(a.min(b) - a.min(b).abs() * SLACK);
            far = far.min(loose(a.max(b)));
        }
        (near <= far).then_some(near)
    }
}

impl Oracle for Bvh64 {
    fn tris(&self) -> &[Tri] {
        &self.tris
    }

    fn scan(&self, ray: &Ray64, visit: &mut dyn FnMut(u32, &Tri) -> f64) {
        self.walk(ray, 0.0, ray.t_min, ray.t_max, &mut |prim| visit(prim, &self.tris[prim as usize]));
    }

    fn near_line(&self, ray: &Ray64, eps: f64, visit: &mut dyn FnMut(u32, &Tri)) {
        self.walk(ray, eps, f64::NEG_INFINITY, f64::INFINITY, &mut |prim| {
            visit(prim, &self.tris[prim as usize]);
            f64::INFINITY
        });
    }
}
