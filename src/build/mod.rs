//! The build of a model file from meshes, as a list of passes:
//!
//! 1. **read** (`spool`): triangles are checked, counted and kept with their parts; triangles that do not fit the
//!    memory budget are encoded and written to a scratch file;
//! 2. **place** (`split`, `places`, `owners`, `resolve`, `origin`): each mesh gets an origin, positions become single
//!    precision relative to it, and triangles without area are counted and dropped. Triangles that would lose their
//!    shape go to further trees with other origins. The sums of edges that are taken here or while distributing tell
//!    which parts are closed (`edges`);
//! 3. **distribute** (`survey`, `regions`, `distribute`, `margins`), for meshes that do not fit: triangles are sorted
//!    into chunks of neighbouring triangles, each of which fits, and each chunk gets the triangles around it;
//! 4. **build** (`mesh`; `tight` for the bounds of turned placements): normals are made (`normals`), and the
//!    structure's baker (`structure::bake`) makes a tree and its blocks of each chunk. The blocks are put aside; the
//!    top of the tree stays, and is joined to the coarse blocks of the mesh;
//! 5. **write** (`output`): coarse blocks, then those of each further class; blocks are encoded in parallel and written
//!    in order;
//! 6. **seal** (`seal`): primitive ids, colours, normals, tables, checksums, sync, rename.
//!
//! A mesh that fits is one chunk, and only blocks of the last class are put aside. `shares` divides the budget. The
//! chunks, and so the bytes of the file, depend on the budget and never on the number of threads.
#![forbid(unsafe_code)]

mod batch;
mod bloom;
mod builder;
mod coding;
mod distribute;
mod edges;
mod margins;
mod mesh;
mod normals;
mod origin;
mod output;
mod owners;
mod part_sets;
mod parts;
mod patches;
mod places;
mod proxies;
mod regions;
mod report;
mod resolve;
mod seal;
mod shares;
mod split;
mod spool;
mod surfaces;
mod survey;
mod tight;
mod values;

pub use crate::structure::Structure;
pub use builder::Builder;
pub use proxies::{MOST_PROXY_RAYS, PROXY_RAYS};
pub use report::{BuildReport, PhaseSeconds};

use crate::import::{Access, Dicing, HeightMap, UpAxis};
use std::path::PathBuf;

/// Spatial splits: a triangle may be referred to by several leaves. They pay for long thin triangles, and do not pay
/// for scans.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Splits {
    /// Splits, if the shape of the triangles says that they pay.
    #[default]
    Auto,
    /// No splits.
    Off,
    /// Splits always.
    On,
}

impl Splits {
    /// All values.
    pub const ALL: [Self; 3] = [Self::Auto, Self::Off, Self::On];

    /// Name in command lines and benchmarks.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Off => "off",
            Self::On => "on",
        }
    }
}

/// The look of stand-ins: what is shown for a part of a model that is small or not in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StandIns {
    /// The library chooses. At present voxels.
    #[default]
    Auto,
    /// Each cell has its own, from the sides of its box.
    Voxels,
    /// Subtrees of some hundred triangles have one from eighteen directions, which all cells in them show. It takes
    /// about 0.3 bytes of memory for each triangle, always.
    Proxies,
}

impl StandIns {
    /// All values.
    pub const ALL: [Self; 3] = [Self::Auto, Self::Voxels, Self::Proxies];

    /// Name in command lines and benchmarks.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Voxels => "voxels",
            Self::Proxies => "proxies",
        }
    }
}

/// The leaves of surfaces under [`Structure::Patch`]: how rays that stand-ins do not serve find their triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SurfaceLeaves {
    /// Boxes alone are stored: the triangles are computed from the control points where a ray comes to them, at about a
    /// byte of memory for each triangle. Displaced surfaces, surfaces of degrees above 3, and small squares at vertices
    /// where the surface is no polynomial have facets.
    #[default]
    Boxes,
    /// The vertices of all triangles are stored, about seven bytes for each triangle: rays find them sooner.
    Facets,
}

impl SurfaceLeaves {
    /// All values.
    pub const ALL: [Self; 2] = [Self::Boxes, Self::Facets];

    /// Name in command lines and benchmarks.
    pub fn name(self) -> &'static str {
        match self {
            Self::Boxes => "boxes",
            Self::Facets => "facets",
        }
    }
}

/// Greatest angle between normals of a flat square of a surface unless another is asked for, in degrees.
pub const SURFACE_FLAT: f32 = 30.0;

/// Options of a build. The default suits most models.
#[derive(Debug, Clone, Default)]
pub struct BuildOptions {
    /// The acceleration structure. With [`Structure::Patch`] surfaces are kept as such and not as triangles, and have
    /// their own normals whatever the crease angle. Default: [`Structure::Bvh`].
    pub structure: Structure,
    /// Bytes of memory that the build may use, at least 32 MiB; 0 for no limit. Default 0. Triangles that do not fit go
    /// through scratch files, about 20 bytes each, or up to 80 if they are split, and their tree is built in chunks:
    /// files built with different budgets hold the same triangles in slightly different trees.
    pub memory_budget: u64,
    /// Number of threads: 0 for the number of the machine's processors, 1 to stay in the calling thread. Default 0. The
    /// file does not depend on it.
    pub threads: usize,
    /// Folder of scratch files; the system's default if `None`. The files have no names, and are gone when the build
    /// ends in any way.
    pub temp_dir: Option<PathBuf>,
    /// Spatial splits. Default: automatic.
    pub splits: Splits,
    /// Metres per unit of length, which replaces the value in the input; > 0.
    pub metres_per_unit: Option<f64>,
    /// Up axis, which replaces the value in the input.
    pub up: Option<UpAxis>,
    /// Where the input gives no normals, they are made from the faces that meet at an edge at less than this angle, in
    /// degrees up to 180; the edge then appears smooth. 0: [`CREASE_ANGLE`]. Below 0: none are made, and faces appear
    /// flat. Default 0.
    pub crease_angle: f32,
    /// The files that mesh files may refer to. Default: those in the folder of each mesh file and below it.
    pub access: Access,
    /// Greatest number of triangles of the input; 0 for no limit. Those of a shared mesh count once. Default 0.
    pub max_triangles: u64,
    /// Greatest number of bytes that the model file and all scratch files take on the disk at any time; 0 for no limit.
    /// Default 0.
    pub max_bytes: u64,
    /// The look of stand-ins. Default: automatic.
    pub stand_ins: StandIns,
    /// Number of rays into each subtree that gets a proxy, at most [`MOST_PROXY_RAYS`]; 0 for [`PROXY_RAYS`]. Default
    /// 0.
    pub proxy_rays: u32,
    /// Fewest triangles of a subtree that gets a proxy. 0: so many that all proxies take about 0.3 bytes for each
    /// triangle. Default 0.
    pub proxy_triangles: u32,
    /// How finely smooth surfaces are diced, in all structures. Default: to
    /// [`crate::import::surfaces::TOLERANCE`] of their extent. With [`Structure::Patch`] a tolerance is part of the
    /// error of exact hits.
    pub dicing: Option<Dicing>,
    /// The leaves of surfaces under [`Structure::Patch`]. Default: boxes.
    pub surface_leaves: SurfaceLeaves,
    /// Under [`Structure::Patch`], squares of surfaces with more than 128 triangles are divided while the normals of
    /// one are not within a cone of this opening, in degrees up to 180. Smaller angles give tighter boxes, which take
    /// more memory. 0: [`SURFACE_FLAT`]. Default 0.
    pub surface_flat: f32,
    /// Faces of OBJ files are the cages of subdivision surfaces. Default: they are polygons.
    pub subdivide: bool,
    /// A map of heights by which these surfaces are moved. Default: none.
    pub displacement: Option<HeightMap>,
}

/// The crease angle unless another is asked for, in degrees: chamfers of 45 degrees stay edges.
pub const CREASE_ANGLE: f32 = 40.0;

impl BuildOptions {
    /// The crease angle in degrees; below 0 if no normals are made.
    pub fn crease(&self) -> f32 {
        if self.crease_angle == 0.0 { CREASE_ANGLE } else { self.crease_angle }
    }

    /// The cosine of half the opening of the cone around the normals of a flat square of a surface.
    pub(crate) fn cosine_of_flat(&self) -> f32 {
        let opening = if self.surface_flat == 0.0 { SURFACE_FLAT } else { self.surface_flat };
        (0.5 * opening).to_radians().cos()
    }
}

#[cfg(test)]
mod tests;
