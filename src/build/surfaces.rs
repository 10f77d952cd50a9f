//! Surfaces that are kept until their trees are built.

use crate::base::error::{Error, Result};
use crate::geom::surface::cage::{Boundary, CageDesc, Creasing, TriangleRule};
use crate::geom::surface::dice::Quads;
use crate::geom::surface::nurbs::NurbsDesc;
use crate::import::surfaces::{CageMesh, Displacement, Heights, NurbsMesh};
use glam::DVec3;
use std::sync::Arc;

/// A surface of a mesh.
pub struct Surface {
    /// Index of the mesh.
    pub mesh: u32,
    /// Primitive id of its first face.
    pub first_face: u32,
    /// Its description.
    pub shape: Shape,
}

/// The description of a surface, owned.
pub enum Shape {
    /// A subdivision surface.
    Cage(OwnedCage),
    /// A NURBS surface.
    Nurbs(OwnedNurbs),
}

/// See [`CageMesh`].
pub struct OwnedCage {
    sizes: Vec<u32>,
    indices: Vec<u32>,
    creases: Vec<(u32, u32, f32)>,
    corners: Vec<(u32, f32)>,
    holes: Vec<u32>,
    rules: (Boundary, Creasing, TriangleRule),
    positions: Vec<DVec3>,
    parts: Vec<u32>,
    displacement: Option<(Arc<Heights>, f64, Vec<[f64; 2]>)>,
    /// Bytes of the heights, if the surface before has others.
    heights: u64,
}

/// See [`NurbsMesh`].
pub struct OwnedNurbs {
    degree: [u32; 2],
    counts: [u32; 2],
    knots: [Vec<f64>; 2],
    points: Vec<DVec3>,
    weights: Option<Vec<f64>>,
    is_reversed: bool,
    domain: Option<[[f64; 2]; 2]>,
    extent: f64,
    part: u32,
    /// The rectangles between its knots.
    faces: u32,
}

impl OwnedCage {
    /// Copies a cage. `last`: the heights of the surface before, which files often share.
    pub fn of(mesh: &CageMesh, last: &mut Option<Arc<Heights>>) -> Result<Self> {
        mesh.quads(&mesh.checked()?).map(drop)?;
        let desc = &mesh.desc;
        let mut bytes = 0;
        let displacement = mesh.displacement.map(|it| {
            let heights = match last.take() {
                Some(same) if *same == *it.heights => same,
                _ => {
                    bytes = it.heights.bytes();
                    Arc::new(it.heights.clone())
                }
            };
            *last = Some(heights.clone());
            (heights, it.scale, it.coordinates.to_vec())
        });
        Ok(Self {
            sizes: desc.face_sizes.to_vec(),
            indices: desc.indices.to_vec(),
            creases: desc.creases.to_vec(),
            corners: desc.corners.to_vec(),
            holes: desc.holes.to_vec(),
            rules: (desc.boundary, desc.creasing, desc.triangles),
            positions: mesh.positions.to_vec(),
            parts: mesh.parts.to_vec(),
            displacement,
            heights: bytes,
        })
    }

    /// The cage.
    pub fn mesh(&self) -> CageMesh<'_> {
        let (boundary, creasing, triangles) = self.rules;
        CageMesh {
            desc: CageDesc {
                face_sizes: &self.sizes,
                indices: &self.indices,
                creases: &self.creases,
                corners: &self.corners,
                holes: &self.holes,
                boundary,
                creasing,
                triangles,
            },
            positions: &self.positions,
            parts: &self.parts,
            displacement: self.displacement.as_ref().map(|(heights, scale, coordinates)| Displacement {
                heights,
                scale: *scale,
                coordinates,
            }),
        }
    }
}

impl OwnedNurbs {
    /// Copies a surface.
    pub fn of(mesh: &NurbsMesh) -> Result<Self> {
        let surface = mesh.checked()?;
        let faces = u32::try_from(mesh.quads(&surface).count());
        let faces = faces.map_err(|_| Error::bad_argument("surface: there are too many knots"))?;
        let NurbsMesh { desc, is_reversed, domain, extent, part } = *mesh;
        Ok(Self {
            degree: desc.degree,
            counts: desc.counts,
            knots: [desc.knots_u.to_vec(), desc.knots_v.to_vec()],
            points: desc.points.to_vec(),
            weights: desc.weights.map(<[f64]>::to_vec),
            is_reversed,
            domain,
            extent,
            part,
            faces,
        })
    }

    /// The surface.
    pub fn mesh(&self) -> NurbsMesh<'_> {
        let Self { degree, counts, is_reversed, domain, extent, part, .. } = *self;
        let desc = NurbsDesc {
            degree,
            counts,
            knots_u: &self.knots[0],
            knots_v: &self.knots[1],
            points: &self.points,
            weights: self.weights.as_deref(),
        };
        NurbsMesh { desc, is_reversed, domain, extent, part }
    }
}

impl Shape {
    /// Number of primitive ids.
    pub fn faces(&self) -> u32 {
        match self {
            Self::Cage(cage) => cage.sizes.len() as u32,
            Self::Nurbs(nurbs) => nurbs.faces,
        }
    }

    /// Control points.
    pub fn points(&self) -> &[DVec3] {
        match self {
            Self::Cage(cage) => &cage.positions,
            Self::Nurbs(nurbs) => &nurbs.points,
        }
    }

    /// Parts of its faces.
    pub fn parts(&self) -> &[u32] {
        match self {
            Self::Cage(cage) => &cage.parts,
            Self::Nurbs(nurbs) => std::slice::from_ref(&nurbs.part),
        }
    }

    /// Bytes of memory, without heights that the surface before has too.
    pub fn bytes(&self) -> u64 {
        let heights = if let Self::Cage(cage) = self { cage.heights } else { 0 };
        let bytes = match self {
            Self::Cage(cage) => {
                let coordinates = cage.displacement.as_ref().map_or(0, |(_, _, coordinates)| 16 * coordinates.len());
                4 * (cage.sizes.len() + cage.indices.len() + cage.holes.len() + cage.parts.len())
                    + 12 * cage.creases.len()
                    + 8 * cage.corners.len()
                    + coordinates
            }
            Self::Nurbs(nurbs) => 8 * (nurbs.knots[0].len() + nurbs.knots[1].len() + nurbs.points.len()),
        };
        heights + (bytes + size_of_val(self.points()) + size_of::<Surface>()) as u64
    }
}
