//! Measures distances of two sets: of a model and its turned copy beside it.

use super::rivals::mesh as parry_mesh;
use super::{ROUNDING, Surface, Theirs, add, timed, truth};
use crate::data::Residency;
use crate::expected::Expected;
use crate::failure::Failure;
use crate::ours::Ours;
use crate::pairs::steady;
use crate::record::{Near, Record};
use crate::scenes::Mesh;
use crate::trace::Task;
use glam::{DAffine3, DVec3};
use outcrop::query::{DistanceOptions, PartSet, SetDistance};
use outcrop::scene::SceneState;
use parry3d::math::Pose;
use parry3d::query::distance;
use parry3d::shape::TriMesh;

/// The place of a copy, turned about the vertical through the middle, whose box is `gap` beside the model's along x.
fn beside(surface: &Surface, turn: f64, gap: f64) -> DAffine3 {
    let [min, max] = surface.bounds;
    let middle = (min + max) * 0.5;
    let about = DAffine3::from_translation;
    let turned = about(middle) * DAffine3::from_rotation_z(turn) * about(-middle);
    let least = surface.corners.as_flattened().iter().map(|&v| turned.transform_point3(v).x);
    about(DVec3::X * (max.x + gap - least.fold(f64::INFINITY, f64::min))) * turned
}

/// The distance of the first two instances.
fn ask(state: &SceneState) -> Result<SetDistance, Failure> {
    let of = |instance| {
        let mut set = PartSet::default();
        set.add_instance(instance);
        set
    };
    let options = DistanceOptions { a: of(1), b: Some(of(2)), ..DistanceOptions::default() };
    state.distance(&options)?.ok_or_else(|| Failure::new("wrong answers: no distance of two instances"))
}

/// Of every member.
fn expected(found: &SetDistance) -> Expected {
    let points = found.points.map(|p| p.to_array());
    let doubles = points.as_flattened().iter().copied().chain([found.distance, found.error]).map(f64::to_bits);
    let ids = [found.instances, found.parts, found.prims];
    let bytes: Vec<u8> = doubles.chain(ids.as_flattened().iter().copied()).flat_map(u64::to_le_bytes).collect();
    Expected::of_bytes(1, &bytes)
}

/// Two meshes of a peer.
type Meshes = [TriMesh; 2];

/// A benchmark on one scene.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let row = task.data.structure(&task.benchmark.structures[0]);
    let (mut stored, mesh) = (task.scene.model(row)?, task.scene.mesh()?);
    let surface = Surface::of(&mesh);
    let mut records = Vec::new();
    for &gap in &task.benchmark.gaps {
        let place = beside(&surface, task.benchmark.turn.unwrap_or(0.0), gap * surface.diagonal);
        stored.places = vec![DAffine3::IDENTITY, place];
        let ours = Ours::open(&stored, Residency::All, 0)?;
        let found = ask(&ours.state)?;
        let asked = format!("gap {gap}");
        let name = format!("{}/{}/{asked}", task.benchmark.name, task.scene.row.name);
        let exact = exact(&surface, place, &found)?;
        task.book.check(&name, expected(&found))?;
        if task.is_only_expecting {
            continue;
        }
        let (worst, wrong) = surface.off(&[exact], [found.distance].into_iter());
        let side = task.benchmark.structures[0].clone();
        let mine = Near { side, asked, count: 1, worst, wrong, ..Near::default() };
        let mut once = || {
            let once = || {
                std::hint::black_box(ask(&ours.state).expect("it did before"));
            };
            steady(|| timed(once))
        };
        for peer in task.benchmark.peers.iter().filter(|peer| *peer == "parry3d") {
            let placed = |v: &[f32; 3]| place.transform_point3(glam::Vec3::from(*v).as_dvec3()).as_vec3().to_array();
            let copy = Mesh { vertices: surface.mesh.vertices.iter().map(placed).collect(), ..(*surface.mesh).clone() };
            let meshes = [parry_mesh(&surface.mesh), parry_mesh(&copy)];
            let (worst, wrong) = surface.off(&[exact], [theirs(&meshes)].into_iter());
            let run = |meshes: &Meshes| {
                let once = || {
                    std::hint::black_box(theirs(meshes));
                };
                timed(once)
            };
            let all = vec![Theirs { call: "parry3d 0.31, distance".into(), worst, wrong, once: Box::new(run) }];
            add(task, &name, 2 * surface.corners.len(), (&mine, &mut once), (peer, all, &meshes), &mut records);
        }
    }
    Ok(records)
}

fn theirs([a, b]: &Meshes) -> f64 {
    let found = distance(&Pose::IDENTITY, a, &Pose::IDENTITY, b).expect("meshes have a distance");
    f64::from(found.distance)
}

/// The exact distance, if what was found is that up to the error that it states; otherwise fails.
fn exact(surface: &Surface, place: DAffine3, found: &SetDistance) -> Result<f64, Failure> {
    let copy = |tri: &[DVec3; 3]| tri.map(|v| place.transform_point3(v));
    let (mut a, mut b) = (surface.corners.clone(), surface.corners.iter().map(copy).collect::<Vec<_>>());
    let room = found.error + ROUNDING * surface.diagonal;
    // Above what was found, so that a pair at that distance is seen.
    let none = found.distance + 2.0 * room;
    let mut least = none;
    truth::lower(&mut a, &mut b, &mut least);
    let between = found.points[0].distance(found.points[1]);
    if least == none || (least - found.distance).abs() > room || (between - found.distance).abs() > room {
        let all = format!("{}, of its points {between}", found.distance);
        return Err(Failure::new(format!("wrong answers: a distance of {all}, and not {least} up to {room:e}")));
    }
    Ok(least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::scenes::bumpy_sphere;

    #[test]
    fn a_copy_is_beside_the_model_and_wrong_distances_are_told() {
        let surface = Surface::of(&Mesh::of(bumpy_sphere(12, 16, 3).into_iter().map(|tri| (1, tri))));
        let place = beside(&surface, 0.7, 0.25);
        let copy: Vec<[DVec3; 3]> = surface.corners.iter().map(|tri| tri.map(|v| place.transform_point3(v))).collect();
        assert!((truth::bounds(&copy)[0].x - surface.bounds[1].x - 0.25).abs() < 1e-12);
        let pair = |a: &[DVec3; 3], b: &[DVec3; 3]| outcrop::geom::distances::triangle_triangle(a, b);
        let all = surface.corners.iter().flat_map(|a| copy.iter().map(move |b| pair(a, b)));
        let least = all.min_by(|a, b| a.squared.total_cmp(&b.squared)).expect("pairs");
        let right = SetDistance {
            distance: least.squared.sqrt(),
            error: 0.0,
            points: least.points,
            instances: [1, 2],
            parts: [0; 2],
            prims: [0; 2],
        };
        assert!(exact(&surface, place, &right).is_ok());
        for times in [0.99, 1.01] {
            let wrong = SetDistance { distance: right.distance * times, ..right };
            assert!(exact(&surface, place, &wrong).is_err());
            assert_ne!(expected(&wrong), expected(&right));
        }
        let wrong = SetDistance { points: [least.points[1]; 2], ..right };
        assert!(exact(&surface, place, &wrong).is_err());
    }
}
