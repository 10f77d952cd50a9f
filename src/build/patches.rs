//! The build of a tree of a surface: the surface is cut into square tiles of a grid, each flat enough for a system of
//! its own, and neighbours share blocks (`structure::bake::surfaces`).
//!
//! Tiles are made a few at a time, on all threads, and their blocks are put aside at once: memory is that of the
//! surface's control points and of what the tree above blocks takes, whatever the number of triangles.

use super::edges::Edges;
use super::origin;
use super::output::{ClassAside, Output, Span};
use super::parts::Assembly;
use super::surfaces::{Shape, Surface};
use super::survey::OfPart;
use super::{BuildOptions, SurfaceLeaves};
use crate::base::error::{Error, Result};
use crate::base::progress::Phase;
use crate::geom::surface::dice::{BicubicPatch, Dicer, Dicing, Quads, Tile as Samples};
use crate::math::{Bounds, DBounds};
use crate::store::TreeRow;
use crate::structure::Par;
use crate::structure::bake::Counts;
use crate::structure::bake::surfaces::{self as bake, BuiltFrame, CLASSES, MOST_LEVEL, Plan, Plans, Tile, Upper};
use glam::{DVec3, Vec3, Vec4};
use std::collections::BTreeMap;
use std::time::Instant;

/// Tiles that a thread makes at a time, of the greatest level.
const TILES: usize = 8;
/// Tiles of a quad whose plans are made at a time: a square of so many.
const SQUARE: usize = 256;
/// Work that is done before blocks are encoded, in such portions.
const BATCH: usize = 32;

/// A surface whose tree is built.
pub struct Patches<'a> {
    pub surface: &'a Surface,
    pub options: &'a BuildOptions,
    /// Number of the tree.
    pub index: usize,
    pub local_parts: u32,
    pub span: Span,
}

/// Where a quad lies: its face with that face's part, the corner of a face with other than four, and the level, the
/// column and the row in the square of the face.
struct Home {
    face: u32,
    part: u32,
    corner: u32,
    place: [u32; 3],
}

/// Some tiles of a quad, by their numbers along a curve that fills the square.
struct Work {
    quad: usize,
    level: u32,
    tiles: std::ops::Range<usize>,
    /// True if plans are made of its frames and those before.
    is_last: bool,
}

/// Tiles that are made.
#[derive(Default)]
struct Made {
    frames: Vec<BuiltFrame>,
    /// See [`Work::is_last`].
    is_last: bool,
    parts: BTreeMap<u32, OfPart>,
    position_error: f64,
}

impl Patches<'_> {
    /// Builds and writes the tree. Returns its row of the file's tree table.
    pub fn build(self, output: &mut Output, assembly: &mut Assembly) -> Result<TreeRow> {
        let asked = self.options.dicing;
        match &self.surface.shape {
            Shape::Cage(cage) => {
                let mesh = cage.mesh();
                let checked = mesh.checked()?;
                let quads = mesh.quads(&checked)?;
                let home = |quad: usize| {
                    let (face, corner, place) = quads.place_in_face(quad);
                    Home { face, part: mesh.part(face), corner, place }
                };
                self.bake(&quads, mesh.dicing(asked), false, &home, output, assembly)
            }
            Shape::Nurbs(nurbs) => {
                let mesh = nurbs.mesh();
                let checked = mesh.checked()?;
                // Each rectangle between knots is a face.
                let home = |quad: usize| Home { face: quad as u32, part: mesh.part, corner: 0, place: [0; 3] };
                self.bake(&mesh.quads(&checked), mesh.dicing(asked), mesh.is_reversed, &home, output, assembly)
            }
        }
    }

    fn bake<Q: Quads + Sync>(
        &self,
        quads: &Q,
        dicing: Dicing,
        is_reversed: bool,
        home: &(dyn Fn(usize) -> Home + Sync),
        output: &mut Output,
        assembly: &mut Assembly,
    ) -> Result<TreeRow> {
        let begun = Instant::now();
        let (par, cancel, progress, span) = (output.par, output.cancel, output.progress, self.span);
        let bounds = self.surface.shape.points().iter().copied().fold(DBounds::EMPTY, DBounds::with);
        let origin = origin::choose(&bounds, false);
        let mut row = TreeRow {
            first_block: output.writer.blocks_written(),
            structure: bake::STRUCTURE as u32,
            local_parts: self.local_parts,
            origin: origin.to_array(),
            ..TreeRow::EMPTY
        };
        let dicer = Dicer::new(quads, dicing, cancel)?;
        let colours = assembly.colours(self.index, self.local_parts);
        let maker = Maker {
            dicer: &dicer,
            home,
            first_face: self.surface.first_face,
            origin,
            colours: &colours,
            is_reversed,
            is_computed: self.options.surface_leaves == SurfaceLeaves::Boxes && quads.has_bicubics(),
            cosine_of_flat: self.options.cosine_of_flat(),
        };
        let levels = par.map(quads.count(), |quad| if cancel.check().is_ok() { dicer.level(quad) } else { 1 });
        cancel.check()?;
        let works = works(quads, (origin, maker.is_computed), &levels, &par);
        let mut blocks = Blocks {
            plans: Plans::default(),
            ready: Vec::new(),
            aside: [output.aside(), output.aside()],
            cells: Vec::new(),
            counts: Counts::default(),
        };
        let mut of_parts: BTreeMap<u32, OfPart> = BTreeMap::new();
        let (total, mut done, mut iter) = (works.len(), 0, works.into_iter());
        loop {
            let some: Vec<Work> = iter.by_ref().take(BATCH).collect();
            if some.is_empty() {
                break;
            }
            done += some.len();
            let made = par.map_items(some, |work| -> Result<Made> {
                cancel.check()?;
                Ok(maker.make(&work))
            });
            for made in made {
                let Made { frames, is_last, parts, position_error } = made?;
                row.position_error = row.position_error.max(position_error);
                parts.into_iter().for_each(|(part, of)| of.add_to(&mut of_parts, part));
                row.triangles += frames.iter().map(|frame| frame.triangles).sum::<u64>();
                frames.into_iter().for_each(|frame| blocks.plans.push(frame));
                if is_last || blocks.plans.is_full() {
                    blocks.ready.extend(blocks.plans.close());
                }
            }
            let most = self.options.max_triangles;
            if most > 0 && output.report.triangles_in + row.triangles > most {
                return Err(Error::OverLimit { what: "triangles of the input", most, limit: "max_triangles" });
            }
            blocks.put_aside(output)?;
            progress.advance(span.part(done as f64 / total as f64 * 0.9, 1.0).0);
        }
        output.report.chunks += 1;
        assembly.add(self.index, origin, &of_parts, cancel)?;
        output.report.seconds.build += begun.elapsed().as_secs_f64();
        if let Dicing::Tolerance(tolerance) = dicing {
            row.position_error += tolerance;
        }
        output.report.position_error = output.report.position_error.max(row.position_error);
        progress.enter(Phase::Write);
        blocks.write(output, row, span.part(0.9, 1.0))
    }
}

/// The work in an order in which neighbours follow each other: groups of quads by a partition of their middles, and the
/// tiles of a quad along a curve that fills its square.
fn works<Q: Quads + Sync>(quads: &Q, (origin, is_computed): (DVec3, bool), levels: &[u32], par: &Par) -> Vec<Work> {
    // Tiles of a quad, by the logarithm of their number.
    let tiles = |level: u32| 2 * (level - level.min(MOST_LEVEL));
    let mut items = par.map(levels.len(), |quad| {
        let middle = (quads.sample(quad, 0.5, 0.5).position - origin).as_vec3();
        let load = bake::expected(levels[quad].min(MOST_LEVEL), 1 << tiles(levels[quad]), is_computed);
        bake::Item { bounds: Bounds { min: middle, max: middle }, load, index: quad as u32 }
    });
    let groups = bake::pack(&mut items, bake::AT_A_TIME, f32::INFINITY);
    let mut works = Vec::new();
    for group in groups {
        for item in &items[group] {
            let (quad, level) = (item.index as usize, levels[item.index as usize]);
            let count = 1usize << tiles(level);
            works.extend((0..count).step_by(TILES).map(|first| {
                let tiles = first..count.min(first + TILES);
                Work { quad, level, is_last: tiles.end % SQUARE == 0, tiles }
            }));
        }
        works.last_mut().into_iter().for_each(|last: &mut Work| last.is_last = true);
    }
    works
}

/// Greatest distance that rounding of the coordinates moves a point, as a share of the greatest of them.
const ROUNDED: f64 = 1.05e-7;
/// Greatest level of tiles that are not divided: the frames of their quarters would take more space than they save.
const WHOLE_LEVEL: u32 = 3;

/// Makes tiles.
struct Maker<'a, Q> {
    dicer: &'a Dicer<'a, Q>,
    home: &'a (dyn Fn(usize) -> Home + Sync),
    first_face: u32,
    origin: DVec3,
    colours: &'a [Vec4],
    is_reversed: bool,
    /// True if grids are computed where their surface allows it.
    is_computed: bool,
    /// See [`BuildOptions::surface_flat`].
    cosine_of_flat: f32,
}

impl<Q: Quads> Maker<'_, Q> {
    fn make(&self, work: &Work) -> Made {
        let mut made = Made { is_last: work.is_last, ..Made::default() };
        let mut samples = Samples::default();
        let level = work.level.min(MOST_LEVEL);
        let home = (self.home)(work.quad);
        let face = self.first_face + home.face;
        for number in work.tiles.clone() {
            let (i, j) = bake::of_morton(number);
            let above = work.level - level;
            let square = [above, i as u32, j as u32];
            let patch = self.patch(work.quad, square);
            if patch.is_some() {
                self.dicer.border(work.quad, work.level, level, square[1], square[2], &mut samples);
            } else {
                self.dicer.tile(work.quad, work.level, level, square[1], square[2], &mut samples);
            }
            let place =
                [home.place[0] + above, (home.place[1] << above) + i as u32, (home.place[2] << above) + j as u32];
            let mut tile = Tile {
                level,
                positions: samples.positions.iter().map(|p| (*p - self.origin).as_vec3()).collect(),
                normals: std::mem::take(&mut samples.normals),
                part: home.part,
                colour: self.colours.get(home.part as usize).map_or(Vec3::splat(0.6), |c| c.truncate()),
                face,
                corner: home.corner,
                place,
                is_turned: false,
                square,
                steps: self.steps(work, i, j, level),
                patch,
            };
            // Samples that were left out have no position yet.
            let error = |(p, stored): (&DVec3, &Vec3)| (stored.as_dvec3() + self.origin).distance(*p);
            let is_there = |at: &usize| tile.patch.is_none() || !tile.is_inside(*at);
            let all = (0..tile.positions.len()).filter(is_there);
            let errors = all.map(|at| error((&samples.positions[at], &tile.positions[at])));
            made.position_error = errors.fold(made.position_error, f64::max);
            if tile.patch.is_some() {
                tile.fill_inside();
                let greatest = tile.positions.iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
                made.position_error = made.position_error.max(f64::from(greatest) * ROUNDED);
            }
            self.split(tile, work.quad, &mut made);
        }
        made
    }

    /// The patch that a square of a quad is a part of, relative to the tree's origin.
    fn patch(&self, quad: usize, square: [u32; 3]) -> Option<BicubicPatch> {
        if !self.is_computed {
            return None;
        }
        let mut patch = self.dicer.surface().bicubic(quad, square)?;
        for p in &mut patch.points {
            *p = (p.truncate() - self.origin * p.w).extend(p.w);
        }
        Some(patch)
    }

    /// By how many levels the edges at the sides of a tile are coarser; 0 at sides that are within the quad.
    fn steps(&self, work: &Work, i: usize, j: usize, level: u32) -> [u32; 4] {
        let last = (1usize << (work.level - level)) - 1;
        let is_on = [j == 0, j == last, i == 0, i == last];
        let steps = self.dicer.steps(work.quad, work.level);
        [0, 1, 2, 3].map(|side| if is_on[side] { steps[side] } else { 0 })
    }

    /// Adds a tile, or its quarters where it is not flat, or in several patches.
    fn split(&self, mut tile: Tile, quad: usize, made: &mut Made) {
        let is_in_several = self.is_computed && tile.patch.is_none();
        if tile.level > WHOLE_LEVEL && (is_in_several || !tile.is_flat(self.cosine_of_flat)) {
            for number in 0..4 {
                let mut quarter = tile.quarter(number);
                if tile.patch.is_none() {
                    quarter.patch = self.patch(quad, quarter.square);
                }
                self.split(quarter, quad, made);
            }
            return;
        }
        if self.is_reversed {
            tile.turn_over();
        }
        let (border, stored) = (tile.border(), |p: &Vec3| p.as_dvec3());
        let of = OfPart {
            bounds: Bounds::of(&tile.positions),
            count: 0,
            edges: Edges::around(self.origin, border.iter().map(stored)),
        };
        let frame = bake::build(&tile);
        // Cells that collapse at a coarser neighbour are no triangles of the input, so the frame's are all that count.
        OfPart { count: frame.triangles, bounds: if frame.triangles > 0 { of.bounds } else { Bounds::EMPTY }, ..of }
            .add_to(&mut made.parts, tile.part);
        // A tile that collapses to a point or a line shows nothing.
        if frame.triangles > 0 {
            made.frames.push(frame);
        }
    }
}

/// Blocks of the tree on their way to the file.
struct Blocks {
    plans: Plans,
    ready: Vec<Plan>,
    /// Fine blocks and leaf blocks.
    aside: [ClassAside; CLASSES - 1],
    /// The contents of fine blocks.
    cells: Vec<bake::Cell>,
    counts: Counts,
}

impl Blocks {
    /// Encodes the blocks that are planned.
    fn put_aside(&mut self, output: &mut Output) -> Result<()> {
        let encoded = output.par.map_items(std::mem::take(&mut self.ready), bake::encode);
        let mut baked = Vec::with_capacity(encoded.len());
        for (blocks, cell, counts) in encoded {
            self.counts.add_below(counts);
            self.cells.push(cell);
            baked.push(Vec::from(blocks));
        }
        let at = output.progress.fraction();
        output.put_aside(baked, |blocks| blocks, &mut self.aside, Span(at, at))
    }

    /// Writes all blocks. Returns the row with their numbers.
    fn write(self, output: &mut Output, mut row: TreeRow, span: Span) -> Result<TreeRow> {
        if self.cells.is_empty() {
            return Ok(row);
        }
        let fine = self.cells.len() as u32;
        let upper = Upper::over(self.cells);
        let Bounds { min, max } = upper.bounds;
        row.bounds = [min.x, min.y, min.z, max.x, max.y, max.z];
        row.class_blocks = [upper.count() as u32, fine, fine, 0];
        row.block_count = row.class_blocks.iter().sum();
        row.nodes = upper.nodes + self.counts.nodes;
        (row.leaves, row.references) = (self.counts.leaves, self.counts.references);
        row.max_stack = bake::max_stack(upper.depth + self.counts.depth);
        let (first, at) = (row.first_block, output.progress.fraction());
        output.write_blocks((0..upper.count()).collect(), |i| vec![upper.encode(i, first)], Span(at, at))?;
        self.aside.into_iter().try_for_each(|class| output.write_aside(class, span))?;
        Ok(row)
    }
}
