//! A model: one built file, opened read-only.

use super::camera::Camera;
use super::context::Context;
use crate::base::error::{Error, Result};
use crate::base::units::UpAxis;
use crate::math::DBounds;
use crate::store::source::Source;
use std::path::Path;
use std::sync::Arc;

/// A part of a model, as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct PartInfo {
    /// The caller's id.
    pub id: u64,
    /// Its name; may be empty.
    pub name: String,
    /// Index of the part above it in [`Model::parts`].
    pub parent: Option<u32>,
    /// Linear RGBA of its material; alpha is the opacity.
    pub colour: [f32; 4],
    /// Its material's metalness, in [0, 1].
    pub metalness: f32,
    /// Its material's roughness, in [0, 1].
    pub roughness: f32,
    /// Around all its triangles, in model space; empty if it has none.
    pub bounds: DBounds,
    /// Triangles of its own, not of the parts below it.
    pub triangles: u64,
}

/// What a model is, from its header.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelInfo {
    /// The file, or a name for a source that has none.
    pub name: String,
    /// Its structure: "bvh".
    pub structure: &'static str,
    /// Triangles in the input.
    pub triangles_in: u64,
    /// Triangles stored, shared ones once.
    pub triangles_stored: u64,
    /// Triangles seen, shared ones once for each instance.
    pub triangles_placed: u64,
    /// Parts.
    pub parts: u32,
    /// Trees: the directly placed triangles, and one for each shared mesh.
    pub trees: u32,
    /// Placements in the model's own assembly.
    pub instances: u32,
    /// Blocks of geometry.
    pub geometry_blocks: u32,
    /// Around everything; empty for a model without triangles.
    pub bounds: DBounds,
    /// Length unit, if known.
    pub metres_per_unit: Option<f64>,
    /// Up axis, if known.
    pub up: UpAxis,
    /// Whether single triangles carry colours.
    pub has_colours: bool,
    /// Bytes of the file.
    pub file_bytes: u64,
}

/// Memory that a model holds, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ModelMemory {
    /// Blocks in memory now, in trace form.
    pub resident: u64,
    /// All geometry blocks in trace form (nodes and triangles).
    pub geometry: u64,
    /// Directory, parts and other tables.
    pub tables: u64,
}

/// An opened model; cloning is cheap and gives the same model. Thread-safe.
#[derive(Clone)]
pub struct Model(Arc<Inner>);

struct Inner {
    context: Context,
    info: ModelInfo,
    parts: Vec<PartInfo>,
}

impl Model {
    /// Opens the built file at `path`. Reads the disk.
    ///
    /// Fails with `Io`, `Corrupt`, `NewerFormat`, or `OverBudget` naming the bytes it needs.
    pub fn open(context: &Context, path: impl AsRef<Path>) -> Result<Self> {
        let _ = (context, path);
        Err(Error::BadState("Model::open: being built".into()))
    }

    /// Opens a model that `source` reads. Fails like [`Model::open`].
    pub fn open_source(context: &Context, source: Arc<dyn Source>) -> Result<Self> {
        let _ = (context, source);
        Err(Error::BadState("Model::open_source: being built".into()))
    }

    /// The context it was opened in.
    pub fn context(&self) -> &Context {
        &self.0.context
    }

    /// What it is.
    pub fn info(&self) -> &ModelInfo {
        &self.0.info
    }

    /// Its parts, in the file's order.
    pub fn parts(&self) -> &[PartInfo] {
        &self.0.parts
    }

    /// The index in [`Model::parts`] of the first part with this id.
    pub fn part_index(&self, id: u64) -> Option<u32> {
        self.0.parts.iter().position(|p| p.id == id).map(|i| i as u32)
    }

    /// Bytes it holds in memory now.
    pub fn memory(&self) -> ModelMemory {
        ModelMemory::default()
    }

    /// Four views from its bounds: two of the whole, two at a quarter of the distance.
    pub fn views(&self) -> [Camera; 4] {
        super::camera::default_views(&self.0.info.bounds, self.0.info.up)
    }
}
