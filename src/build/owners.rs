//! The trees of the triangles of a divided mesh (`split`), and the positions of their corners in each.
//!
//! Every vertex has an owner: the place whose details it is a corner of, or else the mesh. Trees are numbered as their
//! owners are: 0 is the mesh's own tree, and `i + 1` that of place `i`.
//!
//! Nothing cracks between trees, for some tree has all triangles around each vertex. A triangle whose corners have
//! several owners goes to one that knows the positions of all its corners as well as their owners do: then it is in no
//! other tree, where a corner at a detail would stand beside it. That tree also has all triangles around those of its
//! corners that it does not own. If there is no such owner (the triangle spans two details), it goes to all of them.
//!
//! A vertex has the same position in all trees that know it that well. In others it is moved by a few units of their
//! rounding towards their origin, so that a triangle that spans two details ends before the other one, and hides
//! nothing of it.

use super::bloom::{self, Bloom};
use super::places::{Places, crosses};
use super::shares::Shares;
use crate::base::error::Result;
use crate::math::DBounds;
use glam::DVec3;
use xxhash_rust::xxh3::xxh3_64;

/// Bits of [`Pairs`] for each triangle: 32 to 64 for a vertex, of which eight are set.
const BITS: u64 = 192;

/// A triangle near a place's details, up to this fraction of their extent away, belongs to the place if it can.
const MARGIN: f64 = 0.25;

/// Number of units of rounding by which a vertex is moved in a tree that does not know its position.
const MOVED: f64 = 4.0;

/// Trees of the triangles of a mesh. The sets are filled in this order, each in one pass over the triangles that needs
/// the ones before.
pub struct Owners<'a> {
    pub places: &'a Places,
    /// Corners of the details of each place.
    pub details: Pairs,
    /// Vertices of other owners around which a tree has all triangles.
    pub around: Pairs,
    /// Vertices of other owners in a tree.
    pub shared: Pairs,
}

/// A mark: a vertex and a tree.
pub type Mark = (u64, usize);

impl<'a> Owners<'a> {
    /// Owners without marks.
    pub fn new(places: &'a Places) -> Result<Self> {
        Ok(Self { places, details: Pairs::none()?, around: Pairs::none()?, shared: Pairs::none()? })
    }

    /// The origin of a tree.
    pub fn origin(&self, tree: usize) -> DVec3 {
        if tree == 0 { self.places.origin } else { self.places.place(tree - 1).origin }
    }

    /// Greatest distance from the origin of a tree on any axis.
    fn reach(&self, tree: usize, p: DVec3) -> f64 {
        (p - self.origin(tree)).abs().max_element()
    }

    /// The tree that a vertex belongs to: the nearest of those with a detail there.
    fn owner(&self, p: DVec3) -> usize {
        let hash = hash(p);
        if !self.details.may_have(hash) {
            return 0;
        }
        let mut best = (f64::INFINITY, 0);
        self.places.overlapping(&DBounds::of(&[p]), |index, _| {
            let reach = self.reach(index + 1, p);
            if reach < best.0 && self.details.has(hash, index + 1) {
                best = (reach, index + 1);
            }
        });
        best.1
    }

    /// True if a tree knows the position of a vertex as well as its owner does.
    fn knows(&self, tree: usize, p: DVec3, owner: usize) -> bool {
        tree == owner || self.reach(tree, p) <= 2.0 * self.reach(owner, p) || stored(p, self.origin(tree)) == p
    }

    /// The trees of a triangle by the owners of its corners alone.
    fn base(&self, corners: &[DVec3; 3], owners: &[usize; 3], trees: &mut Vec<usize>) {
        let knows_all = |tree: usize| (0..3).all(|i| self.knows(tree, corners[i], owners[i]));
        trees.clear();
        if *owners == [0; 3] {
            trees.push(self.crossed(corners, knows_all).unwrap_or(0));
            return;
        }
        trees.extend(owners);
        // The mesh's own tree comes last.
        trees.sort_by_key(|&tree| tree.wrapping_sub(1));
        trees.dedup();
        if let Some(one) = trees.iter().copied().find(|&tree| knows_all(tree)) {
            trees.clear();
            trees.push(one);
        }
    }

    /// The tree of the smallest place that a triangle without a corner there crosses, as the ground does at a bolt.
    fn crossed(&self, corners: &[DVec3; 3], knows_all: impl Fn(usize) -> bool) -> Option<usize> {
        let mut best: Option<(f64, usize)> = None;
        self.places.overlapping(&DBounds::of(corners), |index, place| {
            let extent = place.bounds.extent().max_element();
            if best.is_some_and(|(least, _)| extent >= least) || !knows_all(index + 1) {
                return;
            }
            let margin = DVec3::splat(extent * MARGIN);
            let wide = DBounds { min: place.bounds.min - margin, max: place.bounds.max + margin };
            if crosses(corners, &wide) {
                best = Some((extent, index + 1));
            }
        });
        best.map(|(_, tree)| tree)
    }

    /// Sets the trees of a triangle. The first is the one that counts it.
    fn trees(&self, corners: &[DVec3; 3], owners: &[usize; 3], trees: &mut Vec<usize>) {
        self.base(corners, owners, trees);
        for hash in corners.map(hash) {
            if self.around.may_have(hash) {
                for tree in 0..=self.places.len() {
                    if self.around.has(hash, tree) && !trees.contains(&tree) {
                        trees.push(tree);
                    }
                }
            }
        }
    }

    /// Marks of the corners of a detail.
    pub fn detail_marks(&self, corners: &[DVec3; 3], place: usize, marks: &mut Vec<Mark>) {
        marks.extend(corners.map(|p| (hash(p), place + 1)));
    }

    /// Marks of the vertices around which the tree of this triangle needs all triangles.
    pub fn around_marks(&self, corners: &[DVec3; 3], trees: &mut Vec<usize>, marks: &mut Vec<Mark>) {
        let owners = corners.map(|p| self.owner(p));
        self.base(corners, &owners, trees);
        if let [tree] = trees[..] {
            marks.extend((0..3).filter(|&i| owners[i] != tree).map(|i| (hash(corners[i]), tree)));
        }
    }

    /// Marks of the corners that are in trees that do not own them.
    pub fn shared_marks(&self, corners: &[DVec3; 3], trees: &mut Vec<usize>, marks: &mut Vec<Mark>) {
        let owners = corners.map(|p| self.owner(p));
        self.trees(corners, &owners, trees);
        for &tree in &*trees {
            marks.extend((0..3).filter(|&i| owners[i] != tree).map(|i| (hash(corners[i]), tree)));
        }
    }

    /// Calls `put` with each tree of a triangle and its corners there.
    pub fn put(&self, corners: &[DVec3; 3], trees: &mut Vec<usize>, mut put: impl FnMut(usize, [DVec3; 3])) {
        let owners = corners.map(|p| self.owner(p));
        self.trees(corners, &owners, trees);
        for &tree in &*trees {
            put(tree, std::array::from_fn(|i| self.position(corners[i], owners[i], tree)));
        }
    }

    /// The position of a vertex in a tree.
    fn position(&self, p: DVec3, owner: usize, tree: usize) -> DVec3 {
        let hash = hash(p);
        if !self.knows(tree, p, owner) {
            let unit = last_digit(self.reach(tree, p));
            return p + (self.origin(tree) - p).normalize_or_zero() * unit * MOVED;
        }
        if !self.shared.may_have(hash) {
            return p;
        }
        let others = (0..=self.places.len()).filter(|&other| self.shared.has(hash, other));
        let origins: Vec<DVec3> = std::iter::once(owner)
            .chain(others.filter(|&other| self.knows(other, p, owner)))
            .map(|tree| self.origin(tree))
            .collect();
        if origins.len() == 1 || origins.iter().all(|&origin| stored(p, origin) == p) {
            return p;
        }
        on_all_lattices(p, &origins)
    }
}

/// The position that a tree with this origin stores.
pub fn stored(p: DVec3, origin: DVec3) -> DVec3 {
    origin + (p - origin).as_vec3().as_dvec3()
}

/// A position near `p` that is exact in single precision relative to all of `origins`, if their differences have so few
/// digits.
fn on_all_lattices(p: DVec3, origins: &[DVec3]) -> DVec3 {
    let from = origins[0];
    let step = origins
        .iter()
        .fold(DVec3::ZERO, |step, &origin| step.max(DVec3::from_array((p - origin).abs().to_array().map(last_digit))));
    from + ((p - from) / step).round() * step
}

/// The value of the last digit of a number in single precision.
fn last_digit(x: f64) -> f64 {
    (x.max(f64::from(f32::MIN_POSITIVE)).log2().floor() - 23.0).exp2()
}

/// A hash of a position.
fn hash(p: DVec3) -> u64 {
    // The sum makes one zero of both.
    xxh3_64(bytemuck::bytes_of(&(p + DVec3::ZERO).to_array()))
}

/// A set of pairs of a vertex and a tree, and of their vertices. It may hold pairs that were not inserted.
pub struct Pairs {
    set: Bloom,
}

impl Pairs {
    fn none() -> Result<Self> {
        Ok(Self { set: Bloom::with_bits(0, "vertices of details")? })
    }

    /// An empty set for the corners of `triangles` triangles, in less memory than the triangles that wait, or 2 MiB if
    /// that is more. (A smaller set takes more triangles for neighbours of a detail, which are then in two trees.)
    pub fn of(triangles: u64, shares: &Shares) -> Result<Self> {
        let most = shares.waiting.min(1 << 32);
        let words = 1 << (triangles.saturating_mul(BITS) / 64).clamp(1 << 12, most.max(1 << 18)).ilog2();
        Ok(Self { set: Bloom::with_bits(64 * words, "vertices of details")? })
    }

    /// Adds pairs.
    pub fn insert(&mut self, marks: &[Mark]) {
        for &(hash, tree) in marks {
            self.set.insert(hash);
            self.set.insert(bloom::pair(hash, tree));
        }
    }

    /// True if there is any pair with this vertex.
    fn may_have(&self, hash: u64) -> bool {
        self.set.has(hash)
    }

    fn has(&self, hash: u64, tree: usize) -> bool {
        self.set.has(bloom::pair(hash, tree))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_is_exact_relative_to_all_origins() {
        let origins = [DVec3::new(4096.0, -512.0, 0.0), DVec3::new(-30000.25, 20000.5, 0.125), DVec3::ZERO];
        for p in [DVec3::new(4096.0001, 777.123456, -0.0123), DVec3::new(-30000.2501, 20000.5, 1e-9)] {
            let at = on_all_lattices(p, &origins);
            assert!(origins.iter().all(|&origin| stored(at, origin) == at), "{at}");
            assert!((at - p).abs().max_element() <= 0.001, "{at} is not near {p}");
        }
    }

    #[test]
    fn pairs_are_found_again_and_others_mostly_not() {
        let mut pairs = Pairs::of(1000, &Shares::of(0).expect("shares")).expect("memory");
        let vertex = |i: usize| hash(DVec3::new(i as f64, 0.3, -7.0));
        pairs.insert(&(0..500).map(|i| (vertex(i), i % 7)).collect::<Vec<_>>());
        assert!((0..500).all(|i| pairs.may_have(vertex(i)) && pairs.has(vertex(i), i % 7)));
        let wrong = (0..500).filter(|&i| pairs.has(vertex(i), i % 7 + 1) || pairs.may_have(vertex(i + 500))).count();
        assert!(wrong < 5, "{wrong}");
        assert_eq!(hash(DVec3::new(0.0, 1.0, 2.0)), hash(DVec3::new(-0.0, 1.0, 2.0)));
    }
}
