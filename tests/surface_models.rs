//! The shared models of parametric surfaces.

use crate::common::models::find;
use glam::DVec3;
use outcrop::base::progress::Cancel;
use outcrop::geom::surface::nurbs::Nurbs;
use outcrop::import::surfaces::{SurfaceData, bpt, trimmed_nurbs};
use outcrop::math::DBounds;

#[test]
fn the_teapot_is_32_patches() {
    let Some(path) = find("nurbs/teapot.bpt") else { return };
    let bytes = std::fs::read(&path).expect("the teapot");
    let read = bpt::parse(&bytes, &path, &Cancel::new()).expect("the teapot");
    assert_eq!(read.len(), 32);
    let surfaces: Vec<_> = read.iter().map(|s| Nurbs::new(&s.desc()).expect("a patch")).collect();
    let bounds = surfaces.iter().fold(DBounds::EMPTY, |all, s| all.union(s.piece([0, 0]).bounds()));
    // The height that Newell gave it.
    assert!((bounds.extent().z - 3.15).abs() < 1e-9 && bounds.min.z.abs() < 1e-9, "{bounds:?}");
    // The top of the knob and the middle of the bottom are collapsed edges.
    let poles = surfaces.iter().filter(|s| s.evaluate(0.0, 0.3).normal() == DVec3::ZERO);
    assert_eq!(poles.map(|s| s.normal_limit(0.0, 0.3).z.abs()).filter(|z| (z - 1.0).abs() < 1e-12).count(), 8);
}

#[test]
fn cad_models_are_read() {
    for (name, [whole, parts, trimmed]) in
        [("NIST_MBE_PMI_1", [36, 51, 26]), ("as1-oc-214", [110, 0, 50]), ("hammer", [0, 22, 23])]
    {
        let Some(path) = find(&format!("nurbs/{name}.trimmed_nurbs.json")) else { continue };
        let bytes = std::fs::read(&path).expect("a model");
        let read = trimmed_nurbs::parse(&bytes, &path, &Cancel::new()).expect("a model");
        let is_whole = |s: &&SurfaceData| Nurbs::new(&s.desc()).expect("a surface").domain() == s.domain;
        let found = read.surfaces.iter().filter(is_whole).count();
        assert_eq!([found, read.surfaces.len() - found, read.trimmed.len()], [whole, parts, trimmed], "{name}");
    }
}
