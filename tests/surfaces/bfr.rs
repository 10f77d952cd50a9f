//! Limit surfaces against OpenSubdiv 3.5's Bfr at approximation level 10: `bfr.bin` holds the values that `bfr.cpp`
//! wrote for `cages.obj`.

use super::deep;
use crate::common::shapes::{Shape, own, parsed};
use glam::DVec3;
use outcrop::geom::surface::cage::CagePatches;

struct Record {
    face: u32,
    corner: u32,
    u: f64,
    v: f64,
    position: DVec3,
    du: DVec3,
    dv: DVec3,
}

/// Takes numbers off the front of bytes.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (head, rest) = self.0.split_first_chunk().expect("bfr.bin is too short");
        self.0 = rest;
        *head
    }

    fn int(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }

    fn double(&mut self) -> f64 {
        f64::from_le_bytes(self.bytes())
    }

    fn vector(&mut self, mut number: impl FnMut(&mut Self) -> f64) -> DVec3 {
        DVec3::new(number(self), number(self), number(self))
    }

    fn record(&mut self) -> Record {
        let single = |r: &mut Self| f64::from(f32::from_le_bytes(r.bytes()));
        Record {
            face: self.int(),
            corner: self.int(),
            u: self.double(),
            v: self.double(),
            position: self.vector(Self::double),
            du: self.vector(single),
            dv: self.vector(single),
        }
    }
}

/// Greatest differences of one cage: positions by its extent, and normals.
#[derive(Debug, Default, Clone, Copy)]
struct Most {
    points: usize,
    position: f64,
    normal: f64,
}

impl Most {
    fn add(&mut self, position: f64, normal: f64) {
        self.points += 1;
        self.position = self.position.max(position);
        self.normal = self.normal.max(normal);
    }
}

#[derive(Debug, Default)]
struct Differences {
    /// From Bfr outside of the squares at corners where Bfr approximates.
    bfr: Most,
    /// Greatest relative difference of the derivatives by u there.
    derivative: f64,
    /// From deep subdivision within these squares.
    deep: Most,
    /// Of Bfr from deep subdivision there: how far it approximates.
    bfr_from_deep: Most,
}

/// Side of the squares at corners of quads in which Bfr at level 10 approximates; twice as large in other faces, whose
/// quads are a level deeper, and once more since a point on the rim belongs to either side.
const APPROXIMATED: f64 = 1.0 / 256.0;

/// Most points of a cage that are compared with deep subdivision.
const MOST_DEEP: usize = 300;

fn compare(shape: &Shape, records: &[Record]) -> Differences {
    let surface = CagePatches::new(&shape.cage(), &shape.points).unwrap();
    let mut most = Differences::default();
    let extent = shape.extent();
    let step = records.len() / MOST_DEEP + 1;
    for (i, r) in records.iter().enumerate() {
        let p = surface.evaluate(r.face, r.corner, r.u, r.v);
        let expected = r.du.cross(r.dv).normalize_or_zero();
        // Faces that are a point or a line have no normal.
        let has_normal = r.du.cross(r.dv).length() > 1e-9 * extent * extent;
        let off = |normal: DVec3, from: DVec3| if has_normal { normal.distance(from) } else { 0.0 };
        let (position, normal) = (p.position.distance(r.position) / extent, off(p.normal(), expected));
        if [r.u, r.v].iter().any(|&t| t.min(1.0 - t) > APPROXIMATED) {
            most.bfr.add(position, normal);
            most.derivative = most.derivative.max(p.du.distance(r.du) / r.du.length());
        } else if i % step == 0 {
            let deep = deep::limit(shape, r.face, r.corner, r.u, r.v);
            most.deep.add(p.position.distance(deep.position) / extent, off(p.normal(), deep.normal));
            most.bfr_from_deep.add(r.position.distance(deep.position) / extent, off(expected, deep.normal));
        }
    }
    most
}

fn compare_all(shapes: &[Shape], bytes: &[u8]) -> Vec<(String, Differences)> {
    let mut reader = Reader(bytes);
    let found = shapes.iter().map(|shape| {
        let records: Vec<Record> = (0..reader.int()).map(|_| reader.record()).collect();
        let most = compare(shape, &records);
        println!("{}:", shape.name);
        for (of, most) in [("Bfr", most.bfr), ("deep", most.deep), ("Bfr from deep", most.bfr_from_deep)] {
            println!("  {of}: {} points, position {:.1e}, normal {:.1e}", most.points, most.position, most.normal);
        }
        (shape.name.clone(), most)
    });
    let found = found.collect();
    assert!(reader.0.is_empty(), "bytes are left");
    found
}

#[test]
fn limits_meet_bfr() {
    for (name, most) in compare_all(&own(), include_bytes!("bfr.bin")) {
        for most in [most.bfr, most.deep] {
            assert!(most.position <= 1e-6 && most.normal <= 1e-4, "{name}: {most:?}");
        }
        assert!(most.derivative <= 1e-4, "{name}: {most:?}");
    }
}

/// `OUTCROP_BFR=CAGE.obj,VALUES.bin cargo test --test surfaces limits_of_a_file -- --ignored --nocapture`
#[test]
#[ignore = "needs a file of bfr.cpp"]
fn limits_of_a_file_meet_bfr() {
    let files = std::env::var("OUTCROP_BFR").expect("OUTCROP_BFR=CAGE.obj,VALUES.bin");
    let (cage, values) = files.split_once(',').unwrap();
    let shapes = parsed(&std::fs::read_to_string(cage).unwrap(), cage);
    compare_all(&shapes, &std::fs::read(values).unwrap());
}
