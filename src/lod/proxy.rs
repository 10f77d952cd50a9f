//! Proxies: the look of a subtree from eighteen directions (Wald, Dietrich, Slusallek, "An Interactive Out-of-Core
//! Rendering Framework for Visualizing Massively Complex Models", EGSR 2004, section 5).
//!
//! The directions are the corners of an octahedron and the middles of its edges. For each of them a proxy has the mean
//! colour of the surface that is seen first (RGB 5-6-5) and its normals (16 bits). A ray sees the three directions
//! around its own ([`nearest`]), each with its share: linear on the faces of the subdivided octahedron. (The paper's
//! barycentric coordinates are those of the spherical triangle.)
//!
//! **Bias.** The paper stores the direction of the mean normal. This mean points at the eye more than the normals do:
//! an edge of a box, seen from straight ahead, becomes as bright as a face. Here the 16 bits are a direction and a
//! likeness, the length of the mean normal as seen along it, which [`super::visible`] turns into the mean visible
//! normal for the eye. The likeness is the one for which a light at the eye is reflected, over all samples, as their
//! normals reflect it. The shares of the three directions add up to 1, so the mean over all samples is right too. What
//! rounding adds to the colour in one direction is subtracted in the next.

use super::coded::octahedral;
use crate::math::Bounds;
use glam::Vec3;

/// Number of directions.
pub const DIRECTIONS: usize = 18;

/// For each direction, the code of the normals in the low half and the colour in the high half.
pub type Looks = [u32; DIRECTIONS];

/// Steps of each coordinate of a normal. Directions along axes and halfway between them are exact, because one less is
/// a multiple of four.
const STEPS: u32 = 37;
/// Number of likenesses, see [`likeness`].
const LIKENESSES: u32 = 47;
const _: () = assert!(STEPS * STEPS * LIKENESSES <= 1 << 16 && STEPS % 4 == 1);

/// Weight of the mean squared difference of single samples in the choice of a likeness, beside the square of the mean
/// difference. (Without it the mean of a tilted plate is right to 0.1 %, but views along it may be 0.3 too bright. With
/// it the mean is right to 0.6 %, and these views to 0.1.)
const SPREAD: f32 = 0.5;
/// Greatest value by which the colour of one direction makes up for the rounding of those before it.
const MOST_CARRIED: f32 = 0.03;

/// Returns the three directions around `to_eye` and their shares, which add up to 1. Any vector gives a result.
///
/// The signs of the components select the octant, and the largest one the corner of the octahedron. Of the two
/// triangles that are left, the first has this corner and the middles of two edges, the second all three middles.
#[inline]
pub fn nearest(to_eye: Vec3) -> ([usize; 3], [f32; 3]) {
    let size = to_eye.abs();
    let main = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let (u, v) = ((main + 1) % 3, (main + 2) % 3);
    let is_low = to_eye.to_array().map(|x| usize::from(x < 0.0));
    let sum = size.x + size.y + size.z;
    // A vector of zero, or one whose size leaves the range of single precision, counts as along its main axis.
    let (m, a, b) =
        if sum > 0.0 && sum.is_finite() { (size[main] / sum, size[u] / sum, size[v] / sum) } else { (1.0, 0.0, 0.0) };
    let corner = main * 2 + is_low[main];
    let [to_u, to_v, across] = [[main, u], [main, v], [u, v]].map(|pair| middle(pair, is_low));
    let past = m - a - b;
    if past >= 0.0 {
        ([corner, to_u, to_v], [past, 2.0 * a, 2.0 * b])
    } else {
        ([across, to_u, to_v], [-past, m + a - b, m + b - a])
    }
}

/// Returns the number of the direction between two axes: pairs in the order y z, z x, x y.
#[inline]
fn middle([i, j]: [usize; 2], is_low: [usize; 3]) -> usize {
    let across = 3 - i - j;
    6 + across * 4 + is_low[(across + 1) % 3] * 2 + is_low[(across + 2) % 3]
}

/// Returns direction `index` as a unit vector, and two unit vectors across it.
fn frame(index: usize) -> [Vec3; 3] {
    let sign = |is_low: usize| if is_low == 1 { -1.0 } else { 1.0 };
    if index < 6 {
        let axis = index / 2;
        return [Vec3::AXES[axis] * sign(index % 2), Vec3::AXES[(axis + 1) % 3], Vec3::AXES[(axis + 2) % 3]];
    }
    let (across, signs) = ((index - 6) / 4, (index - 6) % 4);
    let [u, v] = [Vec3::AXES[(across + 1) % 3] * sign(signs / 2), Vec3::AXES[(across + 2) % 3] * sign(signs % 2)];
    let half = std::f32::consts::FRAC_1_SQRT_2;
    [(u + v) * half, (u - v) * half, Vec3::AXES[across]]
}

/// Encodes a unit normal on the side of the first vector of a frame, as a point of half an octahedron that is unfolded
/// to a square.
fn encode_normal(n: Vec3, frame: &[Vec3; 3]) -> u32 {
    let at = Vec3::new(n.dot(frame[1]), n.dot(frame[2]), n.dot(frame[0]));
    let at = if at.z < 0.0 { -at } else { at };
    let at = at / (at.x.abs() + at.y.abs() + at.z);
    let most = (STEPS - 1) as f32;
    let step = |x: f32| ((x * 0.5 + 0.5) * most).floor().clamp(0.0, most - 1.0) as u32;
    let (a, b) = (step(at.x + at.y), step(at.x - at.y));
    // The nearest of the four around it.
    let mut best = (0, -1.0);
    for (a, b) in [(a, b), (a + 1, b), (a, b + 1), (a + 1, b + 1)] {
        let code = a * STEPS + b;
        let near = decode_normal(code, frame).normalize_or_zero().dot(n).abs();
        best = if near > best.1 { (code, near) } else { best };
    }
    best.0
}

/// Returns the normal of a code, which may be any number. It is not a unit vector.
#[inline]
fn decode_normal(code: u32, frame: &[Vec3; 3]) -> Vec3 {
    let at = |step: u32| step.min(STEPS - 1) as f32 * (2.0 / (STEPS - 1) as f32) - 1.0;
    let (sum, difference) = (at(code / STEPS), at(code % STEPS));
    let (x, y) = ((sum + difference) * 0.5, (sum - difference) * 0.5);
    frame[1] * x + frame[2] * y + frame[0] * (1.0 - x.abs() - y.abs()).max(0.0)
}

/// Returns the likeness of a level, of 255: from a fifth to 1, in small steps near 1. There the light that pieces
/// reflect when they are seen edge-on, which is in proportion to the root of the difference to 1, changes fastest.
#[inline]
fn likeness(level: u32) -> u32 {
    let less = (LIKENESSES - 1 - level) as f32 / (LIKENESSES - 1) as f32;
    255 - (204.0 * less * less.sqrt() + 0.5) as u32
}

/// Roots of the linear values of a colour as 5, 6 and 5 bits, red lowest.
const COLOUR_BITS: [(u32, f32); 3] = [(0, 31.0), (5, 63.0), (11, 31.0)];

/// Returns the first words, the second words and the shares of the three samples (`coded.rs`) that a ray sees whose
/// reverse, in the tree's frame, is `to_eye`. All looks are valid.
#[inline]
pub(super) fn seen(looks: &Looks, to_eye: Vec3) -> ([u32; 3], [u32; 3], [f32; 3]) {
    let (at, shares) = nearest(to_eye);
    let firsts = at.map(|k| {
        let code = looks[k] & 0xffff;
        octahedral(decode_normal(code / LIKENESSES, &frame(k))) | likeness(code % LIKENESSES) << 16
    });
    let seconds = at.map(|k| {
        let [red, green, blue] = COLOUR_BITS.map(|(from, most)| {
            let most = most as u32;
            ((looks[k] >> (16 + from) & most) * 255 + most / 2) / most
        });
        red | green << 8 | blue << 16 | 0xff << 24
    });
    (firsts, seconds, shares)
}

/// The first surface on a line into a subtree.
#[derive(Debug, Clone, Copy)]
struct Hit {
    /// Unit vector against the line.
    to_eye: Vec3,
    /// Unit normal on that side.
    normal: Vec3,
    /// Linear colour.
    colour: Vec3,
    /// Directions of the proxy and their shares of the hit.
    at: [usize; 3],
    shares: [f32; 3],
}

/// Collects what lines into a subtree meet first.
#[derive(Debug, Default)]
pub struct Sampler {
    hits: Vec<Hit>,
    /// Of the hits of one direction: its share, squared cosine and cosine.
    of_one: Vec<[f32; 3]>,
}

impl Sampler {
    /// Adds the first surface that a line with unit direction `dir` meets: its unit normal, of either sign, and its
    /// linear colour.
    pub fn push(&mut self, dir: Vec3, normal: Vec3, colour: Vec3) {
        let (to_eye, normal) = (-dir, if normal.dot(dir) > 0.0 { -normal } else { normal });
        let (at, shares) = nearest(to_eye);
        self.hits.push(Hit { to_eye, normal, colour, at, shares });
    }

    /// Returns the looks of all hits; `None` if there are none.
    pub fn looks(&mut self) -> Option<Looks> {
        if self.hits.is_empty() {
            return None;
        }
        let (mut looks, mut carried) = ([0; DIRECTIONS], Vec3::ZERO);
        for (k, look) in looks.iter_mut().enumerate() {
            let frame = frame(k);
            let share = |hit: &Hit| (0..3).map(|i| if hit.at[i] == k { hit.shares[i] } else { 0.0 }).sum::<f32>();
            // Where nothing is seen, the nearest other directions decide.
            let is_seen = self.hits.iter().map(share).sum::<f32>() > 1e-3;
            let weight = |hit: &Hit| match is_seen {
                true => share(hit),
                false => (1.0 + hit.to_eye.dot(frame[0])).powi(8) + 1e-6,
            };
            let (mut colour, mut all) = (Vec3::ZERO, 0.0);
            for hit in &self.hits {
                let weight = weight(hit);
                (colour, all) = (colour + hit.colour * weight, all + weight);
            }
            let mut unseen = Vec3::ZERO;
            let colour = encode_colour(colour, all, if is_seen { &mut carried } else { &mut unseen });
            *look = self.normals(&frame, weight) | colour;
        }
        Some(looks)
    }

    /// Returns the code of the normals of weighted hits.
    fn normals(&mut self, frame: &[Vec3; 3], weight: impl Fn(&Hit) -> f32) -> u32 {
        let lead = self.hits.iter().reduce(|a, b| if weight(b) > weight(a) { b } else { a });
        let lead = lead.map_or(frame[0], |hit| hit.normal);
        let (mut best, mut least) = (0, f32::INFINITY);
        // A flat piece seen edge-on shows both of its sides, so its normals are turned to one side: to that of the
        // direction, or to that of one normal. The better result counts.
        for side in [frame[0], lead] {
            let mut mean = Vec3::ZERO;
            for hit in &self.hits {
                mean += hit.normal * weight(hit).copysign(hit.normal.dot(side));
            }
            let code = encode_normal(mean.try_normalize().unwrap_or(frame[0]), frame);
            let unit = decode_normal(code, frame).normalize_or(frame[0]);
            self.of_one.clear();
            for hit in &self.hits {
                let (weight, cosine) = (weight(hit), unit.dot(hit.to_eye));
                if weight > 0.0 {
                    self.of_one.push([weight, cosine * cosine, hit.normal.dot(hit.to_eye)]);
                }
            }
            let all: f32 = self.of_one.iter().map(|one| one[0]).sum();
            for level in (0..LIKENESSES).rev() {
                let [difference, squares] = self.too_bright(likeness(level) as f32 / 255.0);
                let cost = (difference / all) * (difference / all) + SPREAD * squares / all;
                if cost < least {
                    (best, least) = (code * LIKENESSES + level, cost);
                }
            }
        }
        best
    }

    /// Returns the sum by which a light at the eye is reflected too brightly with a likeness, and that of the squares:
    /// the closed form of `visible(n, likeness, e) · e`.
    fn too_bright(&self, likeness: f32) -> [f32; 2] {
        let across = (1.0 - likeness) / (2.0 * likeness - 1.0).max(1.0 - likeness).max(1e-6);
        let (mut sum, mut squares) = (0.0, 0.0);
        for [weight, square, cosine] in &self.of_one {
            let difference = likeness * (square + across * (1.0 - square).max(0.0)).sqrt() - cosine;
            sum += weight * difference;
            squares += weight * difference * difference;
        }
        [sum, squares]
    }
}

/// Encodes the mean of linear colours from their sum and their weight. `carried` is the sum by which directions before
/// are too bright; this one is added.
fn encode_colour(sum: Vec3, weight: f32, carried: &mut Vec3) -> u32 {
    let (mean, mut word) = (sum / weight, 0);
    for (channel, (from, most)) in COLOUR_BITS.into_iter().enumerate() {
        let mean = mean[channel].clamp(0.0, 1.0);
        let carry = (carried[channel] / weight).clamp(-MOST_CARRIED, MOST_CARRIED);
        let level = ((mean - carry).max(0.0).sqrt() * most).round().min(most);
        carried[channel] += ((level / most) * (level / most) - mean) * weight;
        word |= (level as u32) << from;
    }
    word << 16
}

/// Returns term `index`, counted from 0, of Halton's sequence of a prime base, in (0, 1) (Niederreiter, "Random Number
/// Generation and Quasi-Monte Carlo Methods", 1992).
pub fn halton(index: u32, base: u32) -> f32 {
    let (mut left, mut step, mut sum) = (index + 1, 1.0, 0.0f64);
    while left > 0 {
        step /= f64::from(base);
        sum += step * f64::from(left % base);
        left /= base;
    }
    sum as f32
}

/// Returns the origin and the unit direction of the line into a box that four numbers in [0, 1) select. Lines of
/// uniform numbers are uniform over all lines that cross the box: a line enters through a point of the surface, with a
/// direction whose cosine to the inner normal is its weight. A box without area has lines through its edges or point.
pub fn line_into(bounds: &Bounds, [which, across, turn, tilt]: [f32; 4]) -> (Vec3, Vec3) {
    let extent = bounds.extent();
    let areas = [extent.y * extent.z, extent.z * extent.x, extent.x * extent.y];
    let all: f32 = areas.iter().sum();
    let (mut axis, mut at) = (2, which * 2.0 * all);
    for (i, area) in areas.into_iter().enumerate().take(2) {
        if at < 2.0 * area {
            axis = i;
            break;
        }
        at -= 2.0 * area;
    }
    let part = if areas[axis] > 0.0 { (at / areas[axis]).clamp(0.0, 1.999_999) } else { which * 2.0 };
    let is_high = part >= 1.0;
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut origin = if is_high { bounds.max } else { bounds.min };
    origin[u] = bounds.min[u] + extent[u] * part.fract();
    origin[v] = bounds.min[v] + extent[v] * across;
    let (sine, angle) = (tilt.sqrt(), turn * std::f32::consts::TAU);
    let mut dir = Vec3::ZERO;
    (dir[u], dir[v]) = (sine * angle.cos(), sine * angle.sin());
    dir[axis] = (1.0 - tilt).max(0.0).sqrt() * if is_high { -1.0 } else { 1.0 };
    (origin, dir)
}

#[cfg(test)]
#[path = "proxy_tests.rs"]
mod tests;
