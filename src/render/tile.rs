//! Tiles: squares of pixels. A tile is a frame's unit of work.

use super::film::{Buffer, Outputs};
use super::integrators::direct::{ACROSS, DOWN, Scratch};
use super::integrators::first::First;
use super::integrators::{Colours, Integrator, Picture};
use super::merged::Quality;
use super::tone::Code;
use crate::math::bits;
use crate::math::{BUNDLE, PACKET};
use crate::simd::dispatch;
use std::ops::Range;

/// Side length of a tile in pixels.
pub(super) const TILE: u32 = 32;
pub(super) const PIXELS: usize = (TILE * TILE) as usize;
/// Packets of a tile: exactly one bundle.
pub(super) const PACKETS: usize = PIXELS / PACKET;
const _: () = assert!(PACKETS == BUNDLE);

/// The pixels of a tile in each buffer, before they are copied to the film.
pub(super) struct TilePixels {
    pub width: u32,
    pub height: u32,
    srgb: Box<[[u8; 4]; PIXELS]>,
    linear: Box<[[f32; 4]; PIXELS]>,
    depth: Box<[f32; PIXELS]>,
    normal: Box<[[f32; 3]; PIXELS]>,
    part: Box<[u64; PIXELS]>,
    prim: Box<[u64; PIXELS]>,
    instance: Box<[u64; PIXELS]>,
    occurrence: Box<[u64; PIXELS]>,
    kind: Box<[u8; PIXELS]>,
    error: Box<[f32; PIXELS]>,
    shading_normal: Box<[[f32; 3]; PIXELS]>,
    uv: Box<[[f32; 2]; PIXELS]>,
    quality: Quality,
    /// Sums of the samples of each packet. (On the stack they would take a third of what calls may take.)
    sums: Vec<Colours>,
}

/// Counts and errors that a tile contributes to the status.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    pub exact: u64,
    pub lod: u64,
    pub missing: u64,
    /// Pixels with a hit.
    pub hits: u64,
    /// Sum of the errors in pixels.
    pub error_sum: f64,
    pub error_max: f32,
}

impl TilePixels {
    #[inline(never)] // its arrays would lie on the stack below all calls of its caller
    pub fn new() -> Self {
        Self {
            width: 0,
            height: 0,
            srgb: Box::new([[0; 4]; PIXELS]),
            linear: Box::new([[0.0; 4]; PIXELS]),
            depth: Box::new([0.0; PIXELS]),
            normal: Box::new([[0.0; 3]; PIXELS]),
            part: Box::new([0; PIXELS]),
            prim: Box::new([0; PIXELS]),
            instance: Box::new([0; PIXELS]),
            occurrence: Box::new([0; PIXELS]),
            kind: Box::new([0; PIXELS]),
            error: Box::new([0.0; PIXELS]),
            shading_normal: Box::new([[0.0; 3]; PIXELS]),
            uv: Box::new([[0.0; 2]; PIXELS]),
            quality: Quality::new(),
            sums: Vec::new(),
        }
    }

    /// Kinds and errors of the pixels that were rendered last.
    pub fn quality(&self) -> &Quality {
        &self.quality
    }

    #[cfg(test)]
    pub fn quality_mut(&mut self) -> &mut Quality {
        &mut self.quality
    }

    /// Returns the bytes of one row of a buffer.
    pub fn row(&self, buffer: Buffer, row: u32) -> &[u8] {
        let all: &[u8] = match buffer {
            Buffer::ColourSrgb8 => bytemuck::cast_slice(&self.srgb[..]),
            Buffer::ColourLinear => bytemuck::cast_slice(&self.linear[..]),
            Buffer::Depth => bytemuck::cast_slice(&self.depth[..]),
            Buffer::Normal => bytemuck::cast_slice(&self.normal[..]),
            Buffer::Part => bytemuck::cast_slice(&self.part[..]),
            Buffer::Primitive => bytemuck::cast_slice(&self.prim[..]),
            Buffer::Instance => bytemuck::cast_slice(&self.instance[..]),
            Buffer::Occurrence => bytemuck::cast_slice(&self.occurrence[..]),
            Buffer::Kind => &self.kind[..],
            Buffer::Error => bytemuck::cast_slice(&self.error[..]),
            Buffer::ShadingNormal => bytemuck::cast_slice(&self.shading_normal[..]),
            Buffer::Uv => bytemuck::cast_slice(&self.uv[..]),
        };
        let size = buffer.pixel_bytes();
        let at = (row * TILE) as usize * size;
        &all[at..at + self.width as usize * size]
    }

    /// Renders the pixels `only`, counted packet by packet, of the tile with upper left pixel (`x`, `y`). Missing
    /// blocks are added to the wants of `scratch`; if there are any, the tile must be rendered again. Returns `None` if
    /// `stop` returned true between two packets.
    pub fn render(
        &mut self,
        integrator: &Integrator,
        (x, y): (u32, u32),
        only: Range<usize>,
        wanted: Outputs,
        scratch: &mut Scratch,
        stop: impl Fn() -> bool,
    ) -> Option<Tally> {
        let mut sums = std::mem::take(&mut self.sums);
        sums.clear();
        sums.resize(PACKETS, [[0.0; PACKET]; 5]);
        let tally = self.render_samples(integrator, (x, y), only, wanted, (scratch, &mut sums), stop);
        self.sums = sums;
        tally
    }

    fn render_samples(
        &mut self,
        integrator: &Integrator,
        (x, y): (u32, u32),
        only: Range<usize>,
        wanted: Outputs,
        (scratch, sums): (&mut Scratch, &mut [Colours]),
        stop: impl Fn() -> bool,
    ) -> Option<Tally> {
        let picture = integrator.picture();
        let (width, height) = picture.size;
        self.width = (width - x).min(TILE);
        self.height = (height - y).min(TILE);
        let mut tally = Tally::default();
        let (width, height) = (self.width, self.height);
        let patch = |i: usize| {
            let [first, end] = [only.start, only.end].map(|at| at.clamp(i * PACKET, (i + 1) * PACKET) - i * PACKET);
            Patch::new(i as u32, (width, height), first..end)
        };
        let patches: [Patch; PACKETS] = std::array::from_fn(patch);
        self.quality.clear();
        for sample in 0..picture.samples {
            if stop() {
                return None;
            }
            let packets =
                patches.each_ref().map(|it| (integrator.pixels((x + it.left, y + it.top), (1, 1), sample), it.active));
            integrator.begin(&packets, scratch);
            for (i, (pixels, active)) in packets.iter().enumerate().filter(|(_, (_, active))| *active != 0) {
                if stop() {
                    return None;
                }
                if let Err(need) = integrator.packet(pixels, *active, Some(i), &mut sums[i], scratch) {
                    // Only a root block can be missing here, and roots are pinned. It is then wanted before all other
                    // blocks.
                    scratch.wants.add(need, f32::MAX);
                }
                if sample == 0 {
                    self.keep_first(&patches[i], wanted, &scratch.first);
                    self.keep_quality(&patches[i], &scratch.first);
                    tally.count(*active, &scratch.first);
                }
                if sample + 1 == picture.samples {
                    let at = (x + patches[i].left, y + patches[i].top);
                    self.keep_colours(&patches[i], at, wanted, picture, &mut sums[i]);
                }
            }
        }
        Some(tally)
    }

    /// Traces a packet of pixels spread over the tile with upper left pixel (`x`, `y`), to find missing blocks.
    pub fn probe(integrator: &Integrator, (x, y): (u32, u32), scratch: &mut Scratch) {
        const APART: (u32, u32) = (TILE / ACROSS, TILE / DOWN);
        let at = (x + APART.0 / 2, y + APART.1 / 2);
        let (width, height) = integrator.picture().size;
        let inside = |i: u32| at.0 + i % ACROSS * APART.0 < width && at.1 + i / ACROSS * APART.1 < height;
        let active = (0..PACKET as u32).filter(|&i| inside(i)).fold(0u32, |m, i| m | 1 << i);
        let mut sums = [[0.0; PACKET]; 5];
        if let Err(need) = integrator.packet(&integrator.pixels(at, APART, 0), active, None, &mut sums, scratch) {
            scratch.wants.add(need, f32::MAX);
        }
    }

    /// Copies the `wanted` buffers of the first surface in each pixel of a packet.
    fn keep_first(&mut self, patch: &Patch, wanted: Outputs, first: &First) {
        for buffer in Buffer::ALL.into_iter().filter(|b| wanted.has(*b)) {
            for (to, from) in patch.rows() {
                match buffer {
                    // `keep_colours` copies these.
                    Buffer::ColourSrgb8 | Buffer::ColourLinear => break,
                    Buffer::Depth => self.depth[to].copy_from_slice(&first.depth[from]),
                    Buffer::Normal => self.normal[to].copy_from_slice(&first.normal[from]),
                    Buffer::ShadingNormal => self.shading_normal[to].copy_from_slice(&first.shading_normal[from]),
                    Buffer::Uv => self.uv[to].copy_from_slice(&first.uv[from]),
                    Buffer::Part => self.part[to].copy_from_slice(&first.part[from]),
                    Buffer::Primitive => self.prim[to].copy_from_slice(&first.prim[from]),
                    Buffer::Instance => self.instance[to].copy_from_slice(&first.instance[from]),
                    Buffer::Occurrence => self.occurrence[to].copy_from_slice(&first.occurrence[from]),
                    Buffer::Kind => self.kind[to].iter_mut().zip(from).for_each(|(to, i)| *to = first.kind(i) as u8),
                    Buffer::Error => self.error[to].iter_mut().zip(from).for_each(|(to, i)| *to = first.error(i)),
                }
            }
        }
    }

    /// Copies kinds and errors of a packet's pixels.
    fn keep_quality(&mut self, patch: &Patch, first: &First) {
        let quality = &mut self.quality;
        for (to, from) in patch.rows() {
            let (row, shift) = (to.start / TILE as usize, (to.start % TILE as usize) as u32);
            let of = |pixels: u32| (pixels >> from.start & ((1 << from.len()) - 1)) << shift;
            quality.rendered[row] |= of(u32::MAX);
            quality.hits[row] |= of(first.met);
            quality.lod[row] |= of((first.lod | first.behind_cells) & !first.missing);
            quality.missing[row] |= of(first.missing);
            bits(of(first.inexact) >> shift)
                .for_each(|i| quality.error_px[to.start + i] = first.error_px[from.start + i]);
        }
    }

    /// Copies the `wanted` colours of a packet's pixels. `at`: its upper left pixel in the picture; `sums`: the
    /// colours, summed over all samples.
    fn keep_colours(&mut self, patch: &Patch, at: (u32, u32), wanted: Outputs, picture: Picture, sums: &mut Colours) {
        if picture.samples > 1 {
            let weight = 1.0 / picture.samples as f32;
            sums.as_flattened_mut().iter_mut().for_each(|c| *c *= weight);
        }
        if wanted.has(Buffer::ColourSrgb8) {
            let mut coded = [[0; 4]; PACKET];
            dispatch(
                picture.isa,
                Code { tone: picture.tone, srgb: picture.srgb, at, colours: sums, coded: &mut coded },
            );
            for (to, from) in patch.rows() {
                self.srgb[to].copy_from_slice(&coded[from]);
            }
        }
        if wanted.has(Buffer::ColourLinear) {
            for (to, from) in patch.rows() {
                self.linear[to].iter_mut().zip(from).for_each(|(to, i)| *to = std::array::from_fn(|c| sums[c][i]));
            }
        }
    }
}

/// The pixels of a packet that are rendered: a rectangle of it, or some pixels of that in a row.
struct Patch {
    /// Upper left pixel of the packet in its tile.
    left: u32,
    top: u32,
    /// The rays that go through the pixels; those of each row are neighbours.
    active: u32,
}

impl Patch {
    /// Returns the pixels of packet `i` that are in a tile of `width` × `height` pixels, and in the range `only` of
    /// the packet.
    fn new(i: u32, (width, height): (u32, u32), only: Range<usize>) -> Self {
        const ALONG: u32 = TILE / ACROSS;
        let (left, top) = (i % ALONG * ACROSS, i / ALONG * DOWN);
        let (columns, rows) = (width.saturating_sub(left).min(ACROSS), height.saturating_sub(top).min(DOWN));
        let row = (1 << columns) - 1;
        let inside = (0..rows).fold(0u32, |all, y| all | row << (y * ACROSS));
        Self { left, top, active: inside & ((1u64 << only.end) - (1 << only.start)) as u32 }
    }

    /// Iterates over the rows that have pixels: for each, the range of its pixels in the tile and in the packet.
    fn rows(&self) -> impl Iterator<Item = (Range<usize>, Range<usize>)> + use<> {
        let Self { left, top, active } = *self;
        (0..DOWN).filter_map(move |row| {
            let of_row = active >> (row * ACROSS) & ((1 << ACROSS) - 1);
            let (first, count) = (of_row.trailing_zeros(), of_row.count_ones() as usize);
            let (at, of) = (((top + row) * TILE + left + first) as usize, (row * ACROSS + first) as usize);
            (count > 0).then_some((at..at + count, of..of + count))
        })
    }
}

impl Tally {
    /// Adds the `active` pixels of a packet.
    fn count(&mut self, active: u32, first: &First) {
        let count = |pixels: u32| u64::from((pixels & active).count_ones());
        let lod = (first.lod | first.behind_cells) & !first.missing;
        self.exact += count(!(lod | first.missing));
        self.lod += count(lod);
        self.missing += count(first.missing);
        self.hits += count(first.met);
        for i in bits(first.inexact & active) {
            self.error_sum += f64::from(first.error_px[i]);
            self.error_max = self.error_max.max(first.error_px[i]);
        }
    }

    pub fn add(&mut self, o: &Tally) {
        self.exact += o.exact;
        self.lod += o.lod;
        self.missing += o.missing;
        self.hits += o.hits;
        self.error_sum += o.error_sum;
        self.error_max = self.error_max.max(o.error_max);
    }
}

/// Returns the upper left pixels of all tiles. Tiles nearest to the picture's centre come first, because viewers look
/// there first.
pub(super) fn tiles_from_the_middle(width: u32, height: u32) -> Vec<(u32, u32)> {
    let columns = (0..width).step_by(TILE as usize);
    let mut tiles: Vec<_> =
        (0..height).step_by(TILE as usize).flat_map(|y| columns.clone().map(move |x| (x, y))).collect();
    let half = i64::from(TILE / 2);
    tiles.sort_by_key(|&(x, y)| {
        let (dx, dy) = (i64::from(x) + half - i64::from(width / 2), i64::from(y) + half - i64::from(height / 2));
        (dx * dx + dy * dy, y, x)
    });
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_picture_once_and_begin_in_the_middle() {
        for (w, h) in [(1, 1), (32, 32), (33, 31), (100, 70)] {
            let tiles = tiles_from_the_middle(w, h);
            let area: u32 = tiles.iter().map(|&(x, y)| (w - x).min(TILE) * (h - y).min(TILE)).sum();
            assert_eq!(area, w * h);
            assert_eq!(tiles.len() as u32, w.div_ceil(TILE) * h.div_ceil(TILE));
        }
        let (x, y) = tiles_from_the_middle(320, 320)[0];
        assert!((128..=160).contains(&x) && (128..=160).contains(&y));
    }
}
