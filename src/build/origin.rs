//! The origin of a mesh, to which its single-precision positions are relative, and the error of rounding to these.
//!
//! Each tree has one origin. With an origin for each block, a vertex that two blocks share would be rounded to
//! different points, and there would be cracks between them. (`split` keeps vertices that two trees share in one
//! place.)

use super::batch::{Batch, Extent};
use super::edges::Edges;
use super::spool::{Spool, Taken};
use super::values::{Has, NO_COLOURS, NO_NORMALS, Values};
use crate::base::error::Result;
use crate::base::memory::zeroed;
use crate::base::progress::Cancel;
use crate::base::scratch::Scratch;
use crate::math::DBounds;
use crate::structure::Par;
use glam::{DVec3, Vec3};
use std::collections::BTreeMap;

/// A mesh whose tree can be built.
pub struct Placed {
    /// Origin, in the mesh's own coordinates.
    pub origin: DVec3,
    /// Corners relative to the origin; every triangle has an area.
    pub triangles: Vec<[Vec3; 3]>,
    /// Part of each triangle.
    pub parts: Vec<u32>,
    /// Primitive id of each triangle, ascending.
    pub prims: Vec<u32>,
    /// Colours and normals.
    pub values: Values,
    /// Numbers of kept and dropped triangles of the mesh.
    pub fates: Fates,
    /// Edges of the dropped triangles without area, by part.
    pub flat: Flat,
}

/// Edges of triangles without area, by part.
pub type Flat = BTreeMap<u32, Edges>;

/// Greatest absolute value of a coordinate relative to the origin: products of two coordinates, and reciprocals, must
/// stay in the range of single precision.
pub const FAR: f32 = 1e15;

/// True if a triangle is out of range with any origin. Such a triangle has no influence on the origin: otherwise one
/// wrong corner would move all other triangles out of range.
pub fn is_too_large(corners: &[DVec3; 3]) -> bool {
    let [a, b, c] = *corners;
    // Halves first: the difference of two finite numbers may be infinite.
    let half = (a.max(b).max(c) * 0.5 - a.min(b).min(c) * 0.5).max_element();
    half > f64::from(FAR)
}

/// Returns the origin of a mesh. It is zero if that keeps every coordinate exact and the mesh is near zero. Otherwise
/// it is the middle of the bounds, rounded to a multiple of a power of two near a sixteenth of the size, so that moving
/// a mesh by such a multiple does not change the stored positions.
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
    // Halves first: the sum of two finite numbers may be infinite.
    let middle = bounds.min * 0.5 + bounds.max * 0.5;
    let rounded = (middle / step).round() * step;
    if rounded.is_finite() { rounded } else { middle }
}

/// Numbers of kept and dropped triangles.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Fates {
    /// Triangles in the tree.
    pub kept: u64,
    /// Dropped triangles without area.
    pub degenerate: u64,
    /// Dropped triangles that are too far from the origin.
    pub out_of_range: u64,
    /// Greatest distance between a vertex of the input and the stored vertex.
    pub position_error: f64,
}

impl Fates {
    /// Returns these for a mesh some of whose corners were moved by up to `by` before.
    pub fn moved(self, by: f64) -> Self {
        Self { position_error: self.position_error.max(by), ..self }
    }

    /// Returns the sum of both, and the greater position error.
    pub fn and(self, o: &Self) -> Self {
        Self {
            kept: self.kept + o.kept,
            degenerate: self.degenerate + o.degenerate,
            out_of_range: self.out_of_range + o.out_of_range,
            position_error: self.position_error.max(o.position_error),
        }
    }
}

/// Destination of the triangles of a batch.
struct Target<'a> {
    triangles: &'a mut [[Vec3; 3]],
    parts: &'a mut [u32],
    prims: &'a mut [u32],
    colours: &'a mut [[[u8; 4]; 3]],
    normals: &'a mut [[u32; 3]],
}

/// Rounds a mesh to single precision relative to its origin. Consumes the spool batch by batch. Fails with `Cancelled`,
/// or with `Io` if a part of the mesh is in a scratch file.
pub fn place(spool: Spool, scratch: Option<&Scratch>, par: &Par, cancel: &Cancel) -> Result<Placed> {
    let (origin, has) = (spool.origin, spool.has);
    gather(spool.take(), scratch, origin, has, par, cancel)
}

/// Calls `keep` with the index and the stored corners of each triangle that is kept.
pub fn visit(batch: &Batch, origin: DVec3, keep: impl FnMut(usize, [Vec3; 3])) -> Fates {
    visit_all(batch, origin, keep, |_, _| ())
}

/// [`visit`]. Also calls `flat` for each triangle that is dropped because it has no area.
pub fn visit_all(
    batch: &Batch,
    origin: DVec3,
    mut keep: impl FnMut(usize, [Vec3; 3]),
    mut flat: impl FnMut(usize, [Vec3; 3]),
) -> Fates {
    let mut fates = Fates::default();
    for i in 0..batch.positions.len() {
        let corners = batch.positions.triangle(i);
        let stored = corners.map(|c| (c - origin).as_vec3());
        if !stored.iter().all(|c| c.abs().max_element() <= FAR) {
            fates.out_of_range += 1;
        } else if !has_area(&stored) {
            fates.degenerate += 1;
            flat(i, stored);
        } else {
            fates.kept += 1;
            let errors = corners.iter().zip(&stored).map(|(c, s)| (*c - (origin + s.as_dvec3())).length_squared());
            fates.position_error = errors.fold(fates.position_error, f64::max);
            keep(i, stored);
        }
    }
    fates.position_error = fates.position_error.sqrt();
    fates
}

/// Loads the triangles of a chunk, which were placed before.
pub fn load(extents: &[Extent], from: &Scratch, has: Has, par: &Par, cancel: &Cancel) -> Result<Placed> {
    let batches = extents.iter().copied().map(Taken::Spilled).collect();
    gather(batches, Some(from), DVec3::ZERO, has, par, cancel)
}

/// Returns the kept triangles of all batches, relative to `origin`.
fn gather(
    batches: Vec<Taken>,
    scratch: Option<&Scratch>,
    origin: DVec3,
    has: Has,
    par: &Par,
    cancel: &Cancel,
) -> Result<Placed> {
    let counts: Vec<usize> = batches.iter().map(Taken::len).collect();
    // With room for all triangles: mostly all are kept.
    let mut all = Placed::of(counts.iter().sum(), origin, has)?;
    let work: Vec<_> = batches.into_iter().zip(targets(&mut all, &counts)).collect();
    let fill = |(batch, target): (Taken, Target)| -> Result<(Fates, Flat)> {
        cancel.check()?;
        Ok(fill(&batch.batch(scratch)?, origin, target))
    };
    let mut fates = Vec::with_capacity(counts.len());
    for filled in par.map_items(work, fill) {
        let (fate, flat) = filled?;
        fates.push(fate);
        flat.into_iter().for_each(|(part, edges)| all.flat.entry(part).or_default().add(edges));
    }
    all.close_gaps(&counts, &fates);
    Ok(all)
}

impl Placed {
    /// Returns arrays for `count` triangles in memory that is not yet touched: the threads that fill it touch it first.
    fn of(count: usize, origin: DVec3, has: Has) -> Result<Self> {
        let what = "triangles of a mesh";
        Ok(Self {
            origin,
            triangles: zeroed(count, what)?,
            parts: zeroed(count, what)?,
            prims: zeroed(count, what)?,
            values: Values {
                colours: zeroed(if has.colours { count } else { 0 }, what)?,
                normals: zeroed(if has.normals { count } else { 0 }, what)?,
            },
            fates: Fates::default(),
            flat: Flat::new(),
        })
    }

    /// Closes the gaps behind the kept triangles of each batch. `counts`: triangles of each batch. (One thread copies
    /// everything behind the first dropped triangle; mostly none is dropped.)
    fn close_gaps(&mut self, counts: &[usize], fates: &[Fates]) {
        fn keep<T: Copy>(all: &mut Vec<T>, spans: &[(usize, usize)]) {
            if all.is_empty() {
                return;
            }
            let mut to = 0;
            for &(from, kept) in spans {
                if to < from {
                    all.copy_within(from..from + kept, to);
                }
                to += kept;
            }
            all.truncate(to);
        }
        self.fates = fates.iter().fold(Fates::default(), Fates::and);
        let begins = counts.iter().scan(0, |at, count| Some(std::mem::replace(at, *at + count)));
        let spans: Vec<_> = begins.zip(fates.iter().map(|f| f.kept as usize)).collect();
        keep(&mut self.triangles, &spans);
        keep(&mut self.parts, &spans);
        keep(&mut self.prims, &spans);
        keep(&mut self.values.colours, &spans);
        keep(&mut self.values.normals, &spans);
    }
}

fn targets<'a>(all: &'a mut Placed, counts: &[usize]) -> Vec<Target<'a>> {
    // Returns an empty slice of an empty one: mostly there are no colours.
    fn carve<'a, T>(rest: &mut &'a mut [T], len: usize) -> &'a mut [T] {
        let len = len.min(rest.len());
        let (front, back) = std::mem::take(rest).split_at_mut(len);
        *rest = back;
        front
    }
    let (mut triangles, mut parts) = (&mut all.triangles[..], &mut all.parts[..]);
    let Values { colours, normals } = &mut all.values;
    let (mut prims, mut colours, mut normals) = (&mut all.prims[..], &mut colours[..], &mut normals[..]);
    let mut target = |count: usize| Target {
        triangles: carve(&mut triangles, count),
        parts: carve(&mut parts, count),
        prims: carve(&mut prims, count),
        colours: carve(&mut colours, count),
        normals: carve(&mut normals, count),
    };
    counts.iter().map(|&count| target(count)).collect()
}

/// Writes the kept triangles of a batch to the front of `to`.
fn fill(batch: &Batch, origin: DVec3, to: Target) -> (Fates, Flat) {
    let (mut at, mut flat) = (0, Flat::new());
    let keep = |i: usize, stored| {
        to.triangles[at] = stored;
        to.parts[at] = batch.parts[i];
        to.prims[at] = batch.prims[i];
        if !to.colours.is_empty() {
            to.colours[at] = batch.values.colours.get(i).copied().unwrap_or(NO_COLOURS);
        }
        if !to.normals.is_empty() {
            to.normals[at] = batch.values.normals.get(i).copied().unwrap_or(NO_NORMALS);
        }
        at += 1;
    };
    let fates = visit_all(batch, origin, keep, |i, stored: [Vec3; 3]| {
        flat.entry(batch.parts[i]).or_default().add(Edges::of(origin, stored.map(Vec3::as_dvec3)));
    });
    (fates, flat)
}

/// True if the stored corners are not on one line.
pub fn has_area([a, b, c]: &[Vec3; 3]) -> bool {
    if a == b || b == c || c == a {
        return false;
    }
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    (b - a).cross(c - a) != DVec3::ZERO
}

#[cfg(test)]
mod tests {
    use super::super::batch::BATCH;
    use super::super::values::Value;
    use super::*;

    /// Dropped triangles leave no gaps: in batches of which some, none or all triangles are kept, with several threads
    /// and with one, with colours and without.
    #[test]
    fn kept_triangles_are_in_order_without_gaps() {
        let stays = |i: usize| match i / BATCH {
            0 => i % 3 != 1,
            1 => false,
            2 => true,
            _ => i.is_multiple_of(2),
        };
        let colour = |i: usize| [i as u8, (i >> 8) as u8, (i >> 16) as u8, 255];
        let count = 4 * BATCH + 77;
        for (threads, coloured) in [(1, false), (2, true)] {
            let mut spool = Spool::new(5);
            for i in 0..count {
                let (at, high) = (DVec3::X * (i % 1000) as f64, if stays(i) { 1.0 } else { 0.0 });
                let colours = coloured.then_some([colour(i), colour(i + 1), colour(i + 2)]);
                let value = Value { colours, normals: coloured.then_some([i as u32, 1, 2]) };
                spool.push(&[at, at + DVec3::Y, at + DVec3::Z * high], i as u32 % 5, i as u32, value).expect("room");
            }
            let placed = place(spool, None, &Par { threads }, &Cancel::new()).expect("in memory");
            let expected: Vec<usize> = (0..count).filter(|i| stays(*i)).collect();
            assert_eq!(
                (placed.fates.kept, placed.fates.degenerate),
                (expected.len() as u64, (count - expected.len()) as u64)
            );
            assert!(placed.prims.iter().map(|prim| *prim as usize).eq(expected.iter().copied()));
            assert!(placed.parts.iter().zip(&expected).all(|(part, i)| *part == *i as u32 % 5));
            assert!(
                placed
                    .triangles
                    .iter()
                    .zip(&expected)
                    .all(|(t, i)| t[0].x - placed.triangles[0][0].x == (i % 1000) as f32)
            );
            assert_eq!((placed.triangles.len(), placed.parts.len()), (expected.len(), expected.len()));
            let Values { colours, normals } = &placed.values;
            let count = if coloured { expected.len() } else { 0 };
            assert_eq!((colours.len(), normals.len()), (count, count));
            assert!(colours.iter().zip(&expected).all(|(c, i)| *c == [colour(*i), colour(i + 1), colour(i + 2)]));
            assert!(normals.iter().zip(&expected).all(|(n, i)| *n == [*i as u32, 1, 2]));
        }
    }

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
