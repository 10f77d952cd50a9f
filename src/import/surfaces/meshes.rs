//! Smooth surfaces of an input.

use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use crate::geom::surface::cage::{Cage, CageDesc, CageQuads, Displacement};
pub use crate::geom::surface::dice::{Dicing, MOST_LEVEL};
use crate::geom::surface::dice::{Micro, dice};
use crate::geom::surface::nurbs::{MAX_COORDINATE, Nurbs, NurbsDesc, NurbsQuads};
use crate::math::DBounds;
use glam::DVec3;
use std::path::PathBuf;

/// A subdivision surface: its cage, and the parts of its faces.
#[derive(Clone, Copy)]
pub struct CageMesh<'a> {
    /// Faces and rules.
    pub desc: CageDesc<'a>,
    /// The vertices of the cage.
    pub positions: &'a [DVec3],
    /// The part of each face, or one for all.
    pub parts: &'a [u32],
    /// Heights by which the surface is moved along its normal. Edges and corners move by the mean of their faces.
    pub displacement: Option<Displacement<'a>>,
}

/// A picture of heights ([`crate::import::heights`]).
#[derive(Debug, Clone, PartialEq)]
pub struct HeightMap {
    /// The picture: PNG with 8 or 16 bits, or EXR.
    pub path: PathBuf,
    /// Height of a value of 1, in units of the surface.
    pub scale: f64,
}

/// Tolerance of surfaces for which none is asked, as a fraction of the greatest extent of its control points.
pub const TOLERANCE: f64 = 1.0 / 2048.0;

impl CageMesh<'_> {
    /// Dices the limit surface. A level is that of the sides of faces, at least 1. `emit` receives the triangles of a
    /// part; those of a face follow each other, and faces are in ascending order. `dicing`: `None` for [`TOLERANCE`].
    ///
    /// Fails with `BadArgument`, which names the face, edge or vertex that is wrong, and with the errors of `emit`.
    pub fn dice(
        &self,
        dicing: Option<Dicing>,
        cancel: &Cancel,
        emit: &mut dyn FnMut(u32, &Micro) -> Result<()>,
    ) -> Result<()> {
        let cage = self.checked()?;
        let quads = self.quads(&cage)?;
        dice(&quads, self.dicing(dicing), cancel, &mut |quad, micro| emit(self.part(quads.face(quad)), micro))
    }

    /// The cage. Fails with `BadArgument`, which names the face, edge or vertex that is wrong.
    pub fn checked(&self) -> Result<Cage> {
        let faces = self.desc.face_sizes.len();
        if self.parts.len() != faces && self.parts.len() != 1 {
            return Err(Error::BadArgument(format!("cage: {faces} faces, but {} parts", self.parts.len())));
        }
        let is_wrong = |it: &DVec3| it.is_nan() || it.abs().max_element() > MAX_COORDINATE;
        if let Some(i) = self.positions.iter().position(is_wrong) {
            let why = format!("cage: vertex {i} (from 0) is not finite, or exceeds {MAX_COORDINATE:e}");
            return Err(Error::BadArgument(why));
        }
        Cage::new(&self.desc, self.positions.len())
    }

    /// The quads of the limit surface of its cage, as [`Self::checked`] gives it. Fails as [`CageQuads::new`].
    pub fn quads<'c>(&'c self, cage: &'c Cage) -> Result<CageQuads<'c>> {
        CageQuads::new(cage, self.positions, self.displacement)
    }

    /// How finely [`Self::quads`] are diced if `dicing` is asked for the faces. They have half the sides of the faces.
    pub fn dicing(&self, dicing: Option<Dicing>) -> Dicing {
        match or_default(dicing, extent(self.positions)) {
            Dicing::Level(level) => Dicing::Level(level.saturating_sub(1)),
            tolerance => tolerance,
        }
    }

    /// The part of a face.
    pub fn part(&self, face: u32) -> u32 {
        self.parts[if self.parts.len() == 1 { 0 } else { face as usize }]
    }
}

/// A NURBS surface of one part.
#[derive(Clone, Copy)]
pub struct NurbsMesh<'a> {
    /// Knots, control points and weights.
    pub desc: NurbsDesc<'a>,
    /// The normal is against du × dv, and the triangles are clockwise along it.
    pub is_reversed: bool,
    /// The rectangle of parameters that it covers, in u and in v; `None` for all.
    pub domain: Option<[[f64; 2]; 2]>,
    /// The extent of which the tolerance is a fraction if none is asked; 0: that of its control points.
    pub extent: f64,
    /// A part, or a local part of a shared mesh.
    pub part: u32,
}

impl NurbsMesh<'_> {
    /// Dices the surface as [`CageMesh::dice`] does. It is closed where its first and last control points are the same.
    ///
    /// Fails with `BadArgument`, which names the argument that is wrong, and with the errors of `emit`.
    pub fn dice(
        &self,
        dicing: Option<Dicing>,
        cancel: &Cancel,
        emit: &mut dyn FnMut(u32, &Micro) -> Result<()>,
    ) -> Result<()> {
        let (surface, mut turned) = (self.checked()?, Micro::default());
        dice(&self.quads(&surface), self.dicing(dicing), cancel, &mut |_, micro| {
            if !self.is_reversed {
                return emit(self.part, micro);
            }
            turned.positions.clear();
            turned.positions.extend(micro.positions.iter().map(|[a, b, c]| [*a, *c, *b]));
            turned.normals.clear();
            turned.normals.extend(micro.normals.iter().map(|[a, b, c]| [-a, -c, -b]));
            emit(self.part, &turned)
        })
    }

    /// The surface. Fails with `BadArgument`, which names the argument that is wrong.
    pub fn checked(&self) -> Result<Nurbs> {
        Nurbs::new(&self.desc)
    }

    /// The quads of its surface, as [`Self::checked`] gives it. Their normals are along du × dv, also if it is
    /// reversed.
    pub fn quads<'s>(&self, surface: &'s Nurbs) -> NurbsQuads<'s> {
        NurbsQuads::new(surface, self.domain)
    }

    /// How finely [`Self::quads`] are diced if `dicing` is asked.
    pub fn dicing(&self, dicing: Option<Dicing>) -> Dicing {
        or_default(dicing, if self.extent > 0.0 { self.extent } else { extent(self.desc.points) })
    }
}

/// `dicing`, or the default for a surface of this extent.
fn or_default(dicing: Option<Dicing>, extent: f64) -> Dicing {
    dicing.unwrap_or(Dicing::Tolerance((extent * TOLERANCE).max(f64::MIN_POSITIVE)))
}

/// The greatest extent of points; 0 if there are none.
pub(super) fn extent<'a>(points: impl IntoIterator<Item = &'a DVec3>) -> f64 {
    let bounds = points.into_iter().copied().fold(DBounds::EMPTY, DBounds::with);
    if bounds.is_empty() { 0.0 } else { bounds.extent().max_element() }
}
