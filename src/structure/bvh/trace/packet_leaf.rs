//! Packets at leaves: eight triangles against one ray after the other, or sixteen rays against one triangle after the
//! other, whichever is less.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::packet::{PACKET, PacketEntry, PacketWalk};
use super::packet_visit::{Shared, keep};
use super::single::{LeafRay, is_better, triangles};
use super::walk::{Outcome, TriHit};
use super::{PartFilter, TreeView};
use crate::base::ids::BlockId;
use crate::geom::watertight::{intersect, shear};
use crate::simd::{Lanes, Simd};
use crate::structure::bvh::layout::{Block, Leaf};

/// Tests the triangles of a leaf: eight against each ray or sixteen rays against each, whichever is less.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // one packet's whole state, kept in registers
pub(super) fn leaf<S: Simd, const ANY: bool>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    walk: &mut PacketWalk,
    entry: PacketEntry,
    shared: &Shared,
    block: Block,
    at: usize,
) -> Outcome {
    let leaf = block.leaf(at);
    let k = shared.k;
    if (entry.rays.count_ones() as usize) < leaf.triangles {
        return leaf_ray_by_ray::<S, ANY>(s, view, filter, walk, entry, shared, block, at);
    }
    for i in 0..leaf.triangles {
        walk.counters.triangles += 1;
        let Some(hits) = triangle(s, &leaf, i, k, walk, entry.rays) else { continue };
        if filter.is_some_and(|f| f.hides(block.part(leaf.part_of(i)))) {
            continue;
        }
        let tri = (at as u32) << 3 | i as u32;
        if let Err(missing) = keep_better(view, walk, &hits, entry.block, tri) {
            walk.stack.push(entry);
            return Outcome::Pending(missing);
        }
        if ANY {
            walk.waiting &= !hits.rays;
        }
    }
    Outcome::Done
}

/// Tests eight triangles at a time against one ray after the other.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // one packet's whole state, kept in registers
fn leaf_ray_by_ray<S: Simd, const ANY: bool>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    walk: &mut PacketWalk,
    entry: PacketEntry,
    shared: &Shared,
    block: Block,
    at: usize,
) -> Outcome {
    let (leaf, k) = (block.leaf(at), shared.k);
    let mut rays = entry.rays;
    while rays != 0 {
        let i = rays.trailing_zeros() as usize & (PACKET - 1);
        let r = &walk.rays;
        let ray = LeafRay {
            org: [s.splat8(r.org[k[0]][i]), s.splat8(r.org[k[1]][i]), s.splat8(r.org[k[2]][i])],
            shear: [s.splat8(r.shear[0][i]), s.splat8(r.shear[1][i]), s.splat8(r.shear[2][i])],
            t_min: s.splat8(r.t_min[i]),
            k,
        };
        walk.counters.triangles += leaf.triangles as u64;
        if let Some((lane, t, u, v)) = triangles(s, block, leaf, &ray, filter, walk.hits.t[i]) {
            let hit = TriHit { t, u, v, block: entry.block, tri: (at as u32) << 3 | lane };
            let best = walk.best(i);
            match is_better(view, &hit, &best, &mut walk.counters) {
                Ok(true) => keep(walk, i, &hit),
                Ok(false) => {}
                Err(missing) => {
                    walk.stack.push(PacketEntry { rays, ..entry });
                    return Outcome::Pending(missing);
                }
            }
            if ANY {
                walk.waiting &= !(1 << i);
            }
        }
        rays &= rays - 1;
    }
    Outcome::Done
}

/// Hits of one triangle, lane by lane.
struct TriangleHits {
    rays: u32,
    t: [f32; PACKET],
    u: [f32; PACKET],
    v: [f32; PACKET],
}

/// Tests triangle `i` of a leaf against the rays of `active`.
#[inline(always)]
fn triangle<S: Simd>(
    s: S,
    leaf: &Leaf,
    i: usize,
    k: [usize; 3],
    walk: &PacketWalk,
    active: u32,
) -> Option<TriangleHits> {
    let rays = &walk.rays;
    let tables = [leaf.coordinates16(k[0]), leaf.coordinates16(k[1]), leaf.coordinates16(k[2])];
    let org = [s.load16(&rays.org[k[0]]), s.load16(&rays.org[k[1]]), s.load16(&rays.org[k[2]])];
    let skew = [s.load16(&rays.shear[0]), s.load16(&rays.shear[1]), s.load16(&rays.shear[2])];
    let mut corners = [org; 3];
    for (c, corner) in corners.iter_mut().enumerate() {
        let v = usize::from(leaf.corners8(c)[i & 7]) & 15;
        for axis in 0..3 {
            corner[axis] = s.splat16(tables[axis][v]) - org[axis];
        }
    }
    let [a, b, c] = corners;
    let (a, b, c) = (shear(a, skew), shear(b, skew), shear(c, skew));
    let found = intersect::<16, _, true>(a, b, c, s.splat16(0.0), s.load16(&rays.t_min), s.load16(&walk.hits.t));
    let hits = found.hits & active;
    if hits == 0 {
        return None;
    }
    Some(TriangleHits { rays: hits, t: found.t.to_array(), u: found.u.to_array(), v: found.v.to_array() })
}

/// Keeps the hits that are better than what their rays have.
#[inline(always)]
fn keep_better(
    view: &TreeView,
    walk: &mut PacketWalk,
    hits: &TriangleHits,
    block: u32,
    tri: u32,
) -> Result<(), BlockId> {
    let mut rays = hits.rays;
    while rays != 0 {
        let i = rays.trailing_zeros() as usize & (PACKET - 1);
        rays &= rays - 1;
        let hit = TriHit { t: hits.t[i], u: hits.u[i], v: hits.v[i], block, tri };
        let best = walk.best(i);
        if is_better(view, &hit, &best, &mut walk.counters)? {
            keep(walk, i, &hit);
        }
    }
    Ok(())
}
