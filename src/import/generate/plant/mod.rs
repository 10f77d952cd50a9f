//! `plant`: trees and smaller plants of 13 species, for forests.
//!
//! **Growth.** A plant has levels of stems: trunk, branches on the trunk, twigs on branches; leaves are on the stems of
//! the last level, in the manner of Weber, Penn, "Creation and Rendering of Realistic Trees", 1995. The growth of all
//! levels and species is the same ([`grow`]); a table of numbers makes the difference ([`species`]). Stems of a level
//! are distributed over their parents in proportion to length, and along a parent by phyllotaxis: spiral, whorls or
//! two rows. The direction of a stem is bent step by step, to the light or by weight, and at random.
//!
//! **Surfaces** ([`mesh`]). Stems are tubes of few sides that taper to a point. Each is closed by a cap at its base,
//! inside of its parent. Leaves are open strips, folded along the middle.
//!
//! **Parts** are bark, twigs (the stems of the last level) and leaves, below a group with the name of the species. A
//! dead tree has no leaves.
//!
//! **Units** are metres, z is up, the foot is at the origin, and the lowest point at z = 0. The height is drawn from
//! the range of the species; the whole plant is scaled to it.
//!
//! **Count.** More triangles make more branches, and tubes of more sides; leaves become more and smaller. They take
//! what the stems leave over, so that the target is missed by at most one leaf, or one twig of a dead tree.
//!
//! **Same everywhere.** Besides +, −, ·, / and square roots there are only the functions of [`turn`](super::turn), so
//! that a plant has the same bits on every machine. Each stem has random numbers of its own.

mod grow;
mod mesh;
mod species;
#[cfg(test)]
mod tests;

use super::rng::Rng;
use super::{GenerateOptions, Target};
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use crate::import::{MaterialDesc, PartDesc, PartKey, UpAxis};
use glam::DVec3;
use grow::Plant;
use mesh::{Organ, Piece, pieces};
use species::{SPECIES, Species};

/// Number of species.
pub const COUNT: usize = SPECIES.len();
/// Range of the number of triangles.
const TRIANGLES: std::ops::RangeInclusive<u64> = 2_000..=4_000_000;
/// Number of triangles that are passed on together.
const BATCH: usize = 1 << 13;
/// Stream of random numbers of the height.
const HEIGHT: u64 = 0x48_e164;

/// Returns the names of the species, by number.
pub const fn names() -> [&'static str; COUNT] {
    let mut names = [""; COUNT];
    let mut i = 0;
    while i < COUNT {
        names[i] = SPECIES[i].name;
        i += 1;
    }
    names
}

/// Generates the plant into `target`.
pub(super) fn generate(options: &GenerateOptions, cancel: &Cancel, target: &mut dyn Target) -> Result<()> {
    let (species, seed) = (species_of(options)?, species_seed(options));
    let height = Rng::stream(seed, HEIGHT).range(species.height[0], species.height[1]);
    let plant = Plant::grow(species, height, options.triangles, seed);
    cancel.check()?;
    let scale = height / top(&plant);
    let parts = parts(species, target)?;
    let mut batch = Batch { target, cancel, first: 0, vertices: Vec::new(), faces: Vec::new() };
    for (organ, part) in parts {
        pieces(&plant, organ, |piece| batch.add(part, scale, piece))?;
        batch.send(part)?;
    }
    Ok(())
}

/// Returns the species, or the error of an option out of range.
fn species_of(options: &GenerateOptions) -> Result<&'static Species> {
    if !TRIANGLES.contains(&options.triangles) {
        return Err(Error::bad_argument("plant: the number of triangles must be between 2,000 and 4,000,000"));
    }
    SPECIES.get(options.species as usize).ok_or_else(|| {
        Error::bad_argument(format!("plant: there is no species {}; the species are 0 to 12", options.species))
    })
}

/// Returns the seed for one species, so that plants of equal seed differ in more than shape.
fn species_seed(options: &GenerateOptions) -> u64 {
    Rng::stream(options.seed, u64::from(options.species)).next()
}

/// Returns the largest z of the plant.
fn top(plant: &Plant) -> f64 {
    let mut top = 0.0_f64;
    for organ in Organ::ALL {
        let Ok(()) = pieces(plant, organ, |piece| {
            top = piece.vertices.iter().fold(top, |top, v| top.max(v.z));
            Ok::<_, std::convert::Infallible>(())
        });
    }
    top
}

/// Adds materials and parts; returns the organs of the species with their parts.
fn parts(species: &Species, target: &mut dyn Target) -> Result<Vec<(Organ, PartKey)>> {
    target.units(Some(1.0), UpAxis::Z)?;
    let organs = || Organ::ALL.into_iter().filter(|&organ| organ != Organ::Leaves || species.leaf.is_some());
    let mut materials = Vec::new();
    for organ in organs() {
        let colour = species.colours[organ as usize];
        let roughness = if organ == Organ::Leaves { 0.6 } else { 0.9 };
        let material = MaterialDesc { colour, opacity: 1.0, metalness: 0.0, roughness };
        materials.push(target.material(material, organ.name())?);
    }
    let whole = target.part(PartDesc { id: Some(1), name: species.name.into(), parent: None, material: None })?;
    let mut parts = Vec::new();
    for (organ, material) in organs().zip(materials) {
        let id = Some(2 + organ as u64);
        let part = PartDesc { id, name: organ.name().into(), parent: Some(whole), material: Some(material) };
        parts.push((organ, target.part(part)?));
    }
    Ok(parts)
}

/// Pieces of one part that are passed on together.
struct Batch<'a> {
    target: &'a mut dyn Target,
    cancel: &'a Cancel,
    /// Number of vertices that were passed on before.
    first: u32,
    vertices: Vec<[f32; 3]>,
    faces: Vec<[u32; 3]>,
}

impl Batch<'_> {
    fn add(&mut self, part: PartKey, scale: f64, piece: &Piece) -> Result<()> {
        let base = self.first + self.vertices.len() as u32;
        self.vertices.extend(piece.vertices.iter().map(|&v: &DVec3| (v * scale).as_vec3().to_array()));
        self.faces.extend(piece.faces.iter().map(|f| f.map(|v| base + v)));
        if self.faces.len() < BATCH { Ok(()) } else { self.send(part) }
    }

    fn send(&mut self, part: PartKey) -> Result<()> {
        self.cancel.check()?;
        let (first, vertices) = (self.first, &self.vertices);
        self.target.indexed(part, vertices, &self.faces, &|v| vertices[(v - first) as usize])?;
        self.first += vertices.len() as u32;
        self.vertices.clear();
        self.faces.clear();
        Ok(())
    }
}
