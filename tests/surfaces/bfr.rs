//! Limit surfaces against OpenSubdiv 3.5's Bfr at approximation level 8: `bfr.bin` holds the values that `bfr.cpp`
//! wrote for `cages.obj`.

use super::shapes::{Shape, own, parsed};
use glam::DVec3;
use outcrop::geom::surface::cage::CageSurface;

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

/// Greatest differences of one cage: positions by its extent, normals, and derivatives by u by their length.
#[derive(Debug, Default)]
struct Differences {
    position: f64,
    normal: f64,
    derivative: f64,
}

fn compare(shape: &Shape, records: &[Record]) -> Differences {
    let surface = CageSurface::new(&shape.cage(), &shape.points).unwrap();
    let mut most = Differences::default();
    for r in records {
        let p = surface.evaluate(r.face, r.corner, r.u, r.v).unwrap();
        let position = p.position.distance(r.position) / shape.extent();
        let normal = p.normal().distance(r.du.cross(r.dv).normalize());
        let derivative = p.du.distance(r.du) / r.du.length();
        if std::env::var_os("OUTCROP_PRINT").is_some() && (position > 1e-6 || normal > 1e-4) {
            println!("  {} {} {:.3e} {:.3e}: {position:.2e} {normal:.2e} {derivative:.2e}", r.face, r.corner, r.u, r.v);
        }
        most.position = most.position.max(position);
        most.normal = most.normal.max(normal);
        most.derivative = most.derivative.max(derivative);
    }
    most
}

fn compare_all(shapes: &[Shape], bytes: &[u8]) -> Vec<(String, Differences)> {
    let mut reader = Reader(bytes);
    let found = shapes.iter().map(|shape| {
        let records: Vec<Record> = (0..reader.int()).map(|_| reader.record()).collect();
        let most = compare(shape, &records);
        println!("{}: {} points, {most:?}", shape.name, records.len());
        (shape.name.clone(), most)
    });
    let found = found.collect();
    assert!(reader.0.is_empty(), "bytes are left");
    found
}

#[test]
fn limits_meet_bfr() {
    compare_all(&own(), include_bytes!("bfr.bin"));
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
