//! Where a mesh's single-precision positions are measured from, and the rounding that this costs.
//!
//! One origin a mesh, not one a block: blocks with origins of their own would round a shared vertex
//! to different points, and open cracks between them.

use super::spool::{Chunk, Spool};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::math::DBounds;
use crate::structure::bvh::build::Par;
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

/// Moves a mesh to its origin; consumes the spool chunk by chunk. Fails with `Cancelled` only.
pub fn place(spool: Spool, par: &Par, cancel: &Cancel) -> Result<Placed> {
    let origin = choose(&spool.bounds, spool.is_single());
    let has_colours = spool.has_colours;
    let one = |chunk| cancel.check().map(|()| place_chunk(chunk, origin, has_colours));
    let pieces = par.map_items(spool.chunks, one).into_iter().collect::<Result<Vec<Placed>>>()?;
    let total = pieces.iter().map(|p| p.triangles.len()).sum();
    let mut all = Placed::empty(origin, total);
    for piece in pieces {
        cancel.check()?;
        all.triangles.extend(piece.triangles);
        all.parts.extend(piece.parts);
        all.prims.extend(piece.prims);
        all.colours.extend(piece.colours);
        all.degenerate += piece.degenerate;
        all.out_of_range += piece.out_of_range;
        all.position_error = all.position_error.max(piece.position_error);
    }
    Ok(all)
}

impl Placed {
    fn empty(origin: DVec3, capacity: usize) -> Self {
        Self {
            origin,
            triangles: Vec::with_capacity(capacity),
            parts: Vec::with_capacity(capacity),
            prims: Vec::with_capacity(capacity),
            colours: Vec::new(),
            degenerate: 0,
            out_of_range: 0,
            position_error: 0.0,
        }
    }
}

fn place_chunk(chunk: Chunk, origin: DVec3, has_colours: bool) -> Placed {
    let count = chunk.positions.len();
    let mut out = Placed::empty(origin, count);
    for i in 0..count {
        let corners = chunk.positions.triangle(i);
        let stored = corners.map(|c| (c - origin).as_vec3());
        if !stored.iter().all(|c| c.abs().max_element() <= FAR) {
            out.out_of_range += 1;
            continue;
        }
        if !has_area(&stored) {
            out.degenerate += 1;
            continue;
        }
        for (corner, s) in corners.iter().zip(&stored) {
            let error = (*corner - (origin + s.as_dvec3())).length();
            out.position_error = out.position_error.max(error);
        }
        out.triangles.push(stored);
        out.parts.push(chunk.parts[i]);
        out.prims.push(chunk.prims[i]);
        if has_colours {
            out.colours.push(chunk.colours.get(i).copied().unwrap_or([0; 4]));
        }
    }
    out
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
