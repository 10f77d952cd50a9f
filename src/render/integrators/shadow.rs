//! Shadow rays, traced in packets. A transparent surface transmits the same fraction of light towards a lit surface as
//! it transmits towards the eye.

use super::direct::{Direct, LEAST_TRANSMITTANCE, LEAVE, MAX_LAYERS, Scratch};
use super::shading::Row;
use crate::math::PACKET;
use crate::math::bits;
use crate::math::{Cone, Ray};
use crate::query::stand_in;
use crate::render::wants::Wants;
use crate::scene::Group;
use crate::scene::walk::{Found, Need};

impl Direct<'_> {
    /// Writes the fraction of light that arrives along each ray in `asked` to `through`, which holds 1 for all rays.
    /// The rays must have unit directions; the call changes them. Up to its `t_min` a ray tests only triangles, as if
    /// its cone were zero.
    pub(super) fn unshadowed(
        &self,
        rays: &mut [Ray; PACKET],
        asked: u32,
        through: &mut Row<f32>,
        scratch: &mut Scratch,
    ) -> Result<(), Need> {
        let Scratch { shadow: group, wants, .. } = scratch;
        let mut dark = 0;
        let near = bits(asked).filter(|&i| rays[i].t_min > 0.0).fold(0, |m, i| m | 1 << i);
        if near != 0 {
            let mut short = [Ray::NONE; PACKET];
            for i in bits(near) {
                short[i] = Ray { t_min: 0.0, t_max: rays[i].t_min, cone: Cone::ZERO, ..rays[i] };
            }
            dark = group.trace_among::<true>(&self.view, &mut short, near)?;
            self.want(dark, group, wants);
            // Transparent surfaces on these rays are searched from 0 with zero cones, because stand-ins of the lit
            // surface itself may be near the origin.
            bits(dark).for_each(|i| (rays[i].t_min, rays[i].cone) = (0.0, Cone::ZERO));
        }
        if self.view.scene.see_through {
            return self.go_through(rays, asked, through, (group, wants));
        }
        if asked & !dark != 0 {
            let far = group.trace_among::<true>(&self.view, rays, asked & !dark)?;
            self.want(far, group, wants);
            dark |= far;
        }
        bits(dark).for_each(|i| through[i] = 0.0);
        Ok(())
    }

    /// Wants the missing blocks of the stand-ins that rays in `met` hit.
    fn want(&self, met: u32, group: &Group, wants: &mut Wants) {
        if !self.view.accept_missing {
            return;
        }
        for i in bits(met) {
            let found = group.found(i, true);
            if let Some(need) = self.view.wanted(found.tree, &found.tri) {
                wants.add(need, 1.0);
            }
        }
    }

    /// Follows rays through transparent surfaces, from the lit surface towards the light, until no light is left.
    fn go_through(
        &self,
        rays: &mut [Ray; PACKET],
        mut active: u32,
        through: &mut Row<f32>,
        (group, wants): (&mut Group, &mut Wants),
    ) -> Result<(), Need> {
        for _ in 0..MAX_LAYERS {
            if active == 0 {
                break;
            }
            active = group.trace_among::<false>(&self.view, rays, active)?;
            self.want(active, group, wants);
            for i in bits(active) {
                let found = group.found(i, true);
                through[i] *= 1.0 - self.opacity(&rays[i], &found)?;
                if through[i] < LEAST_TRANSMITTANCE {
                    through[i] = 0.0;
                    active &= !(1 << i);
                    continue;
                }
                let behind = stand_in::look(&self.view, &rays[i], &found).map_or(found.t, |look| look.leave());
                rays[i].t_min = behind + self.view.frame_of(found.tree).extent() * LEAVE;
            }
        }
        Ok(())
    }

    /// Returns the opacity of the hit surface, under the states of part and instance.
    fn opacity(&self, ray: &Ray, found: &Found) -> Result<f32, Need> {
        if let Some(look) = stand_in::look(&self.view, ray, found) {
            return Ok(self.material(found.tree, look.part()).0.opacity);
        }
        let (_, part) = self.view.triangle(found)?;
        // The colours of single triangles have no opacity.
        Ok(self.material(found.tree, part).0.opacity)
    }
}
