//! Normals at the corners of triangles, where the input gives none: the mean of the faces that meet at the vertex,
//! weighted by their angles there (Thürmer and Wüthrich, "Computing Vertex Normals from Polygonal Facets", 1998).
//!
//! Two faces continue one another if they share an edge and the angle between their normals is below the crease angle.
//! The faces around a vertex form groups that continue one another; each group has one normal, so no seam appears
//! within it. Where that normal leans from a face by more than the crease angle, as at the apex of a cone, only those
//! faces of the group count that are within the angle of this face.
//!
//! Vertices are equal if their positions are. The result does not depend on the order of the triangles, but for their
//! primitive ids, and so neither on chunks nor on threads.

use crate::base::error::Result;
use crate::base::memory::{room, zeroed};
use crate::base::progress::Cancel;
use crate::math::octahedral;
use crate::structure::Par;
use glam::Vec3;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Code of a normal that is to be made.
pub const MADE: u32 = 0;
/// Code of the normal of the triangle itself. (Codes of other normals are those of [`octahedral`].)
pub const OWN: u32 = 1;

/// Returns the code of a normal of the input; [`OWN`] if it is zero or not finite.
pub fn given(normal: Vec3) -> u32 {
    octahedral::encode_any(normal).unwrap_or(OWN)
}

/// Cosine beyond which a normal counts as that of the triangle itself: 0.1 degrees.
const FLAT: f32 = 0.999_998_5;

/// Triangles whose corners need normals, and those around them.
pub struct Faces<'a> {
    pub triangles: &'a [[Vec3; 3]],
    /// Primitive ids.
    pub prims: &'a [u32],
    /// Codes of the input's normals; empty if it has none.
    pub given: &'a [[u32; 3]],
    /// Number of the triangles that need normals; the others, behind them, only take part in those.
    pub own: usize,
}

/// Returns the codes of the normals of each triangle that needs some, [`OWN`] for the triangle's own, on the side from
/// which its corners appear counter-clockwise. Empty if all are the triangles' own. `crease`: crease angle in degrees;
/// none are made if it is negative.
pub fn make(faces: &Faces, crease: f32, par: &Par, cancel: &Cancel) -> Result<Vec<[u32; 3]>> {
    let Faces { triangles, given, own, .. } = *faces;
    let makes = crease >= 0.0 && (given.len() < own || given.iter().flatten().any(|code| *code == MADE));
    if given.is_empty() && !makes {
        return Ok(Vec::new());
    }
    let what = "normals";
    let mut out: Vec<AtomicU32> = room(3 * own, what)?;
    out.extend((0..3 * own).map(|_| AtomicU32::new(OWN)));
    let across: Vec<Vec3> = par.try_map(triangles.len(), what, |i| face(&triangles[i]))?;
    if makes {
        let maker = Maker { faces, across: &across, out: &out, least: crease.min(180.0).to_radians().cos() };
        maker.make(par, cancel)?;
    }
    let chunks = own.div_ceil(CHUNK);
    let is_smooth = par.map(chunks, |chunk| {
        let all = CHUNK * chunk..own.min(CHUNK * (chunk + 1));
        // Every triangle is needed: no early end.
        all.fold(false, |any, i| any | settle(&out[3 * i..3 * i + 3], given.get(i), across[i]))
    });
    if !is_smooth.contains(&true) {
        return Ok(Vec::new());
    }
    let mut codes: Vec<[u32; 3]> = zeroed(own, what)?;
    codes.iter_mut().enumerate().for_each(|(i, to)| *to = [0, 1, 2].map(|c| out[3 * i + c].load(Relaxed)));
    Ok(codes)
}

/// Number of triangles of a step of the last pass.
const CHUNK: usize = 1 << 14;

/// Completes the normals of a triangle: puts in those given, turned to the side of the triangle's own, and replaces
/// those that differ from it by little. True if any is left that differs.
fn settle(out: &[AtomicU32], given: Option<&[u32; 3]>, own: Vec3) -> bool {
    let is_given = |code: u32| code != MADE && code != OWN;
    let all = given.copied().unwrap_or_default();
    let sum: f32 = all.iter().filter(|code| is_given(**code)).map(|code| octahedral::decode(*code).dot(own)).sum();
    let mut any = false;
    for (to, code) in out.iter().zip(all) {
        let mut code = if code == MADE { to.load(Relaxed) } else { code };
        if is_given(code) {
            let normal = octahedral::decode(code);
            if normal.dot(own) > FLAT {
                code = OWN;
            } else if sum < 0.0 {
                code = octahedral::encode(-normal);
            }
        }
        any |= code != OWN;
        to.store(code, Relaxed);
    }
    any
}

/// The unit normal of a triangle with area.
fn face([a, b, c]: &[Vec3; 3]) -> Vec3 {
    let a = a.as_dvec3();
    (b.as_dvec3() - a).cross(c.as_dvec3() - a).normalize_or_zero().as_vec3()
}

/// A corner of a triangle: three times the triangle's index, and the corner's.
#[derive(Clone, Copy)]
struct Corner(u32);

impl Corner {
    fn triangle(self) -> usize {
        self.0 as usize / 3
    }
    fn place(self) -> usize {
        self.0 as usize % 3
    }
}

/// A position as it is compared: both zeros are one.
fn key(p: Vec3) -> [u32; 3] {
    (p + Vec3::ZERO).to_array().map(f32::to_bits)
}

/// A hash of a position.
pub fn hash(p: Vec3) -> u64 {
    let [x, y, z] = key(p).map(u64::from);
    // Odd constants without a pattern.
    let mixed = (x | y << 32).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ z.wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    (mixed ^ mixed >> 29).wrapping_mul(0x2545_f491_4f6c_dd1d)
}

/// Most parts into which the corners are divided by the hash of their vertex, so that each part fits the cache.
const MOST_PARTS: usize = 1024;
/// Approximate number of corners of a part.
const OF_A_PART: usize = 1 << 14;

struct Maker<'a> {
    faces: &'a Faces<'a>,
    /// Unit normals of the triangles.
    across: &'a [Vec3],
    out: &'a [AtomicU32],
    /// Cosine of the crease angle.
    least: f32,
}

/// A corner of a fan: the corners at one vertex.
#[derive(Clone, Copy)]
struct Spoke {
    corner: Corner,
    /// Unit normal of its triangle.
    across: Vec3,
    /// The triangle's angle at the vertex; 0 if an earlier one is the same triangle.
    angle: f32,
    /// Number of the group, as the index of one of its spokes.
    group: u32,
}

/// Reusable memory for one vertex after the other.
#[derive(Default)]
struct Fan {
    spokes: Vec<Spoke>,
    /// The other ends of the edges at the vertex, and the spokes that they belong to.
    ends: Vec<([u32; 3], u32)>,
    sums: Vec<Vec3>,
    /// The other two corners of each spoke's triangle, and the spoke.
    others: Vec<([[u32; 3]; 2], u32)>,
}

impl Maker<'_> {
    fn make(&self, par: &Par, cancel: &Cancel) -> Result<()> {
        let corners = 3 * self.faces.triangles.len();
        let parts = (corners / OF_A_PART).next_power_of_two().min(MOST_PARTS);
        let part_of = |corner: usize| (hash(self.position(Corner(corner as u32))) >> 40) as usize % parts;
        let mut ends = vec![0u32; parts + 1];
        (0..corners).for_each(|corner| ends[part_of(corner) + 1] += 1);
        (0..parts).for_each(|part| ends[part + 1] += ends[part]);
        cancel.check()?;
        let mut order: Vec<u32> = zeroed(corners, "normals")?;
        let mut at = ends.clone();
        for corner in 0..corners {
            let at = &mut at[part_of(corner)];
            order[*at as usize] = corner as u32;
            *at += 1;
        }
        let done = par.map(parts, |part| -> Result<()> {
            cancel.check()?;
            self.part(&order[ends[part] as usize..ends[part + 1] as usize]);
            Ok(())
        });
        done.into_iter().collect()
    }

    fn position(&self, corner: Corner) -> Vec3 {
        self.faces.triangles[corner.triangle()][corner.place()]
    }

    /// Makes the normals at the vertices of one part.
    fn part(&self, corners: &[u32]) {
        let keyed = |&corner: &u32| {
            let corner = Corner(corner);
            (key(self.position(corner)), self.faces.prims[corner.triangle()], corner.0)
        };
        let mut sorted: Vec<([u32; 3], u32, u32)> = corners.iter().map(keyed).collect();
        sorted.sort_unstable();
        let mut fan = Fan::default();
        for of_vertex in sorted.chunk_by(|a, b| a.0 == b.0) {
            if of_vertex.len() > 1 && of_vertex.iter().any(|(.., corner)| (*corner as usize) < self.out.len()) {
                fan.spokes.clear();
                fan.spokes.extend(of_vertex.iter().map(|(.., corner)| self.spoke(Corner(*corner))));
                self.count_once(&mut fan);
                self.vertex(&mut fan);
            }
        }
    }

    /// Takes the weight of triangles that lie, corner by corner, on an earlier one: however often a face was stored, it
    /// counts once.
    fn count_once(&self, fan: &mut Fan) {
        let Fan { spokes, others, .. } = fan;
        others.clear();
        others.extend(spokes.iter().enumerate().map(|(i, spoke)| {
            let [_, next, last] = self.around(spoke.corner);
            ([key(next), key(last)], i as u32)
        }));
        others.sort_unstable();
        for of_face in others.chunk_by(|a, b| a.0 == b.0) {
            of_face[1..].iter().for_each(|(_, i)| spokes[*i as usize].angle = 0.0);
        }
    }

    fn spoke(&self, corner: Corner) -> Spoke {
        let [own, next, last] = self.around(corner).map(|p| p.as_dvec3());
        let cosine = (next - own).normalize_or_zero().dot((last - own).normalize_or_zero()) as f32;
        Spoke { corner, across: self.across[corner.triangle()], angle: arc_cosine(cosine), group: 0 }
    }

    /// The corners of a triangle, from one of them on.
    fn around(&self, corner: Corner) -> [Vec3; 3] {
        let all = &self.faces.triangles[corner.triangle()];
        [0, 1, 2].map(|i| all[(corner.place() + i) % 3])
    }

    fn vertex(&self, fan: &mut Fan) {
        let all: Vec3 = fan.spokes.iter().map(|s| s.across * s.angle).sum();
        let mean = all.normalize_or_zero();
        let farthest = fan.spokes.iter().fold(1.0f32, |least, s| least.min(s.across.dot(mean)));
        if farthest > FLAT {
            return;
        }
        // If all are within half the crease angle of their mean, any two are within the whole.
        if farthest > 0.0 && 2.0 * farthest * farthest - 1.0 >= self.least {
            let code = octahedral::encode(mean);
            return fan.spokes.iter().for_each(|s| self.put(s.corner, code));
        }
        self.group(fan);
        fan.sums.clear();
        fan.sums.resize(fan.spokes.len(), Vec3::ZERO);
        for spoke in &fan.spokes {
            fan.sums[spoke.group as usize] += spoke.across * spoke.angle;
        }
        for spoke in &fan.spokes {
            let mut mean = fan.sums[spoke.group as usize].normalize_or_zero();
            if mean.dot(spoke.across) < self.least {
                let is_near = |s: &&Spoke| s.group == spoke.group && s.across.dot(spoke.across) >= self.least;
                // A vertex of very many faces has no direction that would be worth the time.
                let few = &fan.spokes[..if fan.spokes.len() <= MOST_NEAR { fan.spokes.len() } else { 0 }];
                mean = few.iter().filter(is_near).map(|s| s.across * s.angle).sum::<Vec3>().normalize_or_zero();
            }
            if mean != Vec3::ZERO {
                self.put(spoke.corner, octahedral::encode(mean));
            }
        }
    }

    fn put(&self, corner: Corner, code: u32) {
        if let Some(to) = self.out.get(corner.0 as usize) {
            to.store(code, Relaxed);
        }
    }

    /// Sets the groups of spokes that continue one another.
    fn group(&self, fan: &mut Fan) {
        fan.ends.clear();
        for (i, spoke) in fan.spokes.iter_mut().enumerate() {
            spoke.group = i as u32;
            let [_, next, last] = self.around(spoke.corner);
            fan.ends.extend([(key(next), i as u32), (key(last), i as u32)]);
        }
        fan.ends.sort_unstable();
        for edge in fan.ends.chunk_by(|a, b| a.0 == b.0) {
            for (i, &(_, a)) in edge.iter().enumerate() {
                for &(_, b) in edge[i + 1..].iter().take(MOST_AT_EDGE) {
                    let (a, b) = (a as usize, b as usize);
                    if fan.spokes[a].across.dot(fan.spokes[b].across) >= self.least {
                        let (a, b) = (root(&fan.spokes, a), root(&fan.spokes, b));
                        fan.spokes[a.max(b)].group = a.min(b) as u32;
                    }
                }
            }
        }
        for i in 0..fan.spokes.len() {
            fan.spokes[i].group = root(&fan.spokes, i) as u32;
        }
    }
}

/// Most faces at a vertex of which each is compared with each.
const MOST_NEAR: usize = 256;
/// Most faces at an edge with which each is compared.
const MOST_AT_EDGE: usize = 8;

fn root(spokes: &[Spoke], mut i: usize) -> usize {
    while spokes[i].group as usize != i {
        i = spokes[i].group as usize;
    }
    i
}

/// The arc cosine, to 7e-5 (Abramowitz and Stegun, Handbook of Mathematical Functions, 4.4.45). It is the same on every
/// machine, unlike that of the system's library.
fn arc_cosine(x: f32) -> f32 {
    let a = x.abs().min(1.0);
    let near = (1.0 - a).sqrt() * (((-0.018_729_3 * a + 0.074_261) * a - 0.212_114_4) * a + 1.570_728_8);
    if x < 0.0 { std::f32::consts::PI - near } else { near }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dome of hexagons with heights by a hash, so that creases and smooth places alternate.
    fn bumpy(side: usize, rough: f32) -> Vec<[Vec3; 3]> {
        let at = |x: usize, y: usize| {
            let wave = ((x * 7919 + y * 104_729) % 1000) as f32 * 1e-3;
            Vec3::new(x as f32 + 0.5 * (y % 2) as f32, y as f32, wave * rough)
        };
        let square = |i: usize| {
            let (x, y) = (i % side, i / side);
            [[at(x, y), at(x + 1, y), at(x, y + 1)], [at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]]
        };
        (0..side * side).flat_map(square).collect()
    }

    fn made(triangles: &[[Vec3; 3]], prims: &[u32], own: usize, threads: usize) -> Vec<[u32; 3]> {
        let faces = Faces { triangles, prims, given: &[], own };
        make(&faces, 40.0, &Par { threads }, &Cancel::new()).expect("normals")
    }

    /// The same whatever the threads, and for some triangles with those around them behind, in any order.
    #[test]
    fn a_part_has_the_normals_of_the_whole() {
        let triangles = bumpy(50, 1.4);
        let prims: Vec<u32> = (0..triangles.len() as u32).collect();
        let whole = made(&triangles, &prims, triangles.len(), 1);
        assert_eq!(whole, made(&triangles, &prims, triangles.len(), 2));
        let is_own = |i: usize| i % 100 < 55;
        let mut order: Vec<usize> = (0..triangles.len()).filter(|i| is_own(*i)).collect();
        let own = order.len();
        order.extend((0..triangles.len()).rev().filter(|i| !is_own(*i)));
        let some: Vec<[Vec3; 3]> = order.iter().map(|i| triangles[*i]).collect();
        let prims: Vec<u32> = order.iter().map(|i| *i as u32).collect();
        let part = made(&some, &prims, own, 2);
        assert!(order[..own].iter().zip(&part).all(|(i, codes)| whole[*i] == *codes));
        let (flat, smooth): (Vec<u32>, Vec<u32>) = whole.as_flattened().iter().partition(|code| **code == OWN);
        assert!(flat.len() > 50 && smooth.len() > 5000, "{} flat, {} smooth", flat.len(), smooth.len());
    }

    /// Brute force in double precision: groups by shared edges below the angle, each with its mean.
    #[test]
    fn groups_are_those_of_the_definition() {
        let triangles = bumpy(12, 1.2);
        let prims: Vec<u32> = (0..triangles.len() as u32).collect();
        let found = made(&triangles, &prims, triangles.len(), 1);
        let across = |i: usize| {
            let [a, b, c] = triangles[i].map(|p| p.as_dvec3());
            (b - a).cross(c - a).normalize()
        };
        let least = 40f64.to_radians().cos();
        for (i, triangle) in triangles.iter().enumerate() {
            for (corner, p) in triangle.iter().enumerate() {
                let fan: Vec<usize> = (0..triangles.len()).filter(|k| triangles[*k].contains(p)).collect();
                let meet = |a: usize, b: usize| {
                    let shared = triangles[a].iter().filter(|q| triangles[b].contains(q)).count();
                    shared == 2 && across(a).dot(across(b)) >= least
                };
                let mut group = vec![i];
                while let Some(next) = fan.iter().find(|k| !group.contains(k) && group.iter().any(|g| meet(*g, **k))) {
                    group.push(*next);
                }
                let weighted = |k: usize| {
                    let at = triangles[k].iter().position(|q| q == p).expect("a corner");
                    let [own, next, last] = [0, 1, 2].map(|j| triangles[k][(at + j) % 3].as_dvec3());
                    across(k) * (next - own).angle_between(last - own)
                };
                let mean = |of: &[usize]| of.iter().map(|k| weighted(*k)).sum::<glam::DVec3>().normalize();
                let mut expected = mean(&group);
                if expected.dot(across(i)) < least {
                    group.retain(|k| across(*k).dot(across(i)) >= least);
                    expected = mean(&group);
                }
                let code = found[i][corner];
                let normal = if code == OWN { across(i).as_vec3() } else { octahedral::decode(code) };
                let off = normal.as_dvec3().angle_between(expected).to_degrees();
                // The quick way takes all faces that are near one another as one group.
                assert!(off < 0.2 || fan.len() != group.len(), "triangle {i}, corner {corner}: {off} degrees");
            }
        }
    }

    #[test]
    fn arc_cosines() {
        for i in -1000..=1000 {
            let x = i as f32 / 1000.0;
            assert!((arc_cosine(x) - x.acos()).abs() < 1e-4, "{x}");
        }
    }

    #[test]
    fn directions_of_the_input() {
        assert_eq!([Vec3::ZERO, Vec3::NAN, Vec3::INFINITY, Vec3::new(0.0, f32::NAN, 1.0)].map(given), [OWN; 4]);
        for size in [1e-30, 1.0, 1e30] {
            assert!(octahedral::decode(given(Vec3::new(0.0, size, -size))).y > 0.7);
        }
    }
}
