//! What a ray sees of a voxel, and how that answers light.
//!
//! A voxel of six samples is seen through the three of its sides that face the ray, each by as much as there is to see:
//! the share of the side that is covered, of its area as the ray sees it; and the less, the more the normals differ
//! that it sees, for of these some are seen from behind, and in a closed surface they are hidden. Not by which side the
//! ray enters: a tall cell of a few blocks shows their tops, though its own top is small. (Áfra 2012, section 4.2,
//! takes the sample of the side that is entered.)
//!
//! How much of the light comes back is told by the lengths of mean normals: see [`visible`].

use super::coded::{stored_colour, stored_cover, stored_likeness};
use glam::Vec3;

/// Of a side of which nothing is seen, so that there always is a blend.
const LEAST_SEEN: f32 = 1e-6;

/// Shares of three sides, that add up to 1.
///
/// `extent`: of the cell; `dir`: of the ray in the cell's frame; `firsts`, `seconds`: the words of the samples of the
/// sides across x, y and z that face the ray.
#[inline(always)]
pub fn shares(extent: Vec3, dir: Vec3, firsts: [u32; 3], seconds: [u32; 3]) -> [f32; 3] {
    let (e, d) = (in_proportion(extent), in_proportion(dir.abs()));
    let alike = Vec3::from(firsts.map(stored_likeness));
    let covered = Vec3::from(seconds.map(stored_cover)) * Vec3::new(e.y * e.z, e.z * e.x, e.x * e.y);
    // Squared: once is slivers 3 thousandths brighter at 1 pixel of error, not at all 21 (tests/bench/NOTES.md).
    let seen = (covered * alike * alike + LEAST_SEEN) * d;
    (seen / (seen.x + seen.y + seen.z)).to_array()
}

/// With its largest component made 1: no product of them overflows. All 1 if that cannot be.
#[inline(always)]
fn in_proportion(v: Vec3) -> Vec3 {
    let most = v.x.max(v.y).max(v.z);
    let is_usual = most > 1e-30 && most < 1e30;
    let (by, or) = if is_usual { (1.0 / most, 0.0) } else { (0.0, 1.0) };
    // What is infinite must not be multiplied with zero.
    Vec3::new(v.x.min(1e30), v.y.min(1e30), v.z.min(1e30)) * by + or
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

    /// Of the mean normals of what is seen of each side (see [`visible`]), and their shares.
    pub fn new(normals: [Vec3; 3], shares: [f32; 3]) -> Self {
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

/// The mean of the normals that are seen, of those whose mean seen along `normal` is `likeness` long; all unit,
/// `normal` on the eye's side.
///
/// As if the normals were those of a spheroid, flat where they are alike and a sphere where their mean is 2/3 long:
/// projected area and mean visible normal of such have closed forms. (Heitz and others, The SGGX microflake
/// distribution, SIGGRAPH 2015.) With T the mean of n n' over area, the latter is T e / A, and A goes as the root of e'
/// T e. T is 2 l - 1 along the normal and 1 - l across: exact where normals are nearly alike, and for spheres. Light
/// from where the eye is comes back as l times the root of c^2 + r (1 - c^2), c the cosine, r their ratio: of flat
/// pieces c, of spheres 2/3 from anywhere.
#[inline(always)]
pub fn visible(normal: Vec3, likeness: f32, to_eye: Vec3) -> Vec3 {
    // No more than a sphere's: from other sides there are other samples.
    let across = (1.0 - likeness) / (2.0 * likeness - 1.0).max(1.0 - likeness).max(1e-6);
    let cosine = normal.dot(to_eye).max(0.0);
    let leaning = normal * cosine + (to_eye - normal * cosine) * across;
    let length = (cosine * cosine + across * (1.0 - cosine * cosine).max(0.0)).sqrt();
    leaning * if length > 1e-6 { likeness / length } else { 0.0 }
}

/// The mean cosine between `to` and normals around `mean`, of those that face it; as if their cosines were spread
/// evenly, as widely as what the mean lacks of 1 says.
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
    use crate::lod::coded::{sample, stored_normal};
    use crate::lod::voxel::Sample;

    fn words(normal: Vec3, cover: f32) -> [u32; 2] {
        sample(&Sample { normal, colour: Vec3::ONE, cover })
    }

    /// Seen by an eye on the normal's side.
    fn one_sample(first: u32, to_eye: Vec3) -> Facing {
        Facing::flat(visible(stored_normal(first), stored_likeness(first), to_eye))
    }

    /// What comes back of a light where the eye is.
    fn answer(sides: [[u32; 2]; 3], extent: Vec3, dir: Vec3) -> f32 {
        let shares = shares(extent, dir, sides.map(|s| s[0]), sides.map(|s| s[1]));
        let seen = |first: u32| {
            let n = stored_normal(first);
            visible(if n.dot(dir) > 0.0 { -n } else { n }, stored_likeness(first), -dir)
        };
        let facing = Facing::new(sides.map(|s| seen(s[0])), shares);
        facing.mean().dot(-dir)
    }

    const DIRS: [Vec3; 4] =
        [Vec3::NEG_ONE, Vec3::new(-1.0, -0.2, -3.0), Vec3::new(-1.0, -1.0, 0.0), Vec3::new(0.0, 0.0, -1.0)];

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

    /// Against a sum over the side of a sphere that the eye sees.
    #[test]
    fn a_sphere_answers_lights_beside_the_eye() {
        let [first, _] = words(Vec3::Z * (2.0 / 3.0), 1.0);
        let facing = one_sample(first, Vec3::Z);
        for angle in [0.0f32, 0.4, 1.0, 1.6, 2.5, 3.1] {
            let light = Vec3::new(angle.sin(), 0.0, angle.cos());
            let (mut sum, mut area) = (0.0f64, 0.0f64);
            for at in 0..160_000 {
                let (x, y) = (((at % 400) as f32 - 199.5) / 200.0, ((at / 400) as f32 - 199.5) / 200.0);
                let square = 1.0 - x * x - y * y;
                if square > 0.0 {
                    area += 1.0;
                    sum += f64::from(Vec3::new(x, y, square.sqrt()).dot(light).max(0.0));
                }
            }
            let answer = f64::from(facing.cosine(light));
            assert!((answer - sum / area).abs() < 0.02, "{angle}: {answer}, {}", sum / area);
        }
    }

    #[test]
    fn alike_normals_answer_as_one_from_anywhere() {
        let normal = Vec3::new(2.0, -1.0, 2.0) / 3.0;
        let facing = one_sample(words(normal, 1.0)[0], Vec3::X);
        for light in DIRS.map(|d| -d.normalize()) {
            assert!((facing.cosine(light) - normal.dot(light).max(0.0)).abs() < 0.01, "{light}");
            assert!((facing.mean() - normal).length() < 0.01);
        }
        assert!((Facing::flat(normal).mean() - normal).length() < 1e-6);
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
