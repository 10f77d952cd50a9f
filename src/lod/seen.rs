//! What a ray sees of a voxel that has a sample for each side: three of them, blended.
//!
//! A cell is seen through the three of its sides that face the ray, each by as much as there is to see: the share of the side that is
//! covered, of its area as the ray sees it. Not by which side the ray enters: a tall cell of a few blocks shows their tops, though its
//! own top is small. (Áfra 2012, section 4.2, takes the sample of the side that is entered.)
//!
//! How much of the light comes back is told by the lengths of mean normals. Seen from one side, a flat piece has one of length 1, and so has
//! a block, of which just a face is seen; a sphere's is 2/3 long, and facets that face anywhere come to the same. So of what a length lacks
//! of 1 three times as much is taken to face anywhere, and the rest as the mean does. Blended without making them unit again, blocks,
//! spheres and flat pieces then answer a light where the eye is as they do, seen from anywhere.

use super::coded::{stored_colour, stored_cover, stored_likeness, stored_normal};
use glam::Vec3;

/// Of a side of which nothing is seen, so that there always is a blend.
const LEAST_SEEN: f32 = 1e-6;

/// Shares of three sides, that add up to 1.
///
/// `extent`: of the cell; `dir`: of the ray in the cell's frame; `seconds`: the second words of the samples of the sides across x, y and z
/// that face the ray.
#[inline(always)]
pub fn shares(extent: Vec3, dir: Vec3, firsts: [u32; 3], seconds: [u32; 3]) -> [f32; 3] {
    let (e, d) = (in_proportion(extent), in_proportion(dir.abs()));
    let g = |c: f32| match var(0) {
        1 => if c > 0.0 { 1.0 } else { 0.0 },
        2 => -(1.0 - 0.9 * c).ln(),
        3 => -(1.0 - 0.995 * c).ln(),
        _ => c,
    };
    let covers = Vec3::from(seconds.map(|s| g(stored_cover(s))));
    let alike = Vec3::from(firsts.map(stored_likeness));
    let covers = match var(3) { 1 => covers * alike, 2 => covers * alike * alike, _ => covers };
    let e = if var(2) == 1 { Vec3::ONE } else { e };
    let seen = (covers * Vec3::new(e.y * e.z, e.z * e.x, e.x * e.y) + LEAST_SEEN) * d;
    (seen / (seen.x + seen.y + seen.z)).to_array()
}

/// The largest component of a vector of no negative ones made 1: no product of them overflows.
#[inline(always)]
fn in_proportion(v: Vec3) -> Vec3 {
    let most = v.x.max(v.y).max(v.z);
    let is_usual = most > 1e-30 && most < 1e30;
    let by = if is_usual { 1.0 / most } else { 0.0 };
    // Of what is out of all proportion, all alike.
    let rest = if is_usual { 0.0 } else { 1.0 };
    Vec3::new(
        if is_usual { v.x * by } else { rest },
        if is_usual { v.y * by } else { rest },
        if is_usual { v.z * by } else { rest },
    )
}

/// How what is seen answers light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facing {
    /// Mean normals of what a ray sees of each side.
    normals: [Vec3; 3],
    /// Their shares.
    shares: [f32; 3],
}

impl Facing {
    /// All with one unit normal.
    pub fn flat(normal: Vec3) -> Self {
        Self { normals: [normal, Vec3::ZERO, Vec3::ZERO], shares: [1.0, 0.0, 0.0] }
    }

    /// Of the first `SIDES` of samples' first words, by their shares; `facing`: gives a normal of the cell's frame in the world, against
    /// the ray; `to_eye`: against the ray too, unit.
    #[inline(always)]
    pub fn of<const SIDES: usize>(firsts: [u32; 3], shares: [f32; 3], to_eye: Vec3, facing: impl Fn(Vec3) -> Vec3) -> Self {
        let mut normals = [Vec3::ZERO; 3];
        for side in 0..SIDES {
            normals[side] = visible(facing(stored_normal(firsts[side])), stored_likeness(firsts[side]), to_eye);
        }
        Self { normals, shares }
    }

    /// The mean of all normals.
    #[inline(always)]
    pub fn mean(&self) -> Vec3 {
        let ([a, b, c], [x, y, z]) = (self.normals, self.shares);
        // From zero: the sign of a zero must not depend on how many there are.
        Vec3::ZERO + a * x + b * y + c * z
    }

    /// The mean cosine between normals and a unit direction, of those that face it.
    pub fn cosine(&self, to: Vec3) -> f32 {
        self.normals.iter().zip(self.shares).map(|(n, share)| share * lit(*n, to)).sum()
    }
}

/// The mean of the normals that are seen, of those whose mean seen along `normal` is `likeness` long.
///
/// As if the normals were those of a spheroid, flat where they are alike and a sphere where their mean is 2/3 long: its projected area and
/// the mean of its visible normals have closed forms. (Heitz and others, The SGGX microflake distribution, 2015.) With T the mean of
/// n n', over area, the mean is T e / A(e), and A(e) goes as the root of e' T e; T is 2 l - 1 along the normal and 1 - l across,
/// which is so for those that are nearly alike, and for spheres.
#[inline(always)]
fn visible(normal: Vec3, likeness: f32, to_eye: Vec3) -> Vec3 {
    let across = if var(1) == 1 { 0.0 } else { (1.0 - likeness) / (2.0 * likeness - 1.0).max(1.0 - likeness).max(1e-6) };
    let likeness = if var(1) == 1 { 1.0 } else if var(1) == 2 { likeness.max(2.0/3.0) } else { likeness };
    let cosine = normal.dot(to_eye).max(0.0);
    let leaning = normal * cosine + (to_eye - normal * cosine) * across;
    let length = (cosine * cosine + across * (1.0 - cosine * cosine).max(0.0)).sqrt();
    if length > 1e-6 { leaning * (likeness / length) } else { normal * 1e-6 }
}

pub fn var(i: usize) -> i32 {
    static V: std::sync::OnceLock<[i32; 4]> = std::sync::OnceLock::new();
    V.get_or_init(|| [0, 1, 2, 3].map(|i| std::env::var(format!("OC_V{i}")).ok().and_then(|v| v.parse().ok()).unwrap_or(0)))[i]
}

/// The mean cosine between `to` and normals around `mean`, of those that face it; as if their cosines were spread evenly, as widely as
/// what the mean lacks of 1 says.
#[inline(always)]
fn lit(mean: Vec3, to: Vec3) -> f32 {
    let (cosine, square) = (mean.dot(to), mean.length_squared());
    // Those across the mean, of which there are two, vary; as the mean is that of what is seen, hardly those along.
    let variance = 0.45 * (1.0 - square).max(0.0) * (1.0 - cosine * cosine / square.max(1e-12)).max(0.0);
    let half = (3.0 * variance).sqrt();
    if cosine.abs() >= half { cosine.max(0.0) } else { (cosine + half) * (cosine + half) / (4.0 * half) }
}

/// The linear colour of samples' second words, by their shares.
#[inline(always)]
pub fn blended_colour(seconds: [u32; 3], shares: [f32; 3]) -> Vec3 {
    let mut colour = Vec3::ZERO;
    for (second, share) in seconds.into_iter().zip(shares) {
        colour += stored_colour(second) * share;
    }
    colour
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::coded::sample;
    use crate::lod::voxel::Sample;

    fn words(normal: Vec3, cover: f32) -> [u32; 2] {
        sample(&Sample { normal, colour: Vec3::ONE, cover })
    }

    /// What comes back of a light where the eye is.
    fn answer(sides: [[u32; 2]; 3], extent: Vec3, dir: Vec3) -> f32 {
        let shares = shares(extent, dir, sides.map(|s| s[0]), sides.map(|s| s[1]));
        let facing = Facing::of::<3>(sides.map(|s| s[0]), shares, -dir, |n| if n.dot(dir) > 0.0 { -n } else { n });
        facing.mean().dot(-dir)
    }

    const DIRS: [Vec3; 4] = [Vec3::new(-1.0, -1.0, -1.0), Vec3::new(-1.0, -0.2, -3.0), Vec3::new(-1.0, -1.0, 0.0), Vec3::new(0.0, 0.0, -1.0)];

    #[test]
    fn a_cuboid_answers_as_its_faces_do() {
        let extent = Vec3::new(1.0, 2.0, 5.0);
        let sides = [Vec3::X, Vec3::Y, Vec3::Z].map(|n| words(n, 1.0));
        for dir in DIRS.map(Vec3::normalize) {
            let faces = Vec3::new(10.0, 5.0, 2.0) * dir.abs();
            let expected = faces.dot(dir.abs()) / faces.element_sum();
            assert!((answer(sides, extent, dir) - expected).abs() < 1e-4, "{dir}");
        }
    }

    #[test]
    fn a_sphere_answers_as_a_sphere() {
        let sides = [Vec3::X, Vec3::Y, Vec3::Z].map(|n| words(n * (2.0 / 3.0), 0.785));
        for dir in DIRS.map(Vec3::normalize) {
            assert!((answer(sides, Vec3::ONE, dir) - 2.0 / 3.0).abs() < 3e-3, "{dir}");
        }
    }

    #[test]
    fn a_flat_piece_answers_with_the_cosine_though_sides_see_it_from_front_and_behind() {
        let normal = Vec3::new(2.0, -1.0, 2.0) / 3.0;
        let sides = [normal, -normal, normal].map(|n| words(n, 0.5));
        for dir in DIRS.map(Vec3::normalize) {
            assert!((answer(sides, Vec3::ONE, dir) - normal.dot(dir).abs()).abs() < 0.01, "{dir}");
        }
    }

    #[test]
    fn blocks_in_a_tall_cell_show_their_tops() {
        // Of the walls a twentieth is covered, of the top all.
        let sides = [words(Vec3::X, 0.05), words(Vec3::Y, 0.05), words(Vec3::Z, 1.0)];
        let dir = -Vec3::ONE.normalize();
        let [x, _, z] = shares(Vec3::new(1.0, 1.0, 5.0), dir, sides.map(|s| s[0]), sides.map(|s| s[1]));
        assert!(x < 0.2 && z > 0.6, "{x} {z}");
    }

    #[test]
    fn nothing_is_ever_nan() {
        for extent in [0.0, 1e-40, 1.0, 1e38].map(Vec3::splat).into_iter().chain([Vec3::new(0.0, 1e30, 1e-30)]) {
            for dir in [Vec3::ZERO, Vec3::X, Vec3::splat(f32::INFINITY), Vec3::splat(1e-40)] {
                for seconds in [[0; 3], [u32::MAX; 3]] {
                    let shares = shares(extent, dir, [u32::MAX; 3], seconds);
                    assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{extent} {dir}: {shares:?}");
                }
            }
        }
    }
}
