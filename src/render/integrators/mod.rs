//! How a pixel gets its colour.

pub mod direct;
pub mod first;
pub mod material;
pub mod plain;
mod sampling;
mod shading;
mod shadow;
mod surface;

use crate::math::srgb::Srgb;
use crate::math::{BUNDLE, PACKET};
use crate::scene::walk::Need;
use crate::simd::Isa;
use direct::{Direct, Pixels, Scratch};

/// An algorithm that gives the pixels of a picture their light. Asked once a packet or a tile, never once a ray.
pub(crate) enum Integrator<'a> {
    /// Lights that surfaces see, and nothing else.
    Direct(Direct<'a>),
}

/// The facts of a picture that a tile needs.
#[derive(Clone, Copy)]
pub(crate) struct Picture<'a> {
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Rays of each pixel.
    pub samples: u32,
    pub srgb: &'a Srgb,
    /// Vectors to work out packets with.
    pub isa: Isa,
}

impl Integrator<'_> {
    pub fn picture(&self) -> Picture<'_> {
        let Self::Direct(direct) = self;
        Picture { size: direct.size, samples: direct.samples, srgb: direct.srgb, isa: direct.isa() }
    }

    /// See [`Direct::pixels`].
    pub fn pixels(&self, at: (u32, u32), apart: (u32, u32), sample: u32) -> Pixels {
        let Self::Direct(direct) = self;
        direct.pixels(at, apart, sample)
    }

    /// Begins a tile's packets: of each its pixels, and those of them that count.
    pub fn begin(&self, packets: &[(Pixels, u32); BUNDLE], scratch: &mut Scratch) {
        let Self::Direct(direct) = self;
        direct.begin(packets, scratch);
    }

    /// Renders a sample of the pixels of `active`, see [`Direct::packet`].
    pub fn packet(
        &self,
        pixels: &Pixels,
        active: u32,
        number: Option<usize>,
        sums: &mut [[f32; PACKET]; 4],
        scratch: &mut Scratch,
    ) -> Result<(), Need> {
        let Self::Direct(direct) = self;
        direct.packet(pixels, active, number, sums, scratch)
    }
}
