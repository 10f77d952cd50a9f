//! Places of the trees of a forest of any size, in little memory: a square of square tiles, of which there are 16, each
//! with its trees. A forest of 40 million trees is 25,000 tiles.
//!
//! **Tiles** ([`tiles`]) are Wang tiles: each has one of two colours at each edge, and lies beside tiles of the same
//! colours only. The colours of a forest's edges are random, so that it has no period, and each choice of four colours
//! has one tile.
//!
//! **Trees** ([`discs`]) keep a least distance, within tiles, across edges and at corners, and no further tree fits in
//! anywhere. There are about 0.7 in each square as wide as the distance. Species, turn and size are random.
//!
//! **Count.** The side of tiles is chosen so that the number of trees is as requested, within 1 %; the number of tiles
//! so that different trees and tiles are about as many.
//!
//! **Units** are metres, z is up, the ground is z = 0, and the middle of the forest the origin. The same options give
//! the same bits on every machine.

mod discs;
#[cfg(test)]
mod tests;
mod tiles;

use super::plant;
use super::rng::Rng;
use super::turn::sin_cos;
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use glam::DVec2;
use std::ops::RangeInclusive;

/// Range of the number of trees.
const TREES: RangeInclusive<u64> = 100..=1_000_000_000_000;
/// Range of the least distance between trees, metres.
const SPACING: RangeInclusive<f64> = 0.01..=10_000.0;
/// Range of the sizes of trees, relative to their model.
const SCALES: [f64; 2] = [0.7, 1.3];
/// Least mean number of trees of a tile. Smaller tiles are mostly borders.
const LEAST_IN_TILE: f64 = 100.0;
/// Number of trees in a square as wide as the least distance, before any are counted: that of discs placed at random
/// one after the other (Feder, "Random sequential adsorption", 1980: 0.547 of the area, with half of the distance as
/// radius).
const DENSITY: f64 = 0.6965;
/// Number of sets of tiles that are tried for the number of trees.
const TRIES: u64 = 64;
/// Deviation from the requested number of trees that ends the tries.
const CLOSE: f64 = 0.005;
/// Streams of random numbers of the colours of edges, the looks of trees and the sets of tiles.
const COLOURS: u64 = 0xc0_1045;
const LOOKS: u64 = 0x10_0c5;
const SETS: u64 = 0x5e_75;

/// Options of a forest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForestOptions {
    /// Target number of trees, reached within 1 %: from 100 to 10¹².
    pub trees: u64,
    /// Least distance between trees, metres: from 0.01 to 10,000.
    pub spacing: f64,
    /// Number of species, of which each is as frequent: the first of [`super::SPECIES`].
    pub species: u32,
    /// Seed; different seeds give different forests.
    pub seed: u64,
}

impl Default for ForestOptions {
    fn default() -> Self {
        Self { trees: 1_000_000, spacing: 5.0, species: plant::COUNT as u32, seed: 0 }
    }
}

/// A tree in a tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tree {
    /// Place in the tile, whose middle is the origin, metres.
    pub place: DVec2,
    /// Index into [`super::SPECIES`].
    pub species: u32,
    /// Size relative to the model, from 0.7 to 1.3.
    pub scale: f32,
    /// Quaternion x, y, z, w of the turn about the vertical.
    pub rotation: [f32; 4],
}

/// A forest: tiles, and which of them is where.
#[derive(Debug, Clone, PartialEq)]
pub struct Forest {
    /// Number of tiles in a row, and of rows.
    across: u32,
    /// Side of a tile, metres.
    side: f64,
    seed: u64,
    trees: u64,
    tiles: Vec<Vec<Tree>>,
}

impl Forest {
    /// Plants a forest. Fails with `BadArgument` for an option out of range, and with `Cancelled`.
    pub fn plant(options: &ForestOptions, cancel: &Cancel) -> Result<Self> {
        check(options)?;
        let wanted = options.trees as f64;
        let across = across(wanted);
        let mut density = DENSITY;
        let mut best: Option<(f64, f64, Vec<Vec<DVec2>>)> = None;
        for attempt in 0..TRIES {
            let side = (wanted / density).sqrt() / f64::from(across) * options.spacing;
            let seed = Rng::stream(options.seed ^ SETS, attempt).next();
            let tiles = tiles::tiles(side, options.spacing, seed, cancel)?;
            let found = count(across, options.seed, &tiles) as f64;
            let off = (found / wanted - 1.0).abs();
            if best.as_ref().is_none_or(|(least, ..)| off < *least) {
                best = Some((off, side, tiles));
            }
            if off <= CLOSE {
                break;
            }
            // Half of the way: the rest of the deviation is random.
            density *= (found / wanted).sqrt();
        }
        let Some((_, side, tiles)) = best else { return Err(Error::Internal("a forest without tiles".into())) };
        let trees = count(across, options.seed, &tiles);
        let tiles = tiles.iter().enumerate().map(|(tile, points)| dressed(points, side, options, tile)).collect();
        Ok(Self { across, side, seed: options.seed, trees, tiles })
    }

    /// Number of tiles in a row, and of rows.
    pub fn across(&self) -> u32 {
        self.across
    }

    /// Side of a tile, metres.
    pub fn side(&self) -> f64 {
        self.side
    }

    /// Number of trees of all rows.
    pub fn trees(&self) -> u64 {
        self.trees
    }

    /// The trees of each tile.
    pub fn tiles(&self) -> &[Vec<Tree>] {
        &self.tiles
    }

    /// The tile in a column of a row, which are counted from x = y = 0 and may be any.
    pub fn tile_at(&self, column: u32, row: u32) -> usize {
        tile_at(self.seed, column, row)
    }

    /// The middle of the tile in a column of a row.
    pub fn middle_of(&self, column: u32, row: u32) -> DVec2 {
        (DVec2::new(column.into(), row.into()) - 0.5 * f64::from(self.across - 1)) * self.side
    }
}

/// Fails for an option out of range.
fn check(options: &ForestOptions) -> Result<()> {
    let bad = |what: &str| Err(Error::bad_argument(format!("forest: {what}")));
    if !TREES.contains(&options.trees) {
        return bad("the number of trees must be from 100 to 1,000,000,000,000");
    }
    if !SPACING.contains(&options.spacing) {
        return bad("the spacing must be from 0.01 to 10,000 metres");
    }
    if options.species == 0 || options.species as usize > plant::COUNT {
        return bad(&format!("the number of species must be from 1 to {}", plant::COUNT));
    }
    Ok(())
}

/// Number of tiles in a row. Each of `tiles::COUNT` tiles with its trees is in memory, and each place of a tile; their
/// sum is least when they are equally many.
fn across(trees: f64) -> u32 {
    let in_tile = (trees / tiles::COUNT as f64).sqrt().max(LEAST_IN_TILE);
    (trees / in_tile).sqrt().round().max(1.0) as u32
}

/// The colour of the edge to the left of the tile in a column of a row, or of the lower edge.
fn colour(seed: u64, is_lower: bool, column: u32, row: u32) -> u8 {
    let at = u64::from(column) << 32 | u64::from(row);
    let mut rng = Rng::stream(seed ^ COLOURS ^ u64::from(is_lower) << 32, at);
    (rng.next() >> 63) as u8
}

fn tile_at(seed: u64, column: u32, row: u32) -> usize {
    let [right, upper] = [column, row].map(|at| at.wrapping_add(1));
    tiles::number([
        colour(seed, false, column, row),
        colour(seed, false, right, row),
        colour(seed, true, column, row),
        colour(seed, true, column, upper),
    ])
}

/// Number of points of all tiles of a forest.
fn count(across: u32, seed: u64, tiles: &[Vec<DVec2>]) -> u64 {
    let cells = (0..across).flat_map(|row| (0..across).map(move |column| (column, row)));
    cells.map(|(column, row)| tiles[tile_at(seed, column, row)].len() as u64).sum()
}

/// Makes trees of the points of a tile.
fn dressed(points: &[DVec2], side: f64, options: &ForestOptions, tile: usize) -> Vec<Tree> {
    let mut rng = Rng::stream(options.seed ^ LOOKS, tile as u64);
    let tree = |p: &DVec2| {
        let (sin, cos) = sin_cos(rng.range(0.0, 180.0));
        Tree {
            place: *p - 0.5 * side,
            species: rng.below(options.species.into()) as u32,
            scale: rng.range(SCALES[0], SCALES[1]) as f32,
            rotation: [0.0, 0.0, sin as f32, cos as f32],
        }
    };
    points.iter().map(tree).collect()
}
