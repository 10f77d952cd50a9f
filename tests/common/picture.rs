//! Errors between two pictures of one view, each defined here, in double precision; tests and benchmarks take them from
//! here. (The command `outcrop bench --poe` cannot: it has the second one in single rays,
//! `src/bin/outcrop/accuracy.rs`.)
//!
//! Pictures are plain slices, as [`outcrop::Mapped`] hands them out: a depth of infinity (or NaN) and a normal of 0 say
//! that nothing is hit. `seen` is the picture that is judged, `truth` the one that it should be; both have the same
//! size.
//!
//! | error | of a pixel | function |
//! |---|---|---|
//! | depth, relative | abs(d - d0) / d0 | [`depth_relative`] |
//! | depth, in pixels | abs(d - d0) / w(d0) | [`depth_pixels`] |
//! | normal | the angle between n and n0 | [`normal_angle`] |
//! | depth along a ray, in its widths | abs(t - t0) / w(t0) | [`along_rays`] |
//! | silhouette | covered in both / covered in either | [`silhouette`] |
//! | rays answered otherwise | (hit in one of both + hit more than a width elsewhere) / all | [`along_rays`] |
//! | coverage | sum of c / sum of c0 | [`coverage_ratio`] |
//! | brightness | sum of Y / sum of Y0 | [`radiance_ratio`] |

use glam::DVec3;

/// How many values are spread. NaN counts as the worst, and makes a NaN of the mean: it is never hidden.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    pub mean: f64,
    /// The least value that at least 95 of 100 values do not exceed (nearest rank: element ceil(0.95 count), from 1, of
    /// the sorted values).
    pub p95: f64,
    /// Likewise 999 of 1000.
    pub p999: f64,
    pub worst: f64,
    /// How many values there are; 0 makes 0 of all the others.
    pub count: usize,
}

impl Spread {
    /// Of errors, which are not negative.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        // A NaN's sign would sort it first.
        let mut values: Vec<f64> = values.into_iter().map(f64::abs).collect();
        values.sort_unstable_by(f64::total_cmp);
        let count = values.len();
        let rank = |of_1000: usize| match (count * of_1000).div_ceil(1000) {
            0 => 0.0,
            rank => values[rank - 1],
        };
        let mean = values.iter().sum::<f64>() / count.max(1) as f64;
        Self { mean, p95: rank(950), p999: rank(999), worst: rank(1000), count }
    }
}

/// Whether a pixel of this depth shows anything.
pub fn is_covered(depth: f32) -> bool {
    depth.is_finite()
}

/// The values of pixels that two pictures have both, or a panic that says that they differ in size.
fn pairs<'a, T>(seen: &'a [T], truth: &'a [T]) -> impl Iterator<Item = (&'a T, &'a T)> {
    assert_eq!(seen.len(), truth.len(), "pictures of one size are compared");
    seen.iter().zip(truth)
}

/// Depths of the pixels that both pictures cover.
fn covered_depths<'a>(seen: &'a [f32], truth: &'a [f32]) -> impl Iterator<Item = (f64, f64)> + 'a {
    let both = pairs(seen, truth).filter(|(d, d0)| is_covered(**d) && is_covered(**d0));
    both.map(|(d, d0)| (f64::from(*d), f64::from(*d0)))
}

/// abs(d - d0) / d0 of the pixels that both pictures cover.
pub fn depth_relative(seen: &[f32], truth: &[f32]) -> Spread {
    Spread::of(covered_depths(seen, truth).map(|(d, d0)| (d - d0).abs() / d0))
}

/// abs(d - d0) / w(d0) of the pixels that both pictures cover, where `pixel_width` is w: the width of a pixel at a
/// depth, in the unit of depths. It is `2 tan(fov_y / 2) / height * depth` of a perspective camera and `height of the
/// view / height` of an orthographic one, whatever the depth.
pub fn depth_pixels(seen: &[f32], truth: &[f32], pixel_width: impl Fn(f64) -> f64) -> Spread {
    Spread::of(covered_depths(seen, truth).map(|(d, d0)| (d - d0).abs() / pixel_width(d0)))
}

/// How far rays' hits are off, in widths of the ray there, of those that hit in both; and the share of all rays that
/// are answered otherwise: that hit in one of both, or more than a width elsewhere. `seen`, `truth`: distances,
/// infinite where nothing is hit. `width`: of a ray, by number, at a distance.
pub fn along_rays(seen: &[f64], truth: &[f64], width: impl Fn(usize, f64) -> f64) -> (Spread, f64) {
    let (mut off, mut otherwise) = (Vec::new(), 0);
    for (i, (t, t0)) in pairs(seen, truth).enumerate() {
        match [t.is_finite(), t0.is_finite()] {
            [true, true] if t == t0 => off.push(0.0),
            [true, true] => off.push((t - t0).abs() / width(i, *t0)),
            [a, b] => otherwise += usize::from(a != b),
        }
    }
    otherwise += off.iter().filter(|off| **off > 1.0).count();
    (Spread::of(off), otherwise as f64 / seen.len().max(1) as f64)
}

/// The angle between normals, in degrees, of the pixels where both pictures have one (three floats a pixel, any
/// length).
///
/// atan2(|n x n0|, n . n0): exact for small angles, which the arc cosine is not.
pub fn normal_angle(seen: &[f32], truth: &[f32]) -> Spread {
    let normals = |all: &[f32]| -> Vec<DVec3> {
        assert_eq!(all.len() % 3, 0, "three floats a normal");
        all.chunks_exact(3).map(|n| DVec3::new(f64::from(n[0]), f64::from(n[1]), f64::from(n[2]))).collect()
    };
    let (seen, truth) = (normals(seen), normals(truth));
    let both = pairs(&seen, &truth).filter(|(n, n0)| **n != DVec3::ZERO && **n0 != DVec3::ZERO);
    Spread::of(both.map(|(n, n0)| n.cross(*n0).length().atan2(n.dot(*n0)).to_degrees()))
}

/// How the covered pixels of two pictures differ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Silhouette {
    /// Covered in both over covered in either (the Jaccard index); 1 if neither picture covers anything.
    pub overlap: f64,
    /// Pixels that only the truth covers.
    pub lost: usize,
    /// Pixels that it does not cover, and the picture does.
    pub added: usize,
    /// Pixels that the truth covers.
    pub covered: usize,
}

/// Of two pictures' depths.
pub fn silhouette(seen: &[f32], truth: &[f32]) -> Silhouette {
    let mut counts = [[0usize; 2]; 2];
    for (d, d0) in pairs(seen, truth) {
        counts[usize::from(is_covered(*d))][usize::from(is_covered(*d0))] += 1;
    }
    let [[_, lost], [added, both]] = counts;
    let overlap = if both + lost + added == 0 { 1.0 } else { both as f64 / (both + lost + added) as f64 };
    Silhouette { overlap, lost, added, covered: both + lost }
}

/// sum of c / sum of c0: mean coverage over the true one. Of each pixel the share that is covered, from 0 to 1: its
/// alpha, an oracle's coverage, or whether it [`is_covered`] at all.
pub fn coverage_ratio(seen: impl IntoIterator<Item = f64>, truth: impl IntoIterator<Item = f64>) -> f64 {
    ratio(seen.into_iter().sum(), truth.into_iter().sum())
}

/// 1 of two nothings.
fn ratio(sum: f64, truth: f64) -> f64 {
    if sum == truth { 1.0 } else { sum / truth }
}

/// A picture's colours, rows from the top; four values a pixel, as the buffers of a frame have them. Alpha is not
/// looked at.
#[derive(Debug, Clone, Copy)]
pub enum Colours<'a> {
    /// Linear, not clamped.
    Linear(&'a [f32]),
    /// Coded for screens, 0 to 255.
    Srgb8(&'a [u8]),
}

impl Colours<'_> {
    /// Pixels.
    pub fn count(&self) -> usize {
        let values = match self {
            Colours::Linear(all) => all.len(),
            Colours::Srgb8(all) => all.len(),
        };
        assert_eq!(values % 4, 0, "four values a pixel");
        values / 4
    }

    /// Red, green and blue of a pixel, linear.
    pub fn linear(&self, pixel: usize) -> [f64; 3] {
        match self {
            Colours::Linear(all) => std::array::from_fn(|c| f64::from(all[4 * pixel + c])),
            Colours::Srgb8(all) => std::array::from_fn(|c| srgb_decode(f64::from(all[4 * pixel + c]) / 255.0)),
        }
    }

    /// Red, green and blue of a pixel as a screen takes them: sRGB-coded, clamped to [0, 1].
    pub fn coded(&self, pixel: usize) -> [f64; 3] {
        match self {
            Colours::Linear(all) => std::array::from_fn(|c| srgb_encode(f64::from(all[4 * pixel + c]).clamp(0.0, 1.0))),
            Colours::Srgb8(all) => std::array::from_fn(|c| f64::from(all[4 * pixel + c]) / 255.0),
        }
    }
}

/// IEC 61966-2-1, from a linear value in [0, 1].
pub fn srgb_encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// IEC 61966-2-1, to a linear value in [0, 1].
pub fn srgb_decode(coded: f64) -> f64 {
    if coded <= 0.040_45 { coded / 12.92 } else { ((coded + 0.055) / 1.055).powf(2.4) }
}

/// Luminance of linear sRGB: Y = 0.2126 R + 0.7152 G + 0.0722 B (ITU-R BT.709).
pub fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// sum of Y / sum of Y0 over the pixels that `counts` picks (those that the truth covers, so that a background does not
/// hide what is wrong; or all): mean brightness over the true one.
pub fn radiance_ratio(seen: Colours, truth: Colours, counts: impl Fn(usize) -> bool) -> f64 {
    assert_eq!(seen.count(), truth.count(), "pictures of one size are compared");
    let sum = |of: Colours| (0..of.count()).filter(|i| counts(*i)).map(|i| luminance(of.linear(i))).sum();
    ratio(sum(seen), sum(truth))
}
