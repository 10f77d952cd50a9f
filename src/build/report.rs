//! The report of a build.

/// Duration of each phase in seconds.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PhaseSeconds {
    /// Reading the input: from the builder's creation to the call of `finish`.
    pub read: f64,
    /// Surveying all triangles and sorting them into chunks, for meshes that do not fit the budget.
    pub distribute: f64,
    /// Choosing origins, rounding, building trees.
    pub build: f64,
    /// Encoding, writing, sealing.
    pub write: f64,
}

/// Numbers of things that a build read, dropped and wrote.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BuildReport {
    /// Triangles in the input.
    pub triangles_in: u64,
    /// Triangles in the file.
    pub triangles_kept: u64,
    /// Dropped triangles with a vertex that is NaN or infinite.
    pub non_finite: u64,
    /// Dropped triangles without area.
    pub degenerate: u64,
    /// Dropped triangles that are more than 1e15 units from the origin of their mesh.
    pub out_of_range: u64,
    /// References to triangles in leaves: more than triangles if some were split.
    pub references: u64,
    /// Rows of the part table.
    pub parts: u64,
    /// Trees: one, one for each shared mesh, and further ones for meshes with details far apart.
    pub trees: u64,
    /// Instances of shared meshes, and of the further trees.
    pub instances: u64,
    /// Inner nodes.
    pub nodes: u64,
    /// Leaves.
    pub leaves: u64,
    /// Geometry blocks.
    pub blocks: u64,
    /// Coarse blocks among these, which are read when the model is opened.
    pub blocks_coarse: u64,
    /// Chunks that the trees were built in: one per tree, and more for trees that do not fit the budget.
    pub chunks: u64,
    /// Bytes of the trace form of nodes and triangles.
    pub bytes_trace: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// Greatest number of bytes of the scratch files at any time, without those of readers and the file itself.
    pub bytes_temporary: u64,
    /// Bytes of the primitive ids in the file.
    pub bytes_ids: u64,
    /// Bytes of the normals in the file; 0 if each triangle has its own.
    pub bytes_normals: u64,
    /// Proxies of subtrees.
    pub proxies: u64,
    /// Bytes of memory that the proxies take in each context that opens the model.
    pub bytes_proxies: u64,
    /// Normals of the input that are zero or not finite. Those of the triangles replace them.
    pub unusable_normals: u64,
    /// Greatest distance between a vertex of the input and the stored vertex, in units of the model.
    pub position_error: f64,
    /// True if some triangles were split between leaves.
    pub spatial_splits: bool,
    /// Notes of the readers and of the build.
    pub notes: Vec<String>,
    /// Duration of the phases.
    pub seconds: PhaseSeconds,
}
