//! Several files as one input, with progress over all of them.

use super::{
    Attributes, CageMesh, Dicing, MaterialDesc, MaterialKey, MeshKey, NurbsMesh, PartDesc, PartKey, ReadOptions, Sink,
    UpAxis, read_file,
};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use glam::{DAffine3, DVec3};
use std::path::Path;

/// Reads mesh files one after the other into `sink`, each as [`read_file`] does, with the same errors. [`Sink::at`]
/// reports progress in bytes of all files together.
pub fn read_files(paths: &[impl AsRef<Path>], options: &ReadOptions, sink: &mut dyn Sink) -> Result<()> {
    // A missing file counts as 0 bytes here; reading it fails later.
    let sizes: Vec<u64> = paths.iter().map(|p| std::fs::metadata(p).map_or(0, |m| m.len())).collect();
    let total = sizes.iter().fold(0u64, |sum, &size| sum.saturating_add(size));
    let mut before = 0;
    for (path, &size) in paths.iter().zip(&sizes) {
        read_file(path.as_ref(), options, &mut OneOfSeveral { sink, before, size, total })?;
        before += size;
    }
    Ok(())
}

/// The sink of one of several files.
struct OneOfSeveral<'a> {
    sink: &'a mut dyn Sink,
    /// Total size of the earlier files in bytes.
    before: u64,
    /// Size of this file in bytes.
    size: u64,
    /// Total size of all files in bytes.
    total: u64,
}

impl Sink for OneOfSeveral<'_> {
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis) {
        self.sink.units(metres_per_unit, up);
    }
    fn material(&mut self, material: MaterialDesc) -> Result<MaterialKey> {
        self.sink.material(material)
    }
    fn part(&mut self, part: PartDesc) -> Result<PartKey> {
        self.sink.part(part)
    }
    fn shared_mesh(&mut self, local_parts: u32) -> Result<MeshKey> {
        self.sink.shared_mesh(local_parts)
    }
    fn triangles(
        &mut self,
        mesh: MeshKey,
        part: u32,
        positions: &[[DVec3; 3]],
        attributes: Attributes<'_>,
    ) -> Result<()> {
        self.sink.triangles(mesh, part, positions, attributes)
    }
    fn instance(&mut self, mesh: MeshKey, world_from_mesh: DAffine3, first_part: PartKey) -> Result<()> {
        self.sink.instance(mesh, world_from_mesh, first_part)
    }
    fn dicing(&self) -> Option<Dicing> {
        self.sink.dicing()
    }
    fn cage(&mut self, mesh: MeshKey, cage: &CageMesh<'_>) -> Result<()> {
        self.sink.cage(mesh, cage)
    }
    fn nurbs(&mut self, mesh: MeshKey, surface: &NurbsMesh<'_>) -> Result<()> {
        self.sink.nurbs(mesh, surface)
    }
    fn at(&mut self, bytes: u64, total: u64) {
        // A reader's byte count can exceed the file's size if the file refers to other files.
        let share = if total > 0 { bytes as f64 / total as f64 } else { 0.0 };
        let here = (share.min(1.0) * self.size as f64) as u64;
        self.sink.at(self.before.saturating_add(here), self.total);
    }
    fn note(&mut self, text: String) {
        self.sink.note(text);
    }
    fn cancel(&self) -> &Cancel {
        self.sink.cancel()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::collect::Collector;

    #[test]
    fn progress_covers_all_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        let (small, large) = (folder.path().join("1.obj"), folder.path().join("2.obj"));
        std::fs::write(&small, triangle).expect("a file");
        std::fs::write(&large, triangle.repeat(3)).expect("a file");
        let bytes = triangle.len() as u64;
        let options = ReadOptions::default();
        let mut all = Collector::new();
        read_files(&[&small, &large], &options, &mut all).expect("two files");
        assert_eq!(all.at, (4 * bytes, 4 * bytes));
        assert_eq!(all.direct().len(), 4);
        // The second file fails at its first line, so that progress is between the two files.
        std::fs::write(&large, triangle.repeat(3).replacen('v', "x\nf 7 8 9\n#", 1)).expect("a file");
        let mut all = Collector::new();
        assert!(read_files(&[&small, &large], &options, &mut all).is_err());
        assert!((bytes..4 * bytes).contains(&all.at.0) && all.at.1 > 4 * bytes, "{:?}", all.at);
        let missing = folder.path().join("3.obj");
        let e = read_files(&[&small, &missing], &options, &mut all).unwrap_err();
        assert!(e.to_string().contains("3.obj"), "{e}");
    }
}
