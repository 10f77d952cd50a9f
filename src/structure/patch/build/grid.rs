//! The words of a tile's grid: vertices, or the net that they are computed from.

use super::frame::Tile;
use crate::geom::surface::dice::BicubicPatch;
use crate::math::octahedral;
use crate::structure::patch::layout::{COMPUTED_WORDS, GRID_WORDS, IS_COMPUTED, IS_RATIONAL, MOST_PLACE};
use crate::structure::patch::net::{CORRECTION_WORDS, Computed, NET_WORDS, Net, RATIONAL_WORDS};
use glam::Vec3;

/// Cosine of the greatest angle between a normal of a tile and that of its patch.
const NORMALS: f32 = 1.0 - 1e-6;

/// The words of a stored grid, and codes of its normals.
pub fn stored(tile: &Tile) -> (Vec<u32>, Option<Vec<u32>>, Vec<u32>) {
    // 0 stands for the normal of the triangle.
    let code = |n: &Vec3| n.try_normalize().map_or(0, octahedral::encode);
    let mut grid = vec![tile.part, tile.face, tile.level, 0];
    grid.extend(tile.positions.iter().flat_map(|p| p.to_array().map(f32::to_bits)));
    (grid, None, tile.normals.iter().map(code).collect())
}

/// The words of a computed grid, and of its net; `None` if a stored grid is smaller, or if the patch has other normals.
pub fn computed(tile: &Tile) -> Option<(Vec<u32>, Vec<u32>)> {
    let patch = tile.patch.as_ref()?;
    let (net, is_rational) = (words_of(patch), patch.is_rational);
    let [[above_u, column], [above_v, row]] = patch.place;
    // Grids of a patch share its net.
    let of_net = net.len() >> (above_u + above_v).min(31);
    let of_stored = GRID_WORDS + tile.positions.len() * 4;
    let most = of_stored.checked_sub(COMPUTED_WORDS + of_net)? / CORRECTION_WORDS;
    if above_u.max(above_v) > MOST_PLACE || Net::at(&net, is_rational)?.check().is_err() {
        return None;
    }
    let mut steps = 0;
    for (side, step) in tile.steps.into_iter().enumerate() {
        // The nearest points of an edge that is coarser than the tile are not on the tile.
        steps |= if step > tile.level { 0 } else { step << (4 * side) };
    }
    let place = patch.place;
    let predicted = Computed { net: Net::at(&net, is_rational)?, net_at: 0, place, steps, corrections: &[] };
    let (side, mut corrections) = (tile.side(), Vec::new());
    for (number, p) in tile.positions.iter().enumerate() {
        // Zeros of both signs are equal as numbers.
        let bits = |p: Vec3| p.to_array().map(f32::to_bits);
        let [x, y, z] = bits(*p);
        if bits(predicted.vertex(tile.level, number % side, number / side)) != [x, y, z] {
            corrections.push([number as u32, x, y, z]);
        }
    }
    if corrections.len() > most || !has_normals(tile, &predicted) {
        return None;
    }
    let kind = tile.level | IS_COMPUTED | if is_rational { IS_RATIONAL } else { 0 };
    let place = above_u | column << 4 | row << 16 | above_v << 28;
    let mut grid = vec![tile.part, tile.face, kind, 0, 0, place, steps | (corrections.len() as u32) << 16];
    grid.extend(corrections.as_flattened());
    Some((grid, net))
}

impl Tile {
    /// Sets the vertices and normals inside of a tile that is a part of a patch.
    pub fn fill_inside(&mut self) {
        let Some(patch) = &self.patch else { return };
        let words = words_of(patch);
        let Some(net) = Net::at(&words, patch.is_rational) else { return };
        let computed = Computed { net, net_at: 0, place: patch.place, steps: 0, corrections: &[] };
        let side = self.side();
        for j in 1..side - 1 {
            let mut at = j * side;
            computed.inner_row(self.level, j, |position, normal| {
                at += 1;
                (self.positions[at], self.normals[at]) = (position, normal);
            });
        }
    }
}

/// True if the normals at the border, where they may be limits, are those of the patch.
fn has_normals(tile: &Tile, computed: &Computed) -> bool {
    let (side, last) = (tile.side(), tile.side() - 1);
    (0..side * side).filter(|at| [at % side, at / side].iter().any(|i| *i == 0 || *i == last)).all(|at| {
        let normal = computed.normal(tile.level, at % side, at / side);
        normal == tile.normals[at] || normal.dot(tile.normals[at]) >= NORMALS
    })
}

/// The words of the net of a patch.
pub fn words_of(patch: &BicubicPatch) -> Vec<u32> {
    let axes = if patch.is_rational { 4 } else { 3 };
    let mut words = Vec::with_capacity(if patch.is_rational { RATIONAL_WORDS } else { NET_WORDS });
    for axis in 0..axes {
        words.extend(patch.points.iter().flat_map(|p| {
            let bits = p[axis].to_bits();
            [bits as u32, (bits >> 32) as u32]
        }));
    }
    words
}
