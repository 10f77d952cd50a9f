//! The part of a voxel that a ray sees, and its response to light.
//!
//! A ray sees a voxel of six samples through the three sides that face the ray. Each side has a share: its area as
//! projected along the ray, times its cover. The share is reduced if the normals that the side sees differ, because
//! some of that surface is seen from behind, and in a closed surface that part is hidden. The shares do not depend on
//! the side that the ray enters: a tall cell of a few blocks shows their tops, even if its own top is small. (Áfra
//! 2012, section 4.2, takes the sample of the entered side.)
//!
//! The length of a mean normal determines how much light is reflected: see [`visible`].

use super::coded::{stored_colour, stored_cover, stored_likeness};
use glam::Vec3;

/// Added to each side's visible area, so that the sum is never zero.
pub(super) const LEAST_SEEN: f32 = 1e-6;

/// Returns the shares of three sides, which add up to 1.
///
/// `extent` is that of the cell; `dir` is the ray's direction in the cell's frame. `firsts` and `seconds` are the words
/// of the samples of the sides across x, y and z that face the ray.
#[inline(always)]
pub fn shares(extent: Vec3, dir: Vec3, firsts: [u32; 3], seconds: [u32; 3]) -> [f32; 3] {
    let (e, d) = (in_proportion(extent), in_proportion(dir.abs()));
    let alike = Vec3::from(firsts.map(stored_likeness));
    let covered = Vec3::from(seconds.map(stored_cover)) * Vec3::new(e.y * e.z, e.z * e.x, e.x * e.y);
    // The likeness is squared. (With its first power slivers are 0.003 brighter at 1 pixel of error, without it 0.021;
    // tests/bench/NOTES.md.)
    let seen = (covered * alike * alike + LEAST_SEEN) * d;
    (seen / (seen.x + seen.y + seen.z)).to_array()
}

/// Scales the vector so that its largest component is 1 and no product overflows. Returns all 1 if that is impossible.
#[inline(always)]
fn in_proportion(v: Vec3) -> Vec3 {
    let most = v.x.max(v.y).max(v.z);
    let is_usual = most > 1e-30 && most < 1e30;
    let (by, or) = if is_usual { (1.0 / most, 0.0) } else { (0.0, 1.0) };
    // Infinite components are clamped first, because their product with zero is NaN.
    Vec3::new(v.x.min(1e30), v.y.min(1e30), v.z.min(1e30)) * by + or
}

/// The response of visible surface to light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facing {
    /// Mean visible normal of each side.
    normals: [Vec3; 3],
    /// Shares of the sides.
    shares: [f32; 3],
}

impl Facing {
    /// A surface with one unit normal.
    pub fn flat(normal: Vec3) -> Self {
        Self { normals: [normal, Vec3::ZERO, Vec3::ZERO], shares: [1.0, 0.0, 0.0] }
    }

    /// A surface with the given mean visible normals of the sides (see [`visible`]) and shares.
    pub fn new(normals: [Vec3; 3], shares: [f32; 3]) -> Self {
        Self { normals, shares }
    }

    /// The mean of all normals.
    #[inline(always)]
    pub fn mean(&self) -> Vec3 {
        let ([a, b, c], [x, y, z]) = (self.normals, self.shares);
        // The sum starts from zero, so that the sign of a zero does not depend on the number of terms.
        Vec3::ZERO + a * x + b * y + c * z
    }

    /// Mean cosine between the normals and a unit direction. Normals that face away count as 0.
    pub fn cosine(&self, to: Vec3) -> f32 {
        self.normals.iter().zip(self.shares).map(|(n, share)| share * mean_cosine(*n, to)).sum()
    }
}

/// Returns the mean of the normals that are visible from `to_eye`. `normal` is their mean direction, on the eye's side,
/// and `likeness` is the length of their mean as seen along it. `normal` and `to_eye` are unit vectors.
///
/// The normals are assumed to be those of a spheroid, which is flat if they are all alike and a sphere if their mean
/// has a length of 2/3. Such surfaces have closed forms of projected area and mean visible normal (Heitz and others,
/// "The SGGX microflake distribution", SIGGRAPH 2015). With T the mean of n n' over the area, the mean visible normal
/// is T e / A, and the projected area A is proportional to the root of e' T e. T is 2 l - 1 along the normal and 1 - l
/// across it: exact for nearly equal normals and for spheres. A light at the eye is reflected as l times the root of
/// c^2 + r (1 - c^2), where c is the cosine and r the ratio of the two values of T. For flat pieces this is c; for
/// spheres it is 2/3 from all directions.
#[inline(always)]
pub fn visible(normal: Vec3, likeness: f32, to_eye: Vec3) -> Vec3 {
    // The ratio is at most that of a sphere, because other samples describe the other sides.
    let across = (1.0 - likeness) / (2.0 * likeness - 1.0).max(1.0 - likeness).max(1e-6);
    let cosine = normal.dot(to_eye).max(0.0);
    let leaning = normal * cosine + (to_eye - normal * cosine) * across;
    let length = (cosine * cosine + across * (1.0 - cosine * cosine).max(0.0)).sqrt();
    leaning * if length > 1e-6 { likeness / length } else { 0.0 }
}

/// Mean cosine between `to` and normals with mean `mean`; normals that face away count as 0. The cosines are assumed to
/// be uniformly distributed, with a variance that the length of the mean determines.
#[inline(always)]
pub fn mean_cosine(mean: Vec3, to: Vec3) -> f32 {
    let (cosine, square) = (mean.dot(to), mean.length_squared());
    // Only the two components across the mean vary. The component along it hardly varies, because the mean is that of
    // the visible normals.
    let variance = 0.45 * (1.0 - square).max(0.0) * (1.0 - cosine * cosine / square.max(1e-12)).max(0.0);
    let half = (3.0 * variance).sqrt();
    if cosine.abs() >= half { cosine.max(0.0) } else { (cosine + half) * (cosine + half) / (4.0 * half) }
}

/// Returns the linear colour of three samples, given by their second words, weighted by their shares.
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

    /// The response of one sample to an eye on the normal's side.
    fn one_sample(first: u32, to_eye: Vec3) -> Facing {
        Facing::flat(visible(stored_normal(first), stored_likeness(first), to_eye))
    }

    /// Light that returns from a light at the eye.
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
    fn a_cuboid_responds_like_its_faces() {
        let extent = Vec3::new(1.0, 2.0, 5.0);
        let sides = [Vec3::X, Vec3::Y, Vec3::Z].map(|n| words(n, 1.0));
        for dir in DIRS.map(Vec3::normalize) {
            let faces = Vec3::new(10.0, 5.0, 2.0) * dir.abs();
            let expected = faces.dot(dir.abs()) / faces.element_sum();
            assert!((answer(sides, extent, dir) - expected).abs() < 1e-4, "{dir}");
        }
    }

    #[test]
    fn a_sphere_responds_like_a_sphere() {
        let sides = [Vec3::X, Vec3::Y, Vec3::Z].map(|n| words(n * (2.0 / 3.0), 0.785));
        for dir in DIRS.map(Vec3::normalize) {
            assert!((answer(sides, Vec3::ONE, dir) - 2.0 / 3.0).abs() < 3e-3, "{dir}");
        }
    }

    #[test]
    fn a_flat_piece_responds_with_the_cosine_from_both_sides() {
        let normal = Vec3::new(2.0, -1.0, 2.0) / 3.0;
        let sides = [normal, -normal, normal].map(|n| words(n, 0.5));
        for dir in DIRS.map(Vec3::normalize) {
            assert!((answer(sides, Vec3::ONE, dir) - normal.dot(dir).abs()).abs() < 0.01, "{dir}");
        }
    }

    #[test]
    fn blocks_in_a_tall_cell_show_their_tops() {
        // A twentieth of each wall is covered, and all of the top.
        let sides = [words(Vec3::X, 0.05), words(Vec3::Y, 0.05), words(Vec3::Z, 1.0)];
        let dir = -Vec3::ONE.normalize();
        let [x, _, z] = shares(Vec3::new(1.0, 1.0, 5.0), dir, sides.map(|s| s[0]), sides.map(|s| s[1]));
        assert!(x < 0.2 && z > 0.6, "{x} {z}");
    }

    /// Compares with a sum over the visible half of a sphere.
    #[test]
    fn a_sphere_responds_to_lights_away_from_the_eye() {
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
    fn equal_normals_respond_as_one_to_any_light() {
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
