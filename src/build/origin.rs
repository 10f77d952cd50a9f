//! Where a mesh's single-precision positions are measured from, and the rounding that this costs.
//!
//! One origin a mesh, not one a block: blocks with origins of their own would round a shared vertex
//! to different points, and open cracks between them.

use super::spool::{Chunk, Spool};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::math::DBounds;
use crate::structure::bvh::build::Par;
use bytemuck::zeroed_vec;
use glam::{DVec3, Vec3};

/// A mesh ready for its tree.
pub struct Placed {
    /// In the mesh's own coordinates.
    pub origin: DVec3,
    /// Corners around the origin; every triangle has an area.
    pub triangles: Vec<[Vec3; 3]>,
    /// Part of each.
    pub parts: Vec<u32>,
    /// Primitive id of each, ascending.
    pub prims: Vec<u32>,
    /// sRGB of each, or empty.
    pub colours: Vec<[u8; 4]>,
    /// Left out: no area.
    pub degenerate: u64,
    /// Left out: too far from the middle.
    pub out_of_range: u64,
    /// The greatest distance between a vertex as read and as stored.
    pub position_error: f64,
}

/// Coordinates around the origin are at most this: products of two, and reciprocals, must stay in the
/// range of single precision.
const FAR: f32 = 1e15;

/// The origin of a mesh: zero where that keeps every coordinate as it is and the mesh is near zero, else
/// the middle of its bounds, rounded to a multiple of a power of two near a sixteenth of its size (so that
/// moving a mesh by such multiples does not change what is stored).
pub fn choose(bounds: &DBounds, is_single: bool) -> DVec3 {
    if bounds.is_empty() {
        return DVec3::ZERO;
    }
    let size = bounds.extent().max_element();
    let far = bounds.min.abs().max(bounds.max.abs()).max_element();
    if is_single && far <= 16.0 * size {
        return DVec3::ZERO;
    }
    let step = (size / 16.0).max(f64::MIN_POSITIVE).log2().ceil().exp2();
    // Halves first: the sum of two finite numbers may not be one.
    let middle = bounds.min * 0.5 + bounds.max * 0.5;
    let rounded = (middle / step).round() * step;
    if rounded.is_finite() { rounded } else { middle }
}

/// What becomes of the triangles of a chunk.
#[derive(Default)]
struct Judged {
    keep: Vec<bool>,
    kept: usize,
    degenerate: u64,
    out_of_range: u64,
    position_error: f64,
}

/// Where the kept triangles of a chunk go.
struct Target<'a> {
    triangles: &'a mut [[Vec3; 3]],
    parts: &'a mut [u32],
    prims: &'a mut [u32],
    colours: &'a mut [[u8; 4]],
}

/// Moves a mesh to its origin; consumes the spool chunk by chunk. Fails with `Cancelled` only.
pub fn place(spool: Spool, par: &Par, cancel: &Cancel) -> Result<Placed> {
    let origin = choose(&spool.bounds, spool.is_single());
    let judge = |i: usize| cancel.check().map(|()| judge(&spool.chunks[i], origin));
    let judged = par.map(spool.chunks.len(), judge).into_iter().collect::<Result<Vec<Judged>>>()?;
    let mut all = Placed::of(&judged, origin, spool.has_colours);
    let targets = targets(&mut all, &judged);
    let work: Vec<_> = spool.chunks.into_iter().zip(judged.iter().zip(targets)).collect();
    let fill = |(chunk, (judged, target))| cancel.check().map(|()| fill(chunk, judged, origin, target));
    par.map_items(work, fill).into_iter().collect::<Result<()>>()?;
    Ok(all)
}

impl Placed {
    /// With room for what is kept, in memory not yet touched: the threads that fill it do that.
    fn of(judged: &[Judged], origin: DVec3, has_colours: bool) -> Self {
        let total = judged.iter().map(|j| j.kept).sum();
        Self {
            origin,
            triangles: zeroed_vec(total),
            parts: zeroed_vec(total),
            prims: zeroed_vec(total),
            colours: zeroed_vec(if has_colours { total } else { 0 }),
            degenerate: judged.iter().map(|j| j.degenerate).sum(),
            out_of_range: judged.iter().map(|j| j.out_of_range).sum(),
            position_error: judged.iter().fold(0.0, |all, j| all.max(j.position_error)),
        }
    }
}

fn targets<'a>(all: &'a mut Placed, judged: &[Judged]) -> Vec<Target<'a>> {
    // Nothing where there is nothing: colours, mostly.
    fn carve<'a, T>(rest: &mut &'a mut [T], len: usize) -> &'a mut [T] {
        let len = len.min(rest.len());
        let (front, back) = std::mem::take(rest).split_at_mut(len);
        *rest = back;
        front
    }
    let (mut triangles, mut parts) = (&mut all.triangles[..], &mut all.parts[..]);
    let (mut prims, mut colours) = (&mut all.prims[..], &mut all.colours[..]);
    let target = |judged: &Judged| Target {
        triangles: carve(&mut triangles, judged.kept),
        parts: carve(&mut parts, judged.kept),
        prims: carve(&mut prims, judged.kept),
        colours: carve(&mut colours, judged.kept),
    };
    judged.iter().map(target).collect()
}

fn stored(corners: &[DVec3; 3], origin: DVec3) -> [Vec3; 3] {
    corners.map(|c| (c - origin).as_vec3())
}

fn judge(chunk: &Chunk, origin: DVec3) -> Judged {
    let count = chunk.positions.len();
    let mut out = Judged { keep: vec![false; count], ..Judged::default() };
    for (i, keep) in out.keep.iter_mut().enumerate() {
        let corners = chunk.positions.triangle(i);
        let stored = stored(&corners, origin);
        if !stored.iter().all(|c| c.abs().max_element() <= FAR) {
            out.out_of_range += 1;
        } else if !has_area(&stored) {
            out.degenerate += 1;
        } else {
            *keep = true;
            out.kept += 1;
            let errors = corners.iter().zip(&stored).map(|(c, s)| (*c - (origin + s.as_dvec3())).length_squared());
            out.position_error = errors.fold(out.position_error, f64::max);
        }
    }
    out.position_error = out.position_error.sqrt();
    out
}

fn fill(chunk: Chunk, judged: &Judged, origin: DVec3, to: Target) {
    let kept = (0..chunk.positions.len()).filter(|&i| judged.keep[i]);
    for (at, i) in kept.enumerate() {
        to.triangles[at] = stored(&chunk.positions.triangle(i), origin);
        to.parts[at] = chunk.parts[i];
        to.prims[at] = chunk.prims[i];
        if !to.colours.is_empty() {
            to.colours[at] = chunk.colours.get(i).copied().unwrap_or([0; 4]);
        }
    }
}

/// Whether the corners, as stored, do not lie on one line.
fn has_area([a, b, c]: &[Vec3; 3]) -> bool {
    if a == b || b == c || c == a {
        return false;
    }
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    (b - a).cross(c - a) != DVec3::ZERO
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(low: f64, high: f64) -> DBounds {
        DBounds { min: DVec3::splat(low), max: DVec3::splat(high) }
    }

    #[test]
    fn near_zero_single_precision_stays_as_it_is() {
        assert_eq!(choose(&bounds(-1.0, 3.0), true), DVec3::ZERO);
        assert_ne!(choose(&bounds(1e7, 1e7 + 3.0), true), DVec3::ZERO);
        assert_eq!(choose(&DBounds::EMPTY, false), DVec3::ZERO);
    }

    #[test]
    fn a_shift_by_a_multiple_of_the_step_shifts_the_origin_alike() {
        let near = choose(&bounds(0.1, 3.3), false);
        let far = choose(&bounds(1e7 + 0.1, 1e7 + 3.3), false);
        assert_eq!(far - near, DVec3::splat(1e7));
    }

    #[test]
    fn a_point_has_an_origin_too() {
        assert!(choose(&bounds(5.0, 5.0), false).is_finite());
        assert!(choose(&bounds(-1e308, 1e308), false).is_finite());
    }
}
