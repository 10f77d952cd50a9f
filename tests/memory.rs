//! The memory that a model takes in trace form, nodes and triangles together: a promise of the README's.

use crate::common::built;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::scene::Model;
use std::sync::Arc;

/// Embree takes 84 bytes a triangle of this surface, 52 with its compact scenes.
const MOST_BYTES_A_TRIANGLE: f64 = 40.0;

#[test]
fn a_mandelbulb_takes_forty_bytes_a_triangle_at_most() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("bulb.oc");
    let mut builder =
        Builder::new(BuildOptions::default(), Arc::new(Progress::default()), Cancel::new()).expect("a builder");
    let options = GenerateOptions { triangles: 300_000, seed: 0, ..Default::default() };
    generate("mandelbulb", &options, &Cancel::new(), &mut builder).expect("a bulb");
    let report = builder.finish(&path).expect("a build");
    assert!(report.triangles_kept > 290_000);
    let model = Model::open(&built::context(2), &path).expect("a model");
    let memory = model.memory();
    assert_eq!(memory.geometry, report.bytes_trace, "the build says what opening will take");
    for (what, bytes) in [("trace forms", memory.geometry), ("slots", memory.resident)] {
        let each = bytes as f64 / report.triangles_kept as f64;
        println!("{what}: {each:.2} bytes a triangle");
        assert!(each <= MOST_BYTES_A_TRIANGLE, "{what}: {each:.2} bytes a triangle");
    }
}
