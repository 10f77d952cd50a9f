//! Wrong descriptions name their fault; odd ones have a surface.

use super::super::{Boundary, Cage, CageDesc, CagePatches, Creasing, TriangleRule};
use super::shapes::{Rng, fan, tangle};
use glam::DVec3;

fn fault(desc: CageDesc, vertices: usize) -> String {
    Cage::new(&desc, vertices).unwrap_err().to_string()
}

#[test]
fn faults_are_named() {
    let quad = CageDesc { face_sizes: &[4], indices: &[0, 1, 2, 3], ..CageDesc::default() };
    assert!(Cage::new(&quad, 4).is_ok());
    let has = |desc: CageDesc, text: &str| {
        let fault = fault(desc, 4);
        assert!(fault.contains(text), "{fault}, not {text}");
    };
    has(CageDesc { face_sizes: &[2, 2], ..quad }, "face 0 has 2 corners");
    has(CageDesc { face_sizes: &[u32::MAX], ..quad }, "face 0 has 4294967295 corners");
    has(CageDesc { face_sizes: &[3], ..quad }, "have 3 corners, but 4 indices");
    has(CageDesc { face_sizes: &[4, 3], ..quad }, "face 1 ends after");
    has(CageDesc { indices: &[0, 1, 4, 3], ..quad }, "face 0: vertex 4");
    has(CageDesc { creases: &[(0, 2, 1.0)], ..quad }, "crease 0 to 2");
    has(CageDesc { creases: &[(0, 9, 1.0)], ..quad }, "crease 0 to 9");
    has(CageDesc { creases: &[(1, 0, -1.0)], ..quad }, "crease 1 to 0: sharpness -1");
    has(CageDesc { creases: &[(1, 0, f32::NAN)], ..quad }, "crease 1 to 0: sharpness NaN");
    has(CageDesc { corners: &[(4, 1.0)], ..quad }, "corner at vertex 4");
    has(CageDesc { corners: &[(3, -0.5)], ..quad }, "corner at vertex 3: sharpness -0.5");
    has(CageDesc { holes: &[1], ..quad }, "hole 1");
}

#[test]
fn too_many_faces_at_a_vertex_are_named() {
    let triangle = |i: u32| [0, 2 * i + 1, 2 * i + 2];
    let indices: Vec<u32> = (0..4097).flat_map(triangle).collect();
    let desc = CageDesc { face_sizes: &vec![3; 4097], indices: &indices, ..CageDesc::default() };
    assert!(fault(desc, 9000).contains("vertex 0 has 4097 faces"));
}

#[test]
fn counts_of_points_are_checked() {
    let shape = fan(3, 1, &mut Rng(1));
    let cage = shape.cage();
    assert!(CagePatches::new(&cage, &shape.points[1..]).is_err());
    assert!(cage.refine_points(&shape.points[1..]).is_err());
    let patches = CagePatches::new(&cage, &shape.points).unwrap();
    assert_eq!(patches.evaluate(3, 0, 0.5, 0.5).position, DVec3::ZERO);
    assert_eq!(patches.evaluate(0, 1, 0.5, 0.5).position, DVec3::ZERO);
    assert!(patches.bounds(0, 1, 0, 0, 0).is_empty());
}

#[test]
fn no_faces_are_a_cage() {
    let cage = Cage::new(&CageDesc::default(), 3).unwrap();
    assert_eq!((cage.face_count(), cage.edge_count(), cage.vertex_count()), (0, 0, 3));
    assert_eq!(cage.refine().unwrap().face_count(), 0);
    assert!(CagePatches::new(&cage, &[DVec3::ZERO; 3]).is_ok());
}

#[test]
fn tangles_have_finite_surfaces() {
    let rng = &mut Rng(7);
    for _ in 0..400 {
        let shape = tangle(rng);
        let mut desc = shape.desc();
        desc.boundary = [Boundary::None, Boundary::EdgeAndCorner, Boundary::EdgeOnly][rng.below(3) as usize];
        desc.creasing = [Creasing::Uniform, Creasing::Chaikin][rng.below(2) as usize];
        desc.triangles = [TriangleRule::CatmullClark, TriangleRule::Smooth][rng.below(2) as usize];
        let cage = Cage::new(&desc, shape.points.len()).unwrap();
        let patches = CagePatches::new(&cage, &shape.points).unwrap();
        for _ in 0..30 {
            let face = rng.below(cage.face_count() as u32);
            let corner = rng.below(cage.quads_of(face));
            let awkward = [0.0, 1.0, 0.5, f64::NAN, -1.0, 1e-300, 1.0 - f64::EPSILON, f64::INFINITY, rng.unit()];
            let (u, v) = (awkward[rng.below(9) as usize], awkward[rng.below(9) as usize]);
            let p = patches.evaluate(face, corner, u, v);
            let all = [p.position, p.du, p.dv, p.duu, p.duv, p.dvv];
            assert!(all.iter().all(|x| x.is_finite()), "{p:?}");
            assert!(p.position.abs().max_element() <= 1.0 + 1e-12, "outside of the control points: {p:?}");
            let bounds = patches.bounds(face, corner, rng.bits() as u32, rng.bits() as u32, rng.bits() as u32);
            assert!(!bounds.is_empty() && bounds.min.is_finite() && bounds.max.is_finite());
        }
        let finer = cage.refine_points(&shape.points).unwrap();
        assert!(finer.len() == cage.refine().unwrap().vertex_count());
    }
}

#[test]
fn faces_may_repeat_vertices() {
    let points: Vec<DVec3> = (0..4).map(|i| DVec3::new(f64::from(i), f64::from(i * i), 1.0)).collect();
    for indices in [[0, 1, 1, 2], [0, 1, 0, 2], [3, 3, 3, 3], [0, 1, 0, 1], [2, 2, 1, 1]] {
        let boundary = Boundary::EdgeAndCorner;
        let desc = CageDesc { face_sizes: &[4], indices: &indices, boundary, ..CageDesc::default() };
        let cage = Cage::new(&desc, 4).unwrap();
        let patches = CagePatches::new(&cage, &points).unwrap();
        for (corner, (u, v)) in indices.into_iter().zip([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]) {
            let p = patches.evaluate(0, 0, u, v);
            assert!(p.position.distance(points[corner as usize]) < 1e-12, "{indices:?}: {p:?}");
        }
    }
}

/// Random numbers for all arguments: an error or a cage, and no panic.
#[test]
fn random_descriptions_do_not_panic() {
    let rng = &mut Rng(8);
    let mut made = 0;
    for _ in 0..3_000 {
        let few = |rng: &mut Rng| rng.below(7);
        let sizes: Vec<u32> = (0..few(rng)).map(|_| 3 + rng.below(3) - rng.below(40) / 39).collect();
        let corners = sizes.iter().sum::<u32>() as usize + usize::from(rng.below(30) == 0);
        let indices: Vec<u32> = (0..corners).map(|_| rng.below(14)).collect();
        let sharp = |rng: &mut Rng| [0.5, 1.0, 10.0, 3.0, -1.0][rng.below(60).min(4) as usize % 5];
        let creases: Vec<(u32, u32, f32)> = (0..few(rng) / 5).map(|_| (few(rng), few(rng), sharp(rng))).collect();
        let desc = CageDesc { face_sizes: &sizes, indices: &indices, creases: &creases, ..CageDesc::default() };
        let Ok(cage) = Cage::new(&desc, 12 + rng.below(3) as usize) else { continue };
        made += 1;
        let points: Vec<DVec3> = (0..cage.vertex_count()).map(|_| rng.vector()).collect();
        let patches = CagePatches::new(&cage, &points).unwrap();
        (0..cage.face_count() as u32).for_each(|face| assert!(patches.evaluate(face, 0, 0.3, 0.2).du.is_finite()));
    }
    assert!(made > 100, "only {made} of the random cages were accepted");
}
