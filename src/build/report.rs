//! What a build did.

/// Seconds of each phase.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PhaseSeconds {
    /// From the builder's creation to the call of `finish`: reading input.
    pub read: f64,
    /// Of meshes that do not fit the budget: looking at all triangles, and sorting them into chunks.
    pub distribute: f64,
    /// Origins, rounding, trees.
    pub build: f64,
    /// Encoding, writing, sealing.
    pub write: f64,
}

/// What a build read, dropped and wrote.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BuildReport {
    /// Triangles of the input.
    pub triangles_in: u64,
    /// Triangles in the file.
    pub triangles_kept: u64,
    /// Left out: a vertex is NaN or infinite.
    pub non_finite: u64,
    /// Left out: no area.
    pub degenerate: u64,
    /// Left out: more than 1e15 units from the middle of its mesh.
    pub out_of_range: u64,
    /// References in leaves: more than the triangles where these were split.
    pub references: u64,
    /// Rows of the part table.
    pub parts: u64,
    /// Trees: one, and one for each shared mesh.
    pub trees: u64,
    /// Placings of shared meshes.
    pub instances: u64,
    /// Inner nodes.
    pub nodes: u64,
    /// Leaves.
    pub leaves: u64,
    /// Geometry blocks.
    pub blocks: u64,
    /// Of these, coarse ones: nodes alone, read when the model is opened.
    pub blocks_coarse: u64,
    /// Pieces that the trees were built in: one a tree, and more of those that do not fit the budget.
    pub chunks: u64,
    /// Bytes of the trace form of nodes and triangles.
    pub bytes_trace: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// Most bytes that temporaries took at any time, without those of readers and the file itself.
    pub bytes_temporary: u64,
    /// Bytes of it that are primitive ids.
    pub bytes_ids: u64,
    /// The greatest distance between a vertex of the input and as stored, in units of the model.
    pub position_error: f64,
    /// Whether triangles were split between leaves.
    pub spatial_splits: bool,
    /// What the readers had to say.
    pub notes: Vec<String>,
    /// Time taken.
    pub seconds: PhaseSeconds,
}
