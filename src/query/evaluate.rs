//! Evaluates surfaces at hits: what deferred shading needs beside the hit itself.

use super::answers::clamped_weights;
use super::batch::Policy;
use super::hit::{Hit, HitKind};
use super::located::{Located, locate};
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::base::inside_read::refuse_inside_read;
use crate::base::memory::room;
use crate::base::progress::Cancel;
use crate::scene::SceneState;
use crate::structure::TriHit;
use glam::DVec3;

/// Where the values of a [`SurfaceAt`] come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Evaluated {
    /// The hit is a miss: all values are 0, and the position is infinite.
    #[default]
    Nothing = 0,
    /// The surface, evaluated at the parameters of the hit.
    Surface = 1,
    /// A triangle, and the normals at its corners.
    Triangle = 2,
    /// A stand-in: the position and the normal are those of the hit, derivatives and curvatures are 0.
    StandIn = 3,
    /// The data is not in memory, and was not read. Values as for a stand-in.
    Missing = 4,
}

/// A point of the surface under a hit, in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct SurfaceAt {
    /// The point; of a surface off [`Hit::position`] by up to the tolerance of dicing.
    pub position: DVec3,
    /// First derivative by the first parameter of [`Hit::uv`].
    pub du: DVec3,
    /// First derivative by the second parameter.
    pub dv: DVec3,
    /// Unit normal with which the surface is shaded. It does not depend on the ray: it is on the side from which the
    /// triangle's corners appear counter-clockwise in the model, and stays on that side under a transform that mirrors.
    /// 0 if there is none.
    pub normal: DVec3,
    /// Principal curvatures in units of 1 / length, the larger one first; positive where the surface bends towards
    /// the normal. On a triangle those of a surface with the interpolated normals; 0 if they are the triangle's own.
    pub curvatures: [f64; 2],
    /// Where the values come from.
    pub kind: Evaluated,
    /// A face of structure `patch` with other than four corners consists of a quad at each: the corner of the hit's, as
    /// the face's vertices are ordered. Otherwise 0.
    pub corner: u32,
}

impl SurfaceAt {
    /// The value for a miss.
    pub const NOTHING: Self = Self {
        position: DVec3::INFINITY,
        du: DVec3::ZERO,
        dv: DVec3::ZERO,
        normal: DVec3::ZERO,
        curvatures: [0.0; 2],
        kind: Evaluated::Nothing,
        corner: 0,
    };

    /// The value for a hit without a triangle. The normal is the shading normal, or the geometric one if the hit has no
    /// other.
    fn of_hit(hit: &Hit, kind: Evaluated) -> Self {
        let shading = hit.shading_normal.as_dvec3();
        let normal = if shading == DVec3::ZERO { hit.normal.as_dvec3() } else { shading };
        Self { position: hit.position, normal, kind, ..Self::NOTHING }
    }

    /// The value at a triangle; fails with a block that it needs.
    fn of(at: &Located) -> std::result::Result<Self, BlockId> {
        let [u, v] = clamped_weights(&at.triangle.vertices, at.at).map(|weight| weight as f32);
        let hit = TriHit { u, v, ..*at.hit };
        let local = at.tree.shading_point(&hit)?.ok_or(at.tree.block_of(&hit))?;
        let point = local.mapped(&at.placed.frame(), at.placed.world_normal(local.normal));
        Ok(Self {
            // The sum of the tree's origin comes last, as far from zero a product would lose digits.
            position: at.placed.world_point(local.position),
            du: point.du,
            dv: point.dv,
            normal: point.normal,
            curvatures: point.curvatures(),
            kind: if point.is_surface { Evaluated::Surface } else { Evaluated::Triangle },
            corner: at.tree.parameters(&hit).map_or(0, |it| it.corner),
        })
    }
}

impl SceneState {
    /// Evaluates the surface at each hit: position, derivatives by the parameters of the hit, shading normal and
    /// principal curvatures, in world space. The order is that of `hits`.
    ///
    /// A hit of kind [`HitKind::Exact`] needs its position, and the ids of instance, part and primitive
    /// ([`Want::ALL`](super::Want::ALL) has them); it is found by these, first in the placed tree of its occurrence.
    /// Hits on stand-ins and misses are no failure: see [`Evaluated`].
    ///
    /// With [`Policy::Exact`] the call reads what is not in memory; with [`Policy::Now`] it neither waits nor reads.
    /// Blocks; thread-safe. Fails with `BadArgument`, which names the hit, if an exact hit is not on a triangle of this
    /// scene or lacks one of these members; with `NoMemory`, `Io`, `Corrupt`, `Cancelled`.
    pub fn evaluate(&self, hits: &[Hit], policy: Policy, cancel: &Cancel) -> Result<Vec<SurfaceAt>> {
        refuse_inside_read()?;
        let mut out = room(hits.len(), "points of surfaces")?;
        out.extend(hits.iter().map(|hit| match hit.kind {
            HitKind::Miss => SurfaceAt::NOTHING,
            HitKind::Lod => SurfaceAt::of_hit(hit, Evaluated::StandIn),
            HitKind::Missing | HitKind::Exact => SurfaceAt::of_hit(hit, Evaluated::Missing),
        }));
        let numbered = (0..).zip(hits).filter(|(_, hit)| hit.kind == HitKind::Exact);
        let sought: Vec<u32> = numbered.map(|(number, _)| number).collect();
        let found = locate(self, (hits, &sought), policy, cancel, &SurfaceAt::of)?;
        for (number, found) in sought.into_iter().zip(found) {
            out[number as usize] = found.unwrap_or(out[number as usize]);
        }
        Ok(out)
    }
}
