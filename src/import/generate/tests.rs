use super::*;
use crate::import::{Attributes, MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, UpAxis};
use glam::{DAffine3, DVec3};
use std::collections::HashMap;

/// A sink that keeps everything it receives.
#[derive(Default)]
struct Kept {
    parts: Vec<PartDesc>,
    materials: Vec<MaterialDesc>,
    triangles: Vec<(u32, [DVec3; 3])>,
    largest_batch: usize,
    cancel: Cancel,
}

impl Sink for Kept {
    fn units(&mut self, _: Option<f64>, _: UpAxis) {}
    fn material(&mut self, m: MaterialDesc) -> Result<MaterialKey> {
        self.materials.push(m);
        Ok(self.materials.len() as u32 - 1)
    }
    fn part(&mut self, p: PartDesc) -> Result<PartKey> {
        self.parts.push(p);
        Ok(self.parts.len() as u32 - 1)
    }
    fn shared_mesh(&mut self, _: u32) -> Result<MeshKey> {
        Err(Error::bad_argument("unused"))
    }
    fn triangles(&mut self, _: MeshKey, part: u32, t: &[[DVec3; 3]], _: Attributes<'_>) -> Result<()> {
        self.largest_batch = self.largest_batch.max(t.len());
        self.triangles.extend(t.iter().map(|t| (part, *t)));
        Ok(())
    }
    fn instance(&mut self, _: MeshKey, _: DAffine3, _: PartKey) -> Result<()> {
        Err(Error::bad_argument("unused"))
    }
    fn at(&mut self, _: u64, _: u64) {}
    fn note(&mut self, _: String) {}
    fn cancel(&self) -> &Cancel {
        &self.cancel
    }
}

fn generated(name: &str, triangles: u64, seed: u64, threads: usize) -> Kept {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut kept = Kept::default();
    pool.install(|| {
        generate(name, &GenerateOptions { triangles, seed, ..Default::default() }, &Cancel::new(), &mut kept)
    })
    .unwrap();
    kept
}

#[test]
fn threads_change_nothing_and_seeds_do() {
    for name in NAMES {
        let one = generated(name, 120_000, 3, 1).triangles;
        assert_eq!(one, generated(name, 120_000, 3, 2).triangles, "{name}");
        assert_ne!(one, generated(name, 120_000, 4, 2).triangles, "{name}");
    }
}

#[test]
fn counts_are_within_two_percent() {
    for name in NAMES {
        for wanted in [100_000, 170_000, 1_000_000] {
            let found = generated(name, wanted, 0, 2).triangles.len() as f64;
            assert!((found / wanted as f64 - 1.0).abs() < 0.02, "{name} {wanted}: {found}");
        }
    }
}

#[test]
fn bulb_triangles_are_at_most_twice_the_mean() {
    for (wanted, seed) in [(5_000, 0), (50_000, 1), (400_000, 0), (1_000_000, 2)] {
        let kept = generated("mandelbulb", wanted, seed, 2);
        let area = |t: &[DVec3; 3]| 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length();
        let areas: Vec<f64> = kept.triangles.iter().map(|(_, t)| area(t)).collect();
        let mean = areas.iter().sum::<f64>() / areas.len() as f64;
        let largest = areas.iter().fold(0.0, |a: f64, &b| a.max(b));
        println!("{wanted}: largest / mean = {}", largest / mean);
        assert!(largest <= 2.0 * mean, "{wanted}: {}", largest / mean);
    }
}

/// Returns the indexed mesh of the file, parsed without the crate's reader.
fn indexed(name: &str, options: &GenerateOptions) -> (Vec<[f32; 3]>, Vec<[u32; 3]>, Generated) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.ply");
    let generated = generate_file(name, options, &Cancel::new(), &path, &mut |_| ()).unwrap();
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no temporaries left");
    let bytes = std::fs::read(&path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let row = if generated.parts > 1 { 17 } else { 13 };
    let faces_at = end + 12 * generated.vertices as usize;
    assert_eq!(bytes.len(), faces_at + row * generated.triangles as usize);
    let word = |b: &[u8], i: usize| u32::from_le_bytes(b[i..i + 4].try_into().unwrap());
    let vertices = bytes[end..faces_at].chunks(12).map(|v| [0, 4, 8].map(|i| f32::from_bits(word(v, i)))).collect();
    let faces = bytes[faces_at..].chunks(row).map(|f| [1, 5, 9].map(|i| word(f, i))).collect();
    (vertices, faces, generated)
}

#[test]
fn each_edge_of_the_bulb_has_two_triangles_of_opposite_direction() {
    for (triangles, seed) in [(3_000, 0), (30_000, 7), (300_000, 0)] {
        let (vertices, faces, _) = indexed("mandelbulb", &GenerateOptions { triangles, seed, ..Default::default() });
        let mut edges: HashMap<(u32, u32), [u32; 2]> = HashMap::new();
        for f in &faces {
            for i in 0..3 {
                let (a, b) = (f[i], f[(i + 1) % 3]);
                assert_ne!(a, b);
                edges.entry((a.min(b), a.max(b))).or_default()[usize::from(a < b)] += 1;
            }
        }
        let bad = edges.values().filter(|n| **n != [1, 1]).count();
        assert_eq!(bad, 0, "of {} edges", edges.len());
        let ratio = faces.len() as f64 / vertices.len() as f64;
        assert!((1.9..2.1).contains(&ratio), "{ratio} triangles a vertex");
        // Triangles are oriented outward: the volume by the divergence theorem is positive and that of a bulb with a
        // radius above 1.
        let p = |v: u32| DVec3::from(vertices[v as usize].map(f64::from));
        let volume: f64 = faces.iter().map(|f| p(f[0]).dot(p(f[1]).cross(p(f[2]))) / 6.0).sum();
        assert!((2.0..10.0).contains(&volume), "{volume}");
    }
}

#[test]
fn the_file_holds_what_the_sink_gets() {
    for name in NAMES {
        let options = GenerateOptions { triangles: 100_000, seed: 5, ..Default::default() };
        let (vertices, faces, counts) = indexed(name, &options);
        let kept = generated(name, 100_000, 5, 2);
        let p = |v: u32| DVec3::from(vertices[v as usize].map(f64::from));
        assert_eq!(kept.triangles.len(), faces.len());
        assert!(kept.triangles.iter().zip(&faces).all(|((_, t), f)| *t == f.map(p)));
        assert_eq!(counts.parts, kept.parts.len() as u64);
        assert!(kept.largest_batch <= 1 << 14);
    }
}

#[test]
fn the_reader_restores_written_models() {
    for name in NAMES {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.ply");
        let options = GenerateOptions { triangles: 100_000, seed: 0, ..Default::default() };
        generate_file(name, &options, &Cancel::new(), &path, &mut |_| ()).unwrap();
        let mut read = Kept::default();
        crate::import::read_file(&path, &Default::default(), &mut read).unwrap();
        let kept = generated(name, 100_000, 0, 2);
        assert_eq!(read.parts, kept.parts);
        assert_eq!(read.materials, kept.materials);
        assert!(read.triangles == kept.triangles, "{name}");
    }
}

#[test]
fn a_cancelled_or_failed_file_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.ply");
    std::fs::write(&path, "old").unwrap();
    let (cancel, options) = (Cancel::new(), GenerateOptions { triangles: 50_000, seed: 0, ..Default::default() });
    let c = cancel.clone();
    let out = generate_file("mandelbulb", &options, &cancel, &path, &mut |_| c.cancel());
    assert!(matches!(out, Err(Error::Cancelled)));
    let missing = dir.path().join("none/m.ply");
    assert!(matches!(
        generate_file("mandelbulb", &options, &Cancel::new(), &missing, &mut |_| ()),
        Err(Error::Io { .. })
    ));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
}

#[test]
fn bad_names_and_sizes_are_refused() {
    for (name, triangles) in
        [("teapot", 1000), ("mandelbulb", 0), ("mandelbulb", u64::MAX), ("airliner", 99_999), ("airliner", 1 << 40)]
    {
        let mut kept = Kept::default();
        let out =
            generate(name, &GenerateOptions { triangles, seed: 0, ..Default::default() }, &Cancel::new(), &mut kept);
        assert!(matches!(out, Err(Error::BadArgument(_))), "{name} {triangles}");
    }
    let options = GenerateOptions { triangles: 5_000, seed: 0, species: 1 };
    let out = generate("mandelbulb", &options, &Cancel::new(), &mut Kept::default());
    assert!(matches!(out, Err(Error::BadArgument(why)) if why.contains("species")));
}

#[test]
#[ignore = "a measurement: run alone, with --nocapture"]
fn time_of_ten_million() {
    for name in NAMES {
        for triangles in [1_000_000, 10_000_000] {
            let mut n = 0;
            let start = std::time::Instant::now();
            let out = tempfile::tempdir().unwrap();
            let options = GenerateOptions { triangles, seed: 0, ..Default::default() };
            let g = generate_file(name, &options, &Cancel::new(), &out.path().join("m.ply"), &mut |_| n += 1).unwrap();
            println!("{name} {triangles}: {g:?} in {:?}, {n} batches", start.elapsed());
        }
    }
}
