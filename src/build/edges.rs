//! The edges of parts, summed up: whether a part is closed, found in one pass in constant memory for each part.
//!
//! Each edge of each triangle has a hash of 128 bits of its two ends. The sum of the hashes, each with the sign of the
//! edge's direction, vanishes if every edge is passed as often in one direction as in the other: then the surface is
//! closed, and its triangles face one way. The exclusive or of the hashes vanishes if every edge belongs to an even
//! number of triangles: then the surface is closed, but may have no inside. Either vanishes by chance once in 2^128.
//! The order of the triangles has no influence.
//!
//! Ends are equal if their stored positions in the mesh are. Triangles without area, which no tree holds, count too:
//! they close the gap along an edge where one neighbour has a corner that the other lacks.

use crate::store::PartRow;
use glam::{DAffine3, DVec3};

/// The sums of a set of edges.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Edges {
    directed: u128,
    parity: u128,
}

/// Random numbers.
const SALT: [u64; 8] = [
    0x243f_6a88_85a3_08d3,
    0x1319_8a2e_0370_7344,
    0xa409_3822_299f_31d0,
    0x082e_fa98_ec4e_6c89,
    0x4528_21e6_38d0_1377,
    0xbe54_66cf_34e9_0c6c,
    0xc0ac_29b7_c97c_50dd,
    0x3f84_d5b5_b547_0917,
];

impl Edges {
    /// No edges.
    pub const NONE: Self = Self { directed: 0, parity: 0 };

    /// The edges of a triangle. `origin`: the point of the mesh that the corners are relative to.
    #[inline]
    pub fn of(origin: DVec3, corners: [DVec3; 3]) -> Self {
        let [a, b, c] = corners.map(|corner| hash(origin + corner));
        let mut all = Self::default();
        [(a, b), (b, c), (c, a)].into_iter().for_each(|(from, to)| all.push(from, to));
        all
    }

    /// The edges around a set of triangles, of which all others are passed once in each direction. Corners are relative
    /// to `origin`, in the direction of the triangles.
    pub fn around(origin: DVec3, corners: impl Iterator<Item = DVec3>) -> Self {
        let hashes: Vec<u64> = corners.map(|corner| hash(origin + corner)).collect();
        let mut all = Self::default();
        for (i, from) in hashes.iter().enumerate() {
            all.push(*from, hashes[(i + 1) % hashes.len()]);
        }
        all
    }

    /// Adds an edge between the ends with these hashes.
    #[inline]
    fn push(&mut self, from: u64, to: u64) {
        let (least, greatest) = (from.min(to), from.max(to));
        let low = fold(least ^ SALT[0], greatest ^ SALT[1]);
        let high = fold(least.rotate_left(31) ^ SALT[2], greatest.rotate_left(17) ^ SALT[3]);
        let edge = u128::from(high) << 64 | u128::from(low);
        if from == to {
            return;
        }
        self.parity ^= edge;
        self.directed = if from < to { self.directed.wrapping_add(edge) } else { self.directed.wrapping_sub(edge) };
    }

    /// Adds other edges.
    #[inline]
    pub fn add(&mut self, others: Self) {
        self.directed = self.directed.wrapping_add(others.directed);
        self.parity ^= others.parity;
    }

    /// Removes edges that were added.
    pub fn remove(&mut self, others: Self) {
        self.directed = self.directed.wrapping_sub(others.directed);
        self.parity ^= others.parity;
    }

    /// The sums of the edges in a place: edges in two places do not cancel out.
    pub fn placed(self, world_from_mesh: &DAffine3) -> Self {
        let numbers = world_from_mesh.to_cols_array().map(|x| (x + 0.0).to_bits());
        let hash = |salt: [u64; 2]| numbers.iter().fold(salt[0], |all, x| fold(all ^ x, salt[1]) ^ all.rotate_left(9));
        let high = hash([SALT[4], SALT[5]]);
        // An odd factor keeps all but 0 from becoming 0.
        let factor = u128::from(high) << 64 | u128::from(hash([SALT[6], SALT[7]]) | 1);
        let shifted = |bit: u32| if factor >> bit & 1 == 1 { self.parity << bit } else { 0 };
        // The same for sums without carry: a product of polynomials.
        let parity = if self.parity == 0 { 0 } else { (0..128).fold(0, |all, bit| all ^ shifted(bit)) };
        Self { directed: self.directed.wrapping_mul(factor), parity }
    }

    /// The flags of a part with these edges: see [`PartRow::flags`].
    pub fn flags(self) -> u32 {
        match self {
            Self { directed: 0, parity: 0 } => PartRow::CLOSED | PartRow::ORIENTED,
            Self { parity: 0, .. } => PartRow::CLOSED,
            _ => 0,
        }
    }
}

/// A hash of a position. (Of 10⁹ positions two are equal in one model out of forty; a part then seems closed only if
/// these are the ends of its open edges.)
#[inline]
fn hash(p: DVec3) -> u64 {
    // The sum makes one zero of both.
    let [x, y, z] = (p + DVec3::ZERO).to_array().map(f64::to_bits);
    fold(fold(x ^ SALT[4], y ^ SALT[5]) ^ SALT[6], z ^ SALT[7])
}

/// The halves of a product, mixed.
#[inline]
fn fold(a: u64, b: u64) -> u64 {
    let product = u128::from(a) * u128::from(b);
    product as u64 ^ (product >> 64) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sum(triangles: &[[DVec3; 3]]) -> Edges {
        let mut all = Edges::default();
        triangles.iter().for_each(|&t| all.add(Edges::of(DVec3::ZERO, t)));
        all
    }

    fn tetrahedron() -> Vec<[DVec3; 3]> {
        let p = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|t| t.map(|i: usize| p[i])).to_vec()
    }

    const BOTH: u32 = PartRow::CLOSED | PartRow::ORIENTED;

    #[test]
    fn closed_open_turned_and_doubled() {
        let closed = tetrahedron();
        assert_eq!(sum(&closed).flags(), BOTH);
        assert_eq!(sum(&closed[1..]).flags(), 0);
        let mut turned = closed.clone();
        turned[2].swap(0, 1);
        assert_eq!(sum(&turned).flags(), PartRow::CLOSED);
        // One face twice: three of the edges belong to three triangles.
        assert_eq!(sum(&[&closed[..], &closed[..1]].concat()).flags(), 0);
        assert_eq!(sum(&[&closed[..], &closed[..]].concat()).flags(), BOTH);
        assert_eq!(sum(&[closed[0]; 2]).flags(), PartRow::CLOSED);
        // Zeros of both signs are one position.
        let minus = closed.iter().map(|t| t.map(|p| if p.x == 0.0 { DVec3::new(-0.0, p.y, p.z) } else { p }));
        assert_eq!(sum(&[minus.take(2).collect(), closed[2..].to_vec()].concat()).flags(), BOTH);
    }

    #[test]
    fn a_triangle_without_area_closes_a_gap() {
        // The edge from x to y has a corner in its middle on one side.
        let (mut t, middle) = (tetrahedron(), DVec3::new(0.5, 0.5, 0.0));
        let [x, y, z] = t.pop().expect("a face");
        t.extend([[x, middle, z], [middle, y, z]]);
        assert_eq!(sum(&t).flags(), 0);
        t.push([x, y, middle]);
        assert_eq!(sum(&t).flags(), BOTH);
        t.extend([[x, x, y], [z, z, z]]);
        assert_eq!(sum(&t).flags(), BOTH);
    }

    #[test]
    fn halves_close_each_other_in_one_place_only() {
        let t = tetrahedron();
        let halves = [sum(&t[..2]), sum(&t[2..])];
        let (here, there) = (DAffine3::from_translation(DVec3::X), DAffine3::from_translation(DVec3::Y));
        let joined = |places: [&DAffine3; 2]| {
            let mut all = halves[0].placed(places[0]);
            all.add(halves[1].placed(places[1]));
            all.flags()
        };
        assert_eq!([joined([&here, &here]), joined([&here, &there])], [BOTH, 0]);
        assert_eq!(sum(&t).placed(&there).flags(), BOTH);
        let mut all = sum(&t);
        all.remove(halves[0]);
        assert_eq!(all, halves[1]);
    }
}
