//! A sink that keeps everything in memory, for tests and small tools.

use super::{Attributes, MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, Sink, UpAxis};
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use crate::math::DBounds;
use glam::{DAffine3, DVec3, Vec3};

/// A triangle of a [`CollectedMesh`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollectedTriangle {
    /// Index of the triangle in the whole input.
    pub prim: u64,
    /// A [`PartKey`], or the local part in a shared mesh.
    pub part: u32,
    /// Corners in world coordinates, or in the coordinates of the shared mesh.
    pub positions: [DVec3; 3],
    /// Linear RGB at the corners, if the triangle has colours of its own.
    pub colours: Option<[[f32; 3]; 3]>,
    /// Normals at the corners, if the input has them; in the coordinates of the mesh.
    pub normals: Option<[Vec3; 3]>,
}

impl CollectedTriangle {
    /// Returns the mean of the colours at the corners.
    pub fn colour(&self) -> Option<[f32; 3]> {
        let [a, b, c] = self.colours?;
        Some(if a == b && a == c { a } else { std::array::from_fn(|i| (a[i] + b[i] + c[i]) / 3.0) })
    }
}

/// A mesh of a [`Collector`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CollectedMesh {
    /// Number of local parts given to [`Sink::shared_mesh`]; 0 for the directly placed triangles.
    pub local_parts: u32,
    /// Triangles in the order of arrival.
    pub triangles: Vec<CollectedTriangle>,
}

/// A placed shared mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollectedInstance {
    /// The shared mesh.
    pub mesh: MeshKey,
    /// Transform from the mesh to the world.
    pub world_from_mesh: DAffine3,
    /// The part that local part 0 becomes.
    pub first_part: PartKey,
}

/// Keeps everything it receives, and refuses calls that break the rules of [`Sink`].
///
/// Memory is not bounded: it grows with the input, by about 120 bytes per triangle.
#[derive(Debug, Clone)]
pub struct Collector {
    /// First stated length unit.
    pub metres_per_unit: Option<f64>,
    /// First stated up axis.
    pub up: UpAxis,
    /// Materials, indexed by [`MaterialKey`].
    pub materials: Vec<MaterialDesc>,
    /// Parts, indexed by [`PartKey`].
    pub parts: Vec<PartDesc>,
    /// Meshes, indexed by [`MeshKey`]. The first one holds the directly placed triangles.
    pub meshes: Vec<CollectedMesh>,
    /// Instances in the order of arrival.
    pub instances: Vec<CollectedInstance>,
    /// Messages of the reader for the user.
    pub notes: Vec<String>,
    /// Last progress report: bytes read, bytes in total.
    pub at: (u64, u64),
    /// Number of triangles received, over all meshes.
    pub received: u64,
    cancel: Cancel,
}

impl Default for Collector {
    fn default() -> Self {
        Self::new()
    }
}

impl Collector {
    /// Creates an empty collector.
    pub fn new() -> Self {
        Self::with_cancel(Cancel::new())
    }

    /// Creates an empty collector; readers stop once `cancel` is set.
    pub fn with_cancel(cancel: Cancel) -> Self {
        Self {
            metres_per_unit: None,
            up: UpAxis::Unknown,
            materials: Vec::new(),
            parts: Vec::new(),
            meshes: vec![CollectedMesh::default()],
            instances: Vec::new(),
            notes: Vec::new(),
            at: (0, 0),
            received: 0,
            cancel,
        }
    }

    /// Returns the directly placed triangles.
    pub fn direct(&self) -> &[CollectedTriangle] {
        &self.meshes[0].triangles
    }

    /// Returns every triangle at its place in the world: the direct ones, then those of each instance, with their real
    /// part.
    pub fn placed(&self) -> impl Iterator<Item = CollectedTriangle> + '_ {
        let instanced = self.instances.iter().flat_map(|i| {
            self.meshes[i.mesh.0 as usize].triangles.iter().map(move |t| CollectedTriangle {
                part: i.first_part + t.part,
                positions: t.positions.map(|p| i.world_from_mesh.transform_point3(p)),
                ..*t
            })
        });
        self.direct().iter().copied().chain(instanced)
    }

    /// Returns the bounding box of [`Collector::placed`]; points that are not finite are ignored.
    pub fn bounds(&self) -> DBounds {
        self.placed().flat_map(|t| t.positions).filter(|p| p.is_finite()).fold(DBounds::EMPTY, DBounds::with)
    }

    fn part_count(&self) -> u32 {
        self.parts.len() as u32
    }
}

impl Sink for Collector {
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis) {
        self.metres_per_unit = self.metres_per_unit.or(metres_per_unit);
        if self.up == UpAxis::Unknown {
            self.up = up;
        }
    }

    fn material(&mut self, material: MaterialDesc) -> Result<MaterialKey> {
        self.materials.push(material);
        Ok(self.materials.len() as u32 - 1)
    }

    fn part(&mut self, part: PartDesc) -> Result<PartKey> {
        if part.parent.is_some_and(|p| p >= self.part_count()) {
            return Err(Error::bad_argument("a part's parent must come before it"));
        }
        if part.material.is_some_and(|m| m as usize >= self.materials.len()) {
            return Err(Error::bad_argument("no such material"));
        }
        self.parts.push(part);
        Ok(self.part_count() - 1)
    }

    fn shared_mesh(&mut self, local_parts: u32) -> Result<MeshKey> {
        self.meshes.push(CollectedMesh { local_parts, triangles: Vec::new() });
        Ok(MeshKey(self.meshes.len() as u32 - 1))
    }

    fn triangles(
        &mut self,
        mesh: MeshKey,
        part: u32,
        positions: &[[DVec3; 3]],
        attributes: Attributes<'_>,
    ) -> Result<()> {
        let parts = self.part_count();
        let Some(target) = self.meshes.get_mut(mesh.0 as usize) else {
            return Err(Error::bad_argument("no such mesh"));
        };
        if part >= if mesh == MeshKey::DIRECT { parts } else { target.local_parts } {
            return Err(Error::bad_argument("no such part"));
        }
        attributes.check(positions.len())?;
        for (i, &positions) in positions.iter().enumerate() {
            let (colours, normals) = (attributes.colours.map(|c| c[i]), attributes.normals.map(|n| n[i]));
            target.triangles.push(CollectedTriangle { prim: self.received, part, positions, colours, normals });
            self.received += 1;
        }
        Ok(())
    }

    fn instance(&mut self, mesh: MeshKey, world_from_mesh: DAffine3, first_part: PartKey) -> Result<()> {
        let Some(shared) = self.meshes.get(mesh.0 as usize).filter(|_| mesh != MeshKey::DIRECT) else {
            return Err(Error::bad_argument("no such shared mesh"));
        };
        if u64::from(first_part) + u64::from(shared.local_parts) > self.parts.len() as u64 {
            return Err(Error::bad_argument("the instance has parts that were not declared"));
        }
        let det = world_from_mesh.matrix3.determinant();
        if !world_from_mesh.is_finite() || !det.is_finite() || det == 0.0 {
            return Err(Error::bad_argument("an instance needs a finite, invertible transform"));
        }
        self.instances.push(CollectedInstance { mesh, world_from_mesh, first_part });
        Ok(())
    }

    fn at(&mut self, bytes: u64, total: u64) {
        self.at = (bytes, total);
    }

    fn note(&mut self, text: String) {
        self.notes.push(text);
    }

    fn cancel(&self) -> &Cancel {
        &self.cancel
    }
}
