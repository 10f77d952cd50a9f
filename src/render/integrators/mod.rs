//! Integrators: algorithms that compute the colours of pixels.

mod camera;
pub mod direct;
pub mod first;
pub mod material;
mod rays;
mod sampling;
mod shading;
mod shadow;
mod surfaces;

use crate::math::srgb::Srgb;
use crate::math::{BUNDLE, PACKET};
use crate::render::tone::Tone;
use crate::scene::walk::{Need, SceneView};
use crate::simd::Isa;
use direct::{Direct, Pixels, Scratch};

/// Colours of a packet's pixels: linear red, green, blue and alpha, and the share of the light that comes from surfaces
/// and not from the background.
pub(crate) type Colours = [[f32; PACKET]; 5];

/// An algorithm that computes the light of a picture's pixels. It is selected once per packet or tile, never per ray.
pub(crate) enum Integrator<'a> {
    /// Light that comes from lights directly to the visible surfaces.
    Direct(Direct<'a>),
}

/// Properties of a picture that a tile needs.
#[derive(Clone, Copy)]
pub(crate) struct Picture<'a> {
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Rays per pixel.
    pub samples: u32,
    pub srgb: &'a Srgb,
    /// Conversion of the colours to bytes.
    pub tone: Tone,
    /// Instruction set for packets.
    pub isa: Isa,
}

impl Integrator<'_> {
    pub fn picture(&self) -> Picture<'_> {
        let Self::Direct(direct) = self;
        Picture { size: direct.size, samples: direct.samples, srgb: direct.srgb, tone: direct.tone, isa: direct.isa() }
    }

    /// See [`Direct::pixels`].
    pub fn pixels(&self, at: (u32, u32), apart: (u32, u32), sample: u32) -> Pixels {
        let Self::Direct(direct) = self;
        direct.pixels(at, apart, sample)
    }

    /// Begins the packets of a tile. `packets`: for each packet its pixels and the mask of the active ones.
    pub fn begin(&self, packets: &[(Pixels, u32); BUNDLE], scratch: &mut Scratch) {
        let Self::Direct(direct) = self;
        direct.begin(packets, scratch);
    }

    /// Renders a sample of the pixels in `active`: see [`Direct::packet`]. If it fails for lack of a block with ids,
    /// colours or normals, that block is wanted, and the packet is rendered without it: ties are decided by places.
    pub fn packet(
        &self,
        pixels: &Pixels,
        active: u32,
        number: Option<usize>,
        sums: &mut Colours,
        scratch: &mut Scratch,
    ) -> Result<(), Need> {
        let Self::Direct(direct) = self;
        let Err(need) = direct.packet(pixels, active, number, sums, scratch) else { return Ok(()) };
        // Where geometry is missing too, that is wanted first.
        scratch.wants.add(need, if direct.view.accept_missing { 1.0 } else { f32::MAX });
        let without =
            Direct { view: SceneView { accept_missing: true, ties_by_place: true, ..direct.view }, ..*direct };
        without.packet(pixels, active, None, sums, scratch)
    }
}
