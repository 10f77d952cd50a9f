//! Smooth surfaces of an input.

pub use crate::geom::surface::dice::{Dicing, MOST_LEVEL};
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use crate::geom::surface::cage::{Cage, CageDesc, CageQuads};
use crate::geom::surface::dice::{Micro, dice};
use glam::DVec3;

/// A subdivision surface: its cage, and the parts of its faces.
#[derive(Clone, Copy)]
pub struct CageMesh<'a> {
    /// Faces and rules.
    pub desc: CageDesc<'a>,
    /// The vertices of the cage.
    pub positions: &'a [DVec3],
    /// The part of each face, or one for all.
    pub parts: &'a [u32],
}

/// Tolerance of surfaces for which none is asked, as a fraction of the cage's greatest extent.
pub const TOLERANCE: f64 = 1.0 / 2048.0;

impl CageMesh<'_> {
    /// Dices the limit surface. `emit` receives the triangles of a part; those of a face follow each other, and faces
    /// are in ascending order. `dicing`: `None` for [`TOLERANCE`].
    ///
    /// Fails with `BadArgument`, which names the face, edge or vertex that is wrong, and with the errors of `emit`.
    pub fn dice(
        &self,
        dicing: Option<Dicing>,
        cancel: &Cancel,
        emit: &mut dyn FnMut(u32, &Micro) -> Result<()>,
    ) -> Result<()> {
        let faces = self.desc.face_sizes.len();
        if self.parts.len() != faces && self.parts.len() != 1 {
            return Err(Error::BadArgument(format!("cage: {faces} faces, but {} parts", self.parts.len())));
        }
        if let Some(i) = self.positions.iter().position(|it| !it.is_finite()) {
            return Err(Error::BadArgument(format!("cage: vertex {i} is not finite")));
        }
        let cage = Cage::new(&self.desc, self.positions.len())?;
        let part = |face: u32| self.parts[if self.parts.len() == 1 { 0 } else { face as usize }];
        let dicing = dicing.unwrap_or_else(|| Dicing::Tolerance(self.extent().max(f64::MIN_POSITIVE) * TOLERANCE));
        let quads = CageQuads::new(&cage, self.positions)?;
        dice(&quads, dicing, &mut |quad, micro| {
            cancel.check()?;
            emit(part(quads.face(quad)), micro)
        })
    }

    /// The greatest extent of the cage.
    fn extent(&self) -> f64 {
        let all = self.positions.iter();
        let (low, high) = all.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
        (high - low).max_element()
    }
}
