//! Partition of a range: its left side moves to the front.

use super::refs::Ref;
use super::sah::{Extents, Split};
use crate::structure::par::Par;

/// Number of references of a chunk. In a range of more than [`PARALLEL`] references, chunks are partitioned in
/// parallel. The result depends on this number, so it does not depend on the number of threads.
const CHUNK: usize = 1 << 15;
const PARALLEL: usize = 1 << 17;

/// Two sides: the start of the right one, and the extents of both.
pub struct Sides {
    /// Number of references on the left.
    pub middle: usize,
    /// Extents of the left side.
    pub left: Extents,
    /// Extents of the right side.
    pub right: Extents,
}

/// Moves the left side of `split` to the front. The order inside each side depends only on the previous order.
pub fn by_split(refs: &mut [Ref], split: &Split, par: &Par) -> Sides {
    if refs.len() < PARALLEL {
        return one(refs, split);
    }
    let chunks: Vec<&mut [Ref]> = refs.chunks_mut(CHUNK).collect();
    let sides = par.map_items(chunks, |chunk| one(chunk, split));
    let middle = gather(refs, &sides);
    let merged = |of: fn(&Sides) -> Extents| sides.iter().map(of).fold(Extents::EMPTY, Extents::merge);
    Sides { middle, left: merged(|s| s.left), right: merged(|s| s.right) }
}

/// Partitions a range without branches that depend on the side: they would be mispredicted.
fn one(refs: &mut [Ref], split: &Split) -> Sides {
    let mut sides = [Extents::EMPTY; 2];
    let mut middle = 0;
    for i in 0..refs.len() {
        let r = refs[i];
        let is_left = split.is_left(&r);
        refs[i] = refs[middle];
        refs[middle] = r;
        middle += usize::from(is_left);
        sides[usize::from(is_left)].add(&r);
    }
    let [right, left] = sides;
    Sides { middle, left, right }
}

/// Swaps the left sides of chunks that lie after the middle with the right sides of chunks before it. Returns the
/// middle.
fn gather(refs: &mut [Ref], sides: &[Sides]) -> usize {
    let total = refs.len();
    let middle = sides.iter().map(|s| s.middle).sum();
    let (front, back) = refs.split_at_mut(middle);
    let span = |c: usize| (c * CHUNK, c * CHUNK + sides[c].middle, ((c + 1) * CHUNK).min(total));
    // Right sides in the front and left sides in the back: they have equally many references.
    let mut wrong_front = (0..sides.len()).map(span).map(|(_, from, to)| from.min(middle)..to.min(middle));
    let mut wrong_back =
        (0..sides.len()).map(span).map(|(from, to, _)| from.max(middle) - middle..to.max(middle) - middle);
    let (mut a, mut b) = (0..0, 0..0);
    loop {
        while a.is_empty() {
            let Some(next) = wrong_front.next() else { return middle };
            a = next;
        }
        while b.is_empty() {
            let Some(next) = wrong_back.next() else { return middle };
            b = next;
        }
        let n = a.len().min(b.len());
        front[a.start..a.start + n].swap_with_slice(&mut back[b.start..b.start + n]);
        a.start += n;
        b.start += n;
    }
}

/// Halves a range by the centres on the widest axis, if the heuristic cannot split it or it is too deep.
pub fn by_median(refs: &mut [Ref], extents: &Extents, par: &Par) -> Sides {
    let axis = extents.widest_axis();
    let middle = refs.len() / 2;
    refs.select_nth_unstable_by(middle, |a, b| {
        a.center2()[axis].total_cmp(&b.center2()[axis]).then(a.triangle().cmp(&b.triangle()))
    });
    let (left, right) = refs.split_at(middle);
    Sides { middle, left: Extents::of(left, par), right: Extents::of(right, par) }
}

#[cfg(test)]
mod tests {
    use super::super::sah;
    use super::*;
    use crate::math::Bounds;
    use glam::Vec3;

    /// Returns scattered boxes, enough for a partition in parallel.
    fn scattered() -> Vec<Ref> {
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 65536.0
        };
        let boxes = (0..PARALLEL + 3 * CHUNK / 2).map(|_| {
            let low = Vec3::new(next(), next(), next());
            Bounds { min: low, max: low + Vec3::new(next(), next(), next()) * 0.01 }
        });
        boxes.enumerate().map(|(i, b)| Ref::new(b, i as u32)).collect()
    }

    #[test]
    fn chunks_partitioned_in_parallel_make_the_same_sides_with_any_threads() {
        let before = scattered();
        let mut orders = Vec::new();
        for threads in [1, 2] {
            let (par, mut refs) = (Par { threads }, before.clone());
            let split = sah::find(&refs, &Extents::of(&refs, &par), &par).expect("scattered");
            let sides = by_split(&mut refs, &split, &par);
            let (left, right) = refs.split_at(sides.middle);
            assert!(left.iter().all(|r| split.is_left(r)) && !right.iter().any(|r| split.is_left(r)));
            assert!(!left.is_empty() && !right.is_empty());
            assert_eq!(sides.left.bounds(), Extents::of(left, &par).bounds());
            assert_eq!(sides.right.bounds(), Extents::of(right, &par).bounds());
            // The bins had the same sides.
            assert_eq!((sides.left.bounds(), sides.right.bounds()), (split.left, split.right));
            orders.push(refs.iter().map(Ref::triangle).collect::<Vec<_>>());
        }
        assert_eq!(orders[0], orders[1]);
        orders[0].sort_unstable();
        assert!(orders[0].iter().copied().eq(0..before.len()));
    }
}
