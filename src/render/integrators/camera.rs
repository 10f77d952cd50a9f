//! The first trace of a picture's rays: the packets of a tile that enter one placed tree each go through it as a
//! bundle.

use super::direct::{Direct, Pixels, Scratch};
use super::rays::CameraPacket;
use crate::math::{BUNDLE, PACKET, bits};
use crate::scene::beam::Beam;
use crate::scene::entered::{Entered, EnteredTree};
use crate::scene::group::CameraTree;
use crate::scene::walk::{Need, Step};
use crate::structure::Bundle;
use glam::Vec3;

/// The packets of a tile that were begun together.
#[derive(Default)]
pub(super) struct Begun {
    // In memory of its own, so that a new one takes little of the stack.
    bundle: Box<Bundle>,
    /// Mask of the packets that were begun, and the placed tree of each.
    begun: u32,
    placed: [u64; BUNDLE],
    entered: Entered,
}

/// Rays of a packet that hit something.
#[derive(Debug, Clone, Copy)]
pub(super) struct Met {
    pub rays: u32,
    /// Rays that entered a stand-in before the hit or the miss, and perhaps rays that were not traced.
    pub behind_cells: u32,
    /// The placed tree that all hits are in: they are in the scratch's `group`. `None`: they are in its `found`.
    pub only: Option<u64>,
}

impl Met {
    const NOTHING: Self = Self { rays: 0, behind_cells: 0, only: None };
}

/// The placed trees that the rays of a packet may enter.
// One exists for each packet, and stays on the stack.
#[allow(clippy::large_enum_variant)]
enum Enters<'a> {
    None,
    /// A single tree, in which the rays have the same distances as in the world.
    One(CameraTree<'a>),
    Others,
}

impl<'v> Direct<'v> {
    /// Determines the placed trees that a packet's rays may enter.
    fn enter(&self, rays: &CameraPacket, entered: &mut Entered) -> Enters<'v> {
        let (origins, dirs) = rays.extremes(self.isa());
        let beam = Beam::from_points(origins, dirs, 0.0, u32::MAX);
        let is_few = self.view.entered(&beam, rays.widest(), f64::INFINITY, entered);
        match entered.trees[..] {
            [] if is_few => Enters::None,
            // Rays with an origin farther away must be moved nearer.
            [EnteredTree { placed, .. }] if is_few && self.is_near(placed, rays) => {
                Enters::One(CameraTree::of(&self.view, placed))
            }
            _ => Enters::Others,
        }
    }

    /// True if rays with a common origin begin near a placed tree. Others are tested when they enter it.
    fn is_near(&self, placed: u64, rays: &CameraPacket) -> bool {
        rays.eye().is_none_or(|eye| !self.view.scene.placed(placed).is_far(eye))
    }

    /// Begins the packets of a tile, and traces them as far as they stay in one bundle. `packets`: for each packet its
    /// pixels and the mask of the active ones.
    pub(crate) fn begin(&self, packets: &[(Pixels, u32); BUNDLE], scratch: &mut Scratch) {
        let Scratch { rays, begun: Begun { bundle, begun, placed, entered }, .. } = scratch;
        *begun = 0;
        // Packets of a bundle share an origin, and directions in single precision do for them.
        if self.is_fine || !self.rays.is_perspective() {
            return;
        }
        for (i, (pixels, active)) in packets.iter().enumerate() {
            if *active == 0 || self.is_empty(pixels) {
                continue;
            }
            self.make_rays(pixels, rays);
            let Enters::One(camera) = self.enter(rays, entered) else { continue };
            if self.poe == 0.0 && camera.tree.has_form() {
                // Packets of exact rays go through that form faster than bundles go through blocks.
                return;
            }
            placed[i] = camera.number;
            *begun |= u32::from(camera.start(&rays.of_camera(), *active, bundle.packet(i))) << i;
        }
        // The packets of a bundle are in the same tree.
        let mut left = *begun;
        while left != 0 {
            let number = placed[left.trailing_zeros() as usize];
            let of_one = (0..BUNDLE).filter(|&i| placed[i] == number).fold(0, |all, i| all | 1 << i) & left;
            let camera = CameraTree::of(&self.view, number);
            camera.tree.closest_in_bundle(camera.filter.as_ref(), bundle, of_one);
            left &= !of_one;
        }
    }

    /// Traces the rays of a packet's pixels. Continues the walk that was [begun](Self::begin) under its number, if any.
    pub(super) fn trace_first(
        &self,
        pixels: &Pixels,
        active: u32,
        number: Option<usize>,
        scratch: &mut Scratch,
    ) -> Result<Met, Need> {
        let Scratch { group, rays, begun: Begun { bundle, begun, placed, entered }, .. } = &mut *scratch;
        if let Some(i) = number.filter(|i| *begun >> i & 1 == 1) {
            let camera = CameraTree::of(&self.view, placed[i]);
            // A frame that is only translated keeps directions and widths.
            if camera.is_turned() {
                self.make_rays(pixels, rays);
            } else {
                rays.take(self.rays.eye(), bundle.packet(i));
            }
            let met = camera.go_on(&self.view, bundle.packet(i))?;
            group.take(placed[i], bundle.packet(i));
            return Ok(Met { rays: met, behind_cells: group.behind_cells(), only: Some(placed[i]) });
        }
        self.make_rays(pixels, rays);
        if !self.is_fine {
            match self.enter(rays, entered) {
                Enters::None => return Ok(Met::NOTHING),
                Enters::One(camera) => {
                    if let Some(met) = group.trace_camera(&self.view, &camera, &rays.of_camera(), active) {
                        let only = Some(camera.number);
                        return Ok(Met { rays: met?, behind_cells: group.behind_cells(), only });
                    }
                }
                Enters::Others => {}
            }
        }
        scratch.rest = self.is_fine.then(|| {
            let mut rest = Box::new([Vec3::ZERO; PACKET]);
            bits(active).for_each(|i| {
                let (x, y) = pixels.point(i);
                rest[i] = self.rays.rest(x, y);
            });
            rest
        });
        self.trace(active, scratch)
    }

    /// Traces rays of the packet that were not traced before, or that go on behind surfaces.
    pub(super) fn trace(&self, active: u32, scratch: &mut Scratch) -> Result<Met, Need> {
        let Scratch { packet, group, found, rays, rest, .. } = scratch;
        let mut rays = rays.of(active);
        if rest.is_none() {
            let met = group.trace_among::<false>(&self.view, &mut rays, active)?;
            let only = group.only();
            if only.is_none() {
                bits(met).for_each(|i| found[i] = group.found(i, true));
            }
            return Ok(Met { rays: met, behind_cells: group.behind_cells(), only });
        }
        packet.begin_fine(&self.view, &rays, rest.as_deref(), active);
        if let Step::Pending(need) = self.view.trace_packet::<false>(&rays, packet) {
            return Err(need);
        }
        let mut met = Met::NOTHING;
        for i in bits(active) {
            found[i] = *packet.best(i);
            met.rays |= u32::from(found[i].is_hit()) << i;
            met.behind_cells |= u32::from(found[i].is_behind_cell()) << i;
        }
        Ok(met)
    }

    /// The rays in `active`, with origins close to their hits and with all digits of their directions. The distances in
    /// `found` then count from there. `None` if directions in single precision do.
    pub(super) fn near(&self, active: u32, scratch: &mut Scratch) -> Option<Box<Near>> {
        let Scratch { rays, found, rest, .. } = scratch;
        let rest = rest.as_ref()?;
        let mut near = Box::new(Near { rays: CameraPacket::clone(rays), ahead: [0.0; PACKET] });
        near.rays.spread();
        for i in bits(active) {
            let placed = self.view.frame_of(found[i].tree);
            let ahead = (found[i].t - placed.extent()).max(0.0);
            near.rays.advance(i, rays.dir(i).as_dvec3() + rest[i].as_dvec3(), ahead);
            found[i].t -= ahead;
            near.ahead[i] = ahead;
        }
        Some(near)
    }
}

/// Rays that begin shortly before their hits.
pub(super) struct Near {
    pub rays: CameraPacket,
    /// Distance from the origin of each ray to that of its camera ray.
    pub ahead: [f64; PACKET],
}
