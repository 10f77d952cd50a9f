//! Triangles read back from models: of parts, and of hits.

use crate::common::asked::ask;
use crate::common::built::{self, Built, Part, build_with, on_each_structure, options};
use crate::common::rng::Rng;
use crate::common::scenes;
use crate::common::stored;
use glam::{DAffine3, DQuat, DVec3};
use outcrop::base::error::Error;
use outcrop::base::progress::Cancel;
use outcrop::build::{BuildOptions, Splits};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, QueryOptions, StoredTriangle};
use outcrop::scene::{Context, ContextOptions, Model, Scene};
use std::collections::BTreeMap;

/// The triangles of a part, `most` at a time.
fn read(model: &Model, part: u32, most: usize) -> Vec<StoredTriangle> {
    let mut reader = model.read_part(part).expect("a reader");
    let mut all = Vec::new();
    loop {
        let some = reader.next(most, &Cancel::new()).expect("triangles");
        assert!(some.len() <= most);
        if some.is_empty() {
            assert!(reader.next(most, &Cancel::new()).expect("the end").is_empty());
            return all;
        }
        all.extend(some);
    }
}

fn open(built: &Built, memory_budget: u64) -> Model {
    let options = ContextOptions { threads: 1, memory_budget, read_ahead: false, ..ContextOptions::default() };
    Model::open(&Context::new(options).expect("a context"), &built.path).expect("a model")
}

/// Every triangle of every part comes once, with the stored corners, whatever the splits.
fn parts_come_back() {
    let soups = [scenes::scan(), scenes::cad(), scenes::slivers(), scenes::doubles(), scenes::far_from_zero()];
    for soup in &soups {
        for splits in [Splits::On, Splits::Off] {
            let parts: Vec<Part> =
                soup.tris.chunks(1700).zip(10..).map(|(tris, id)| Part::white(id, tris.to_vec())).collect();
            let (file, report) = build_with(BuildOptions { threads: 1, splits, ..options() }, |b| {
                parts.iter().for_each(|p| built::push(b, p))
            });
            let mut expected: BTreeMap<u64, [DVec3; 3]> = BTreeMap::new();
            for tree in stored::trees(&file.path) {
                let placed = |t: &[DVec3; 3]| t.map(|p| tree.origin + p);
                expected.extend(tree.tris.iter().map(|(prim, _, t)| (u64::from(*prim), placed(t))));
            }
            assert_eq!(expected.len() as u64, report.triangles_kept);
            let model = open(&file, 0);
            let mut seen = 0;
            for part in 0..model.info().parts {
                let id = model.parts().id(part as usize).expect("an id");
                for triangle in read(&model, part, 100 + 1000 * part as usize) {
                    assert_eq!(
                        (triangle.part, Some(&triangle.corners)),
                        (id, expected.get(&triangle.prim)),
                        "{}",
                        soup.name
                    );
                    assert_eq!(triangle.prim / 1700, u64::from(part));
                    assert!(triangle.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
                    seen += 1;
                }
            }
            assert_eq!(seen, report.triangles_kept, "{}", soup.name);
        }
    }
}

/// Shared meshes are placed, mirrored ones too, and a mesh that is divided into several trees comes back whole.
fn placed_and_divided_meshes_come_back() {
    let ball = scenes::sphere(12, 24);
    let place = DAffine3::from_scale_rotation_translation(
        DVec3::new(-2.0, 1.0, 1.0),
        DQuat::from_rotation_y(0.3),
        DVec3::X * 9.0,
    );
    let file = built::build(|builder| {
        let mesh = builder.shared_mesh(1).expect("a mesh");
        builder.triangles(mesh, 0, &ball, Attributes::NONE).expect("triangles");
        let direct = builder.part(PartDesc { id: Some(5), ..PartDesc::default() }).expect("a part");
        let first = builder.part(PartDesc { id: Some(6), ..PartDesc::default() }).expect("a part");
        builder.instance(mesh, place, first).expect("an instance");
        // A bolt far from a large plain: two trees.
        let bolt = |t: &[DVec3; 3]| t.map(|p| p * 1e-4 + DVec3::new(3e5, 3e5, 0.0));
        let plain: Vec<_> = scenes::plane_grid(40, 0.0).iter().map(|t| t.map(|p| p * 1e4)).collect();
        builder.triangles(MeshKey::DIRECT, direct, &plain, Attributes::NONE).expect("triangles");
        builder
            .triangles(MeshKey::DIRECT, direct, &ball.iter().map(bolt).collect::<Vec<_>>(), Attributes::NONE)
            .expect("bolt");
    });
    let model = open(&file, 0);
    let placed = read(&model, 1, 77);
    assert_eq!(placed.len(), ball.len());
    for triangle in &placed {
        let expected = ball[triangle.prim as usize].map(|p| place.transform_point3(p));
        let off = (0..3).map(|i| triangle.corners[i].distance(expected[i])).fold(0.0, f64::max);
        assert!(off < 1e-12, "{triangle:?}");
        let [a, b, c] = triangle.corners;
        let across = (b - a).cross(c - a).normalize();
        assert!(triangle.normals.iter().all(|n| n.as_dvec3().dot(across) > 0.999));
    }
    let direct = read(&model, 0, 1000);
    let mut prims: Vec<u64> = direct.iter().map(|t| t.prim).collect();
    prims.sort_unstable();
    let first = ball.len() as u64;
    assert!(prims.iter().copied().eq(first..first + direct.len() as u64), "each once");
    assert_eq!(direct.len(), 40 * 40 * 2 + ball.len());
}

/// A mesh that is placed several times with the same part has its triangles in each place, also twice in one place, and
/// also if the mesh is divided or its triangles are in several leaves.
fn a_part_in_several_places_comes_back_from_each() {
    let bolt = |t: &[DVec3; 3]| t.map(|p| p * 1e-4 + DVec3::new(3e5, 3e5, 0.0));
    let plain: Vec<_> = scenes::plane_grid(10, 0.0).iter().map(|t| t.map(|p| p * 4e4)).collect();
    let ball = scenes::sphere(8, 16);
    let divided = [&plain[..], &ball.iter().map(bolt).collect::<Vec<_>>()].concat();
    let places = [0.0, 1e3, 1e3, -2e3].map(|z| DAffine3::from_translation(DVec3::Z * z));
    for triangles in [ball, divided, scenes::slivers().tris] {
        for splits in [Splits::On, Splits::Off] {
            let (file, report) = build_with(BuildOptions { threads: 1, splits, ..options() }, |builder| {
                let mesh = builder.shared_mesh(1).expect("a mesh");
                builder.triangles(mesh, 0, &triangles, Attributes::NONE).expect("triangles");
                let part = builder.part(PartDesc::default()).expect("a part");
                places.iter().for_each(|place| builder.instance(mesh, *place, part).expect("an instance"));
            });
            let model = open(&file, 0);
            let found = read(&model, 0, 100);
            assert_eq!(found.len() as u64, 4 * report.triangles_kept);
            assert_eq!(model.parts().get(0).expect("a part").triangles, found.len() as u64);
            let mut times: BTreeMap<(u64, i64), usize> = BTreeMap::new();
            for triangle in &found {
                let from = triangles[triangle.prim as usize][0].z;
                *times.entry((triangle.prim, (triangle.corners[0].z - from).round() as i64)).or_default() += 1;
            }
            assert!(times.iter().all(|((_, z), times)| *times == if *z == 1000 { 2 } else { 1 }));
            assert_eq!(times.len() as u64, 3 * report.triangles_kept);
        }
    }
}

/// The triangle of a hit, in the world, in a budget that does not hold the model too.
fn hits_lead_to_their_triangles() {
    let parts = [Part::white(3, scenes::bumpy_sphere(60, 90, 4)), Part::white(4, scenes::boxes(300, 2))];
    let file = built::parts(&parts);
    let least = 4 << 20;
    for budget in [0, least] {
        let options =
            ContextOptions { threads: 1, memory_budget: budget, read_ahead: false, ..ContextOptions::default() };
        let context = Context::new(options).expect("a context");
        let model = Model::open(&context, &file.path).expect("a model");
        let scene = Scene::new(&context);
        let turned =
            DAffine3::from_scale_rotation_translation(DVec3::splat(3.0), DQuat::from_rotation_x(1.0), DVec3::X * 20.0);
        for (id, place) in [(7, DAffine3::IDENTITY), (8, turned)] {
            scene.add_instance(&model, id, place).expect("an instance");
        }
        scene.commit().expect("a commit");
        let mut rng = Rng::new(8);
        let rays: Vec<Ray> = (0..600)
            .map(|i| {
                let center = if i % 2 == 0 { DVec3::ZERO } else { DVec3::X * 20.0 };
                let eye = center + rng.direction() * 12.0;
                Ray::new(eye, (center + rng.direction() - eye).as_vec3())
            })
            .collect();
        let hits: Vec<Hit> = ask(&scene.state(), &rays, QueryOptions::default())
            .into_iter()
            .filter(|hit| hit.kind == HitKind::Exact)
            .collect();
        assert!(hits.len() > 200);
        let triangles = scene.state().triangles(&hits, &Cancel::new()).expect("triangles");
        let all: Vec<[DVec3; 3]> = parts.iter().flat_map(|part| part.tris.clone()).collect();
        for (hit, triangle) in hits.iter().zip(&triangles) {
            let place = if hit.instance == 7 { DAffine3::IDENTITY } else { turned };
            let expected = all[hit.prim as usize].map(|p| place.transform_point3(p.as_vec3().as_dvec3()));
            assert_eq!((triangle.part, triangle.prim), (hit.part, hit.prim));
            let off = (0..3).map(|i| triangle.corners[i].distance(expected[i])).fold(0.0, f64::max);
            assert!(off < 1e-12, "{off}");
        }
        let wrong = [
            Hit { prim: hits[0].prim ^ 1, ..hits[0] },
            Hit { part: 99, ..hits[0] },
            Hit { instance: 99, ..hits[0] },
            Hit { position: hits[0].position + 5.0, ..hits[0] },
            Hit { position: DVec3::NAN, ..hits[0] },
            Hit::MISS,
        ];
        for wrong in wrong {
            match scene.state().triangles(&[hits[1], wrong], &Cancel::new()) {
                Err(Error::BadArgument(why)) => assert!(why.contains("hit 1"), "{why}"),
                other => panic!("{other:?}"),
            }
        }
    }
}
on_each_structure!(
    parts_come_back,
    placed_and_divided_meshes_come_back,
    a_part_in_several_places_comes_back_from_each,
    hits_lead_to_their_triangles,
);

#[test]
fn parts_that_do_not_exist_are_refused() {
    let model = open(&built::parts(&[Part::white(3, scenes::sphere(4, 8))]), 0);
    assert!(matches!(model.read_part(1), Err(Error::BadArgument(why)) if why.contains('1')));
    let mut reader = model.read_part(0).expect("a reader");
    let cancel = Cancel::new();
    cancel.cancel();
    assert!(matches!(reader.next(10, &cancel), Err(Error::Cancelled)));
    assert_eq!(reader.next(10, &Cancel::new()).expect("triangles").len(), 10);
}
