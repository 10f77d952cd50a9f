//! Shadow rays, traced in packets. A transparent surface transmits the same fraction of light towards a lit surface as
//! it transmits towards the eye.

use super::direct::{Direct, LEAST_TRANSMITTANCE, LEAVE, MAX_LAYERS, Scratch};
use crate::math::PACKET;
use crate::math::bits;
use crate::math::{Cone, Ray};
use crate::query::stand_in;
use crate::render::wants::Wants;
use crate::scene::packet::ScenePacket;
use crate::scene::walk::{Found, Need, Step};

impl Direct<'_> {
    /// Returns the fraction of light that arrives along each ray in `asked`; 1 for other rays. The rays must have unit
    /// directions; the call changes them. Up to its `t_min` a ray tests only triangles, as if its cone were zero.
    pub(super) fn unshadowed(
        &self,
        rays: &mut [Ray; PACKET],
        asked: u32,
        scratch: &mut Scratch,
    ) -> Result<[f32; PACKET], Need> {
        let Scratch { shadow: packet, wants, .. } = scratch;
        let mut through = [1.0; PACKET];
        if asked == 0 {
            return Ok(through);
        }
        let mut dark = 0;
        let near = bits(asked).filter(|&i| rays[i].t_min > 0.0).fold(0, |m, i| m | 1 << i);
        if near != 0 {
            let mut short = [Ray::NONE; PACKET];
            for i in bits(near) {
                short[i] = Ray { t_min: 0.0, t_max: rays[i].t_min, cone: Cone::ZERO, ..rays[i] };
            }
            dark = self.met::<true>(&short, near, packet)?;
            self.want(dark, packet, wants);
            // Transparent surfaces on these rays are searched from 0 with zero cones, because stand-ins of the lit
            // surface itself may be near the origin.
            bits(dark).for_each(|i| (rays[i].t_min, rays[i].cone) = (0.0, Cone::ZERO));
        }
        if asked & !dark != 0 {
            let far = self.met::<true>(rays, asked & !dark, packet)?;
            self.want(far, packet, wants);
            dark |= far;
        }
        if self.view.scene.see_through {
            self.go_through(rays, dark, &mut through, packet)?;
        } else {
            bits(dark).for_each(|i| through[i] = 0.0);
        }
        Ok(through)
    }

    /// Wants the missing blocks of the stand-ins that rays in `met` hit.
    fn want(&self, met: u32, packet: &ScenePacket, wants: &mut Wants) {
        for i in bits(met) {
            if let Some(need) = self.view.wanted(packet.best(i)) {
                wants.add(need, 1.0);
            }
        }
    }

    /// Follows rays through transparent surfaces, from the lit surface towards the light, until no light is left.
    fn go_through(
        &self,
        rays: &mut [Ray; PACKET],
        mut active: u32,
        through: &mut [f32; PACKET],
        packet: &mut ScenePacket,
    ) -> Result<(), Need> {
        for _ in 0..MAX_LAYERS {
            if active == 0 {
                break;
            }
            active = self.met::<false>(rays, active, packet)?;
            for i in bits(active) {
                let found = packet.best(i);
                through[i] *= 1.0 - self.opacity(&rays[i], found)?;
                let behind = stand_in::look(&self.view, &rays[i], found).map_or(found.t, |look| look.leave());
                rays[i].t_min = behind + self.view.scene.placement.placed[found.placed as usize].extent() * LEAVE;
                if through[i] < LEAST_TRANSMITTANCE {
                    through[i] = 0.0;
                    active &= !(1 << i);
                }
            }
        }
        Ok(())
    }

    /// Returns the mask of the rays that hit something.
    fn met<const ANY: bool>(&self, rays: &[Ray; PACKET], asked: u32, packet: &mut ScenePacket) -> Result<u32, Need> {
        packet.begin(&self.view, rays, asked);
        match self.view.trace_packet::<ANY>(rays, packet) {
            Step::Pending(need) => Err(need),
            Step::Done => Ok(bits(asked).filter(|&i| packet.best(i).is_hit()).fold(0, |m, i| m | 1 << i)),
        }
    }

    /// Returns the opacity of the hit surface, under the states of part and instance.
    fn opacity(&self, ray: &Ray, found: &Found) -> Result<f32, Need> {
        if let Some(look) = stand_in::look(&self.view, ray, found) {
            return self.material(found.placed, look.part(), || Ok(None)).map(|material| material.opacity);
        }
        let (_, part) = self.view.triangle(found)?;
        // The colours of single triangles have no opacity.
        self.material(found.placed, part, || Ok(None)).map(|material| material.opacity)
    }
}
