//! Surfaces of a plant: closed tubes around stems, and leaves folded along the middle.

use super::super::rng::Rng;
use super::super::turn::sin_cos;
use super::grow::{Joint, Plant, Stem, across, level_across};
use super::species::Leaf;
use glam::DVec3;

/// Parts of a plant, in the order in which they are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Organ {
    /// Trunk and branches.
    Bark,
    /// Stems of the last level.
    Twigs,
    /// Leaves.
    Leaves,
}

impl Organ {
    /// All parts, in order.
    pub const ALL: [Self; 3] = [Self::Bark, Self::Twigs, Self::Leaves];

    /// Returns the name of the part.
    pub fn name(self) -> &'static str {
        ["bark", "twigs", "leaves"][self as usize]
    }
}

/// A small indexed mesh, of a stem or of a leaf.
#[derive(Debug, Clone, Default)]
pub struct Piece {
    /// Corners.
    pub vertices: Vec<DVec3>,
    /// Triangles, counterclockwise from outside.
    pub faces: Vec<[u32; 3]>,
}

impl Piece {
    fn clear(&mut self) {
        self.vertices.clear();
        self.faces.clear();
    }
}

/// Calls `each` with the pieces of one part of the plant. Stops at the first error of `each`.
pub fn pieces<E>(plant: &Plant, organ: Organ, mut each: impl FnMut(&Piece) -> Result<(), E>) -> Result<(), E> {
    let last = plant.levels.len() - 1;
    let levels = match organ {
        Organ::Bark => 0..last,
        Organ::Twigs => last..last + 1,
        Organ::Leaves => return leaves(plant, each),
    };
    let mut piece = Piece::default();
    for level in levels {
        for stem in &plant.levels[level] {
            tube(stem, plant.sides[level], &mut piece);
            each(&piece)?;
        }
    }
    Ok(())
}

fn leaves<E>(plant: &Plant, mut each: impl FnMut(&Piece) -> Result<(), E>) -> Result<(), E> {
    let (Some(leaf), Some(twigs)) = (&plant.species.leaf, plant.levels.last()) else { return Ok(()) };
    let (mut piece, mut out) = (Piece::default(), Ok(()));
    for (twig, &count) in twigs.iter().zip(&plant.leaves) {
        twig.attach(&leaf.at, count, |joint, rng| {
            if out.is_ok() {
                blade(leaf, plant.leaf_scale, joint, rng, &mut piece);
                out = each(&piece);
            }
        });
    }
    out
}

/// Makes a tube around a stem, closed by a cap at its base and a point at its tip.
fn tube(stem: &Stem, sides: u32, piece: &mut Piece) {
    piece.clear();
    let (rings, tip) = stem.axis.split_at(stem.axis.len() - 1);
    for s in rings {
        let up = s.dir.cross(s.side);
        for i in 0..sides {
            let (sin, cos) = sin_cos(360.0 * f64::from(i) / f64::from(sides));
            piece.vertices.push(s.at + (s.side * cos + up * sin) * s.radius);
        }
    }
    let point = piece.vertices.len() as u32;
    piece.vertices.push(tip[0].at);
    for i in 1..sides - 1 {
        piece.faces.push([0, i + 1, i]);
    }
    for ring in 0..rings.len() as u32 {
        for i in 0..sides {
            let (a, b) = (ring * sides + i, ring * sides + (i + 1) % sides);
            if ring + 1 == rings.len() as u32 {
                piece.faces.push([a, b, point]);
            } else {
                piece.faces.extend([[a, b, b + sides], [a, b + sides, a + sides]]);
            }
        }
    }
}

/// Makes a leaf at a joint: a strip that bends along its length and is folded along its middle. Its middle
/// stays above the ground; if an edge does not, the leaf is raised by less than its width.
fn blade(leaf: &Leaf, [long, wide]: [f64; 2], joint: &Joint, rng: &mut Rng, piece: &mut Piece) {
    piece.clear();
    let size = rng.range(0.75, 1.2);
    let (length, half) = (leaf.length * long * size, 0.5 * leaf.length * leaf.width * wide * size);
    let mut dir = joint.dir.normalize_or(DVec3::Z);
    let (sin, cos) = sin_cos(leaf.roll * rng.range(-1.0, 1.0));
    let level = level_across(dir);
    let mut side = level * cos + dir.cross(level) * sin;
    let steps = leaf.stations.max(1) + 1;
    let bend = DVec3::Z * (leaf.bend / f64::from(steps));
    let mut at = joint.at;
    piece.vertices.push(at);
    for i in 1..=steps {
        let t = position(leaf, i, steps);
        let step = length * (t - position(leaf, i - 1, steps));
        if at.z + dir.z * step < 0.0 {
            // It lies on the ground from here on.
            dir = DVec3::new(dir.x, dir.y, 0.0).normalize_or(dir.cross(side));
            side = across(side, dir);
        }
        at += dir * step;
        if i == steps {
            piece.vertices.push(at);
            break;
        }
        let (w, up) = (half * profile(leaf, t), dir.cross(side));
        // Left, right, and between them the fold, unless base and tip alone make it.
        piece.vertices.extend([at - side * w + up * (w * leaf.fold), at + side * w + up * (w * leaf.fold)]);
        if leaf.stations > 0 {
            piece.vertices.push(at);
        }
        dir = (dir + bend).normalize_or(dir);
    }
    blade_faces(leaf.stations, &mut piece.faces);
    let lowest = piece.vertices.iter().fold(0.0, |z: f64, v| z.min(v.z));
    piece.vertices.iter_mut().for_each(|v| v.z -= lowest);
}

/// Adds the triangles of a leaf.
fn blade_faces(stations: u32, faces: &mut Vec<[u32; 3]>) {
    if stations == 0 {
        faces.extend([[0, 2, 3], [0, 3, 1]]);
        return;
    }
    let tip = 3 * stations + 1;
    faces.extend([[0, 2, 3], [0, 3, 1]]);
    for i in 1..stations {
        let (a, b) = (3 * i - 2, 3 * i + 1);
        faces.extend([[a, a + 2, b + 2], [a, b + 2, b], [a + 2, a + 1, b + 1], [a + 2, b + 1, b + 2]]);
    }
    faces.extend([[tip - 3, tip - 1, tip], [tip - 1, tip - 2, tip]]);
}

/// Returns the place of a station as a fraction of the length. A leaf with one station has it at its widest place.
fn position(leaf: &Leaf, i: u32, steps: u32) -> f64 {
    if steps == 2 { [0.0, leaf.widest, 1.0][i as usize] } else { f64::from(i) / f64::from(steps) }
}

/// Returns the width at `t` over the largest width: a parabola on each side of the widest place.
fn profile(leaf: &Leaf, t: f64) -> f64 {
    let x = if t < leaf.widest { 1.0 - t / leaf.widest } else { (t - leaf.widest) / (1.0 - leaf.widest) };
    1.0 - x * x
}

#[cfg(test)]
mod tests {
    use super::super::species::SPECIES;
    use super::*;

    #[test]
    fn leaves_near_the_ground_stay_above_it_and_near_their_joint() {
        let mut rng = Rng::new(9);
        let directions = [DVec3::NEG_Z, DVec3::X, DVec3::new(0.6, 0.0, -0.8), DVec3::new(0.0, 1e-9, -1.0)];
        let (mut piece, mut raised) = (Piece::default(), 0);
        for leaf in SPECIES.iter().filter_map(|s| s.leaf.as_ref()) {
            for (i, dir) in directions.iter().cycle().take(400).enumerate() {
                let joint = Joint { at: DVec3::Z * 1e-3 * (i % 7) as f64, dir: *dir, radius: 0.01, place: 0.5 };
                blade(leaf, [1.0, 1.0], &joint, &mut rng, &mut piece);
                assert_eq!(piece.faces.len() as u64, leaf.triangles());
                assert!(piece.vertices.iter().all(|v| v.z >= 0.0), "{leaf:?} {dir}");
                let up = piece.vertices[0].distance(joint.at);
                assert!(up <= 0.6 * 1.2 * leaf.length * leaf.width, "{leaf:?} {dir}: raised {up} m");
                raised += u32::from(up > 0.0);
                for [a, b, c] in piece.faces.iter().map(|f| f.map(|v| piece.vertices[v as usize])) {
                    let area = (b - a).cross(c - a).length();
                    assert!(area > 0.01 * leaf.length * leaf.length * leaf.width, "{leaf:?} {dir}: {area}");
                }
            }
        }
        assert!(raised > 1000, "{raised}");
    }
}
