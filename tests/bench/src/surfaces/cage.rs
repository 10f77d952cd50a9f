//! The cage of a file, for all sides.

use crate::failure::{Failure, Outcome};
use crate::peers::embree_calls::surfaces as embree;
use glam::{DAffine3, DVec3};
use outcrop::base::error::{Error, Result};
use outcrop::base::progress::Cancel;
use outcrop::geom::surface::cage::{Boundary, CageDesc};
use outcrop::geom::surface::dice::{Dicer, Quads, Tile};
use outcrop::import::surfaces::{CageMesh, Dicing};
use outcrop::import::{
    Attributes, MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, ReadOptions, Sink, UpAxis, read_file,
};
use std::path::Path;

/// Vertices along a side of a grid of Embree's at the most, less one: what is finer is several grids.
const MOST_LEVEL: u32 = 8;

/// A cage of one part, without displacement.
#[derive(Debug, Clone, Default)]
pub struct Cage {
    positions: Vec<DVec3>,
    sizes: Vec<u32>,
    indices: Vec<u32>,
    creases: Vec<(u32, u32, f32)>,
    corners: Vec<(u32, f32)>,
    boundary: Boundary,
    cancel: Cancel,
}

impl Cage {
    /// The cage of a file. Fails if there are several, or one with holes, which Embree takes otherwise.
    pub fn read(path: &Path) -> std::result::Result<Self, Failure> {
        let mut cage = Self::default();
        read_file(path, &ReadOptions { subdivide: true, ..ReadOptions::default() }, &mut cage)?;
        if cage.sizes.is_empty() || cage.boundary == Boundary::None {
            return Err(Failure::new(format!("{}: no cage", path.display())));
        }
        Ok(cage)
    }

    fn mesh(&self) -> CageMesh<'_> {
        let Self { sizes, indices, creases, corners, boundary, .. } = self;
        let desc =
            CageDesc { face_sizes: sizes, indices, creases, corners, boundary: *boundary, ..CageDesc::default() };
        CageMesh { desc, positions: &self.positions, parts: &[0], displacement: None }
    }

    /// Sends it to a sink.
    pub fn fill(&self, sink: &mut dyn Sink) -> Outcome {
        let part = sink.part(PartDesc { id: Some(1), ..PartDesc::default() })?;
        Ok(sink.cage(MeshKey::DIRECT, &CageMesh { parts: &[part], ..self.mesh() })?)
    }

    /// The dice at a level, as `outcrop build --level` has it, as grids.
    pub fn grids(&self, level: u32) -> std::result::Result<embree::Grids, Failure> {
        let (mesh, mut grids, mut samples) = (self.mesh(), embree::Grids::default(), Tile::default());
        let checked = mesh.checked()?;
        let quads = mesh.quads(&checked)?;
        let dicer = Dicer::new(&quads, mesh.dicing(Some(Dicing::Level(level))), &self.cancel)?;
        for quad in 0..quads.count() {
            let level = dicer.level(quad);
            let of_tile = level.min(MOST_LEVEL);
            let side = (1u32 << of_tile) + 1;
            for tile in 0..1u32 << (2 * (level - of_tile)) {
                let (i, j) = (tile & ((1 << (level - of_tile)) - 1), tile >> (level - of_tile));
                dicer.tile(quad, level, of_tile, i, j, &mut samples);
                let (first, side_of) = (grids.vertices.len() as u32, side as u16);
                grids.grids.push(embree::Grid { first, stride: side, width: side_of, height: side_of });
                grids.vertices.extend(samples.positions.iter().map(|p| p.as_vec3().to_array()));
            }
        }
        Ok(grids)
    }

    /// The cage itself.
    pub fn for_embree(&self) -> embree::Cage {
        embree::Cage {
            vertices: self.positions.iter().map(|p| p.as_vec3().to_array()).collect(),
            sizes: self.sizes.clone(),
            indices: self.indices.clone(),
            creases: self.creases.iter().map(|&(a, b, _)| [a, b]).collect(),
            crease_weights: self.creases.iter().map(|it| it.2).collect(),
            corners: self.corners.iter().map(|it| it.0).collect(),
            corner_weights: self.corners.iter().map(|it| it.1).collect(),
        }
    }
}

/// Takes one cage, and refuses all else.
impl Sink for Cage {
    fn units(&mut self, _: Option<f64>, _: UpAxis) {}
    fn material(&mut self, _: MaterialDesc) -> Result<MaterialKey> {
        Ok(0)
    }
    fn part(&mut self, _: PartDesc) -> Result<PartKey> {
        Ok(0)
    }
    fn shared_mesh(&mut self, _: u32) -> Result<MeshKey> {
        Err(Error::bad_argument("a shared mesh, where a cage is taken"))
    }
    fn triangles(&mut self, _: MeshKey, _: u32, _: &[[DVec3; 3]], _: Attributes<'_>) -> Result<()> {
        Err(Error::bad_argument("triangles, where a cage is taken"))
    }
    fn instance(&mut self, _: MeshKey, _: DAffine3, _: PartKey) -> Result<()> {
        Err(Error::bad_argument("an instance, where a cage is taken"))
    }
    fn cage(&mut self, _: MeshKey, cage: &CageMesh<'_>) -> Result<()> {
        if !self.sizes.is_empty() || !cage.desc.holes.is_empty() || cage.displacement.is_some() {
            return Err(Error::bad_argument("one cage is taken, without holes and displacement"));
        }
        let CageDesc { face_sizes, indices, creases, corners, boundary, .. } = cage.desc;
        (self.positions, self.sizes, self.indices) = (cage.positions.to_vec(), face_sizes.to_vec(), indices.to_vec());
        (self.creases, self.corners, self.boundary) = (creases.to_vec(), corners.to_vec(), boundary);
        Ok(())
    }
    fn at(&mut self, _: u64, _: u64) {}
    fn note(&mut self, _: String) {}
    fn cancel(&self) -> &Cancel {
        &self.cancel
    }
}

#[cfg(test)]
impl Cage {
    /// A cube with a crease.
    pub fn of_cube() -> Self {
        let corner = |i: usize| DVec3::from_array([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { 1.0 } else { -1.0 }));
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Self {
            positions: (0..8).map(corner).collect(),
            sizes: vec![4; 6],
            indices: faces.concat(),
            creases: vec![(0, 1, 2.0)],
            boundary: Boundary::EdgeOnly,
            ..Self::default()
        }
    }

    /// The triangles of the dice.
    pub fn triangles(&self, level: u32) -> Result<Vec<[DVec3; 3]>> {
        let mut all = Vec::new();
        self.mesh().dice(Some(Dicing::Level(level)), &self.cancel, &mut |_, micro| {
            all.extend(&micro.positions);
            Ok(())
        })?;
        Ok(all)
    }
}
