//! Measures nearest points of points near the surface and all around, and distances of two sets (`apart.rs`), beside
//! peers which get the same triangles. All work in the calling thread, in whose CPU time they are measured. Distances
//! are compared with those in double precision.

pub mod apart;
mod rivals;
mod truth;

use crate::common::bvh64::Bvh64;
use crate::common::rng::Rng;
use crate::common::rounding::point_distance;
use crate::common::scenes::has_area;
use crate::data::Residency;
use crate::expected::Expected;
use crate::failure::Failure;
use crate::ours::Ours;
use crate::pairs::{Clock, Pairs, Spread, steady};
use crate::record::{Against, Near, Outcomes, Record};
use crate::scenes::Mesh;
use crate::trace::Task;
use glam::{DVec3, Vec3};
use outcrop::query::{NearestOptions, NearestPoint};
use outcrop::scene::SceneState;
use rivals::rivals;
use std::fmt::Write;
use std::sync::Arc;

/// One point in so many is also compared with every triangle.
const SAMPLE: usize = 500;

/// In diagonals of the model; an answer that is farther off is called wrong.
const FAR_OFF: f64 = 1e-6;

/// Rounding of the distances in double precision that all others are compared with, in diagonals.
const ROUNDING: f64 = 1e-12;

/// A kind of points.
#[derive(Clone, Copy)]
enum Kind {
    /// Within a hundredth of the diagonal of points spread evenly over the surface.
    Surface,
    /// Spread evenly over a box of 1.5 times the model's sides about its middle.
    Space,
}

impl Kind {
    const ALL: [Self; 2] = [Self::Surface, Self::Space];

    fn name(self) -> &'static str {
        match self {
            Kind::Surface => "near the surface",
            Kind::Space => "in a box",
        }
    }

    /// Points in single precision, which is all that peers take.
    fn points(self, surface: &Surface, count: usize) -> Vec<DVec3> {
        let mut rng = Rng::new(self as u64 + 1);
        let Surface { corners, bounds: [min, max], .. } = surface;
        let area = |[a, b, c]: &[DVec3; 3]| (*b - *a).cross(*c - *a).length();
        let mut areas: Vec<f64> = corners.iter().map(area).collect();
        let mut sum = 0.0;
        areas.iter_mut().for_each(|area| {
            sum += *area;
            *area = sum;
        });
        let mut point = || match self {
            Kind::Space => {
                let (middle, half) = ((*min + *max) * 0.5, (*max - *min) * 0.75);
                rng.inside(middle - half, middle + half)
            }
            Kind::Surface => {
                let at = rng.unit() * sum;
                let [a, b, c] = corners[areas.partition_point(|&area| area <= at).min(corners.len() - 1)];
                let (u, v) = (rng.unit(), rng.unit());
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let off = rng.direction() * (0.01 * surface.diagonal * rng.unit());
                a + (b - a) * u + (c - a) * v + off
            }
        };
        (0..count).map(|_| point().as_vec3().as_dvec3()).collect()
    }
}

/// The triangles of a scene that have an area: builds leave the others out.
struct Surface {
    mesh: Arc<Mesh>,
    corners: Vec<[DVec3; 3]>,
    bounds: [DVec3; 2],
    diagonal: f64,
}

impl Surface {
    fn of(mesh: &Mesh) -> Self {
        let has_area = |i: &usize| has_area(&mesh.corners(*i));
        let kept: Vec<usize> = (0..mesh.triangles.len()).filter(has_area).collect();
        let triangles = kept.iter().map(|&i| mesh.triangles[i]).collect();
        let corners: Vec<[DVec3; 3]> = kept.iter().map(|&i| mesh.corners(i)).collect();
        let bounds = truth::bounds(&corners);
        let mesh = Mesh { vertices: mesh.vertices.clone(), triangles, parts: Vec::new() };
        Self { mesh: Arc::new(mesh), corners, bounds, diagonal: bounds[0].distance(bounds[1]) }
    }

    /// How far distances are off the exact ones: the greatest error in diagonals, and the number of wrong answers.
    fn off(&self, exact: &[f64], found: impl Iterator<Item = f64>) -> (f64, usize) {
        let errors: Vec<f64> = exact.iter().zip(found).map(|(a, b)| (a - b).abs() / self.diagonal).collect();
        (errors.iter().copied().fold(0.0, f64::max), errors.iter().filter(|&&error| error > FAR_OFF).count())
    }
}

fn ask(state: &SceneState, points: &[DVec3], out: &mut [NearestPoint]) -> Result<(), Failure> {
    Ok(state.nearest(points, &NearestOptions::default(), out)?)
}

/// The exact distances of points from a surface. A tree finds them; of a sample every triangle is looked at.
fn exact(surface: &Surface, tree: &Bvh64, points: &[DVec3]) -> Result<Vec<f64>, Failure> {
    let distances: Vec<f64> = points.iter().map(|&p| tree.distance(p, f64::INFINITY)).collect();
    for (&p, &distance) in points.iter().zip(&distances).step_by(SAMPLE) {
        let least = surface.corners.iter().map(|tri| point_distance(p, tri)).fold(f64::INFINITY, f64::min);
        if least != distance {
            return Err(Failure::new(format!("the tree in doubles is wrong: {distance} of {p}, and not {least}")));
        }
    }
    Ok(distances)
}

/// Fails unless each answer is the exact one up to the error that it states, and of the triangle that it names.
fn check(mesh: &Mesh, surface: &Surface, points: &[DVec3], exact: &[f64], out: &[NearestPoint]) -> Result<(), Failure> {
    for ((&p, &exact), answer) in points.iter().zip(exact).zip(out) {
        let room = answer.error + ROUNDING * (surface.diagonal + p.length());
        let of_prim = point_distance(p, &mesh.corners(answer.prim as usize));
        let position = answer.position.distance(p);
        if [answer.distance, of_prim, position].iter().any(|distance| (distance - exact).abs() > room) {
            let all = format!("{}, of its triangle {of_prim}, of its position {position}", answer.distance);
            return Err(Failure::new(format!("wrong answers: at {p} {all}, and not {exact} up to {room:e}")));
        }
    }
    Ok(())
}

/// Of every member of each answer.
fn expected(out: &[NearestPoint]) -> Expected {
    let of = |answer: &NearestPoint| -> Vec<u8> {
        let [x, y, z] = answer.position.to_array();
        let doubles = [answer.distance, answer.error, x, y, z].map(f64::to_bits);
        let ids = [answer.instance, answer.part, answer.prim, answer.kind as u64, u64::from(answer.holds)];
        doubles.into_iter().chain(ids).flat_map(u64::to_le_bytes).collect()
    };
    Expected::of_bytes(out.len(), &out.iter().flat_map(of).collect::<Vec<u8>>())
}

/// A benchmark on one scene.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let row = task.data.structure(&task.benchmark.structures[0]);
    let (stored, mesh) = (task.scene.model(row)?, task.scene.mesh()?);
    let ours = Ours::open(&stored, Residency::All, 0)?;
    let surface = Surface::of(&mesh);
    let tree = Bvh64::new(surface.corners.clone());
    let mut records = Vec::new();
    for kind in Kind::ALL {
        let points = kind.points(&surface, task.benchmark.points);
        let exact = exact(&surface, &tree, &points)?;
        let mut out = vec![NearestPoint::MISS; points.len()];
        ask(&ours.state, &points, &mut out)?;
        check(&mesh, &surface, &points, &exact, &out)?;
        let name = format!("{}/{}/{}", task.benchmark.name, task.scene.row.name, kind.name());
        task.book.check(&name, expected(&out))?;
        if task.is_only_expecting {
            continue;
        }
        let singles: Vec<Vec3> = points.iter().map(|p| p.as_vec3()).collect();
        let (worst, wrong) = surface.off(&exact, out.iter().map(|answer| answer.distance));
        let (side, asked, count) = (task.benchmark.structures[0].clone(), kind.name().to_owned(), points.len());
        let mine = Near { side, asked, count, worst, wrong, ..Near::default() };
        let mut once = || steady(|| timed(|| ask(&ours.state, &points, &mut out).expect("it did before")));
        for peer in &task.benchmark.peers {
            let mut all: Vec<Theirs<[Vec3]>> = Vec::new();
            for rival in rivals(peer, &surface) {
                let mut found = vec![0.0; points.len()];
                rival.distances(&singles, &mut found);
                let (worst, wrong) = surface.off(&exact, found.iter().map(|&distance| f64::from(distance)));
                all.push(Theirs {
                    call: rival.name(),
                    worst,
                    wrong,
                    once: Box::new(move |singles: &[Vec3]| timed(|| rival.distances(singles, &mut found))),
                });
            }
            add(task, &name, surface.corners.len(), (&mine, &mut once), (peer, all, &singles), &mut records);
        }
    }
    Ok(records)
}

/// A peer's way of answering, how far its answers are off, and a run of it.
struct Theirs<'a, T: ?Sized> {
    call: String,
    worst: f64,
    wrong: usize,
    once: Box<dyn FnMut(&T) -> f64 + 'a>,
}

/// Seconds of this thread.
fn timed(work: impl FnOnce()) -> f64 {
    let begun = Clock::Thread.now();
    work();
    Clock::Thread.now() - begun
}

/// Records of all ways of a peer, and of outcrop in turn with the fastest of them.
fn add<T: ?Sized>(
    task: &Task,
    name: &str,
    triangles: usize,
    (mine, once): (&Near, &mut dyn FnMut() -> f64),
    (peer, mut all, asked): (&str, Vec<Theirs<T>>, &T),
    records: &mut Vec<Record>,
) {
    let mut add = |key: &str, found: Near| {
        eprintln!("{name}/{key}: {}", line(&found));
        records.push(task.record(format!("{name}/{key}"), triangles as u64, Outcomes::Nearest(found)));
    };
    let mut fastest: Option<(f64, usize)> = None;
    for (i, theirs) in all.iter_mut().enumerate() {
        let seconds = steady(|| (theirs.once)(asked));
        let Theirs { call, worst, wrong, .. } = theirs;
        let (seconds_all, side, is_peer) = (Spread::of(&[seconds]), peer.to_owned(), true);
        let (call, worst, wrong) = (call.clone(), *worst, *wrong);
        let found = Near { side, is_peer, call: call.clone(), seconds: seconds_all, worst, wrong, ..mine.clone() };
        add(&call, found);
        if fastest.is_none_or(|(least, _)| seconds < least) {
            fastest = Some((seconds, i));
        }
    }
    let Some((_, i)) = fastest else { return };
    let theirs = &mut all[i];
    let pairs = Pairs::in_turn(task.benchmark.rounds, once, || steady(|| (theirs.once)(asked)));
    let (side, call) = (peer.to_owned(), theirs.call.clone());
    let against = Some(Against { side, call, seconds: Spread::of(&pairs.b), ratio: pairs.ratio() });
    add(&format!("{} beside {peer}", mine.side), Near { seconds: Spread::of(&pairs.a), against, ..mine.clone() });
}

/// Microseconds for each answer.
fn each(found: &Near, seconds: &Spread) -> f64 {
    seconds.median * 1e6 / found.count as f64
}

/// A search on a line.
fn line(found: &Near) -> String {
    let mut text = format!("{:.3} µs each", each(found, &found.seconds));
    if let Some(a) = &found.against {
        let Spread { median, least, most } = a.ratio;
        let _ = write!(text, ", {median:.2} [{least:.2} .. {most:.2}] x of {}", a.call);
    }
    let _ = write!(text, ", greatest error {:.1e} diagonals, {} wrong", found.worst, found.wrong);
    text
}

/// All searches among the records in Markdown, a table a scene; empty if there are none.
pub fn table(records: &[Record]) -> String {
    let mut text = String::new();
    let mut last = None;
    for record in records {
        let Outcomes::Nearest(found) = &record.result else { continue };
        if last != Some((&record.benchmark, &record.scene)) {
            last = Some((&record.benchmark, &record.scene));
            let _ = write!(text, "\n{}, {} ({} triangles)\n\n", record.benchmark, record.title, record.triangles);
            let head = "| asked | side | µs each | times as fast | greatest error, diagonals | wrong |";
            let _ = writeln!(text, "{head}\n|---|---|---|---|---|---|");
        }
        let (us, side) = (each(found, &found.seconds), if found.is_peer { &found.call } else { &found.side });
        let Near { asked, worst, wrong, against, .. } = found;
        let ratio = against.as_ref().map_or_else(
            || "-".to_owned(),
            |a| format!("{:.2} of {} ({:.3} µs)", a.ratio.median, a.call, each(found, &a.seconds)),
        );
        let _ = writeln!(text, "| {asked} | {side} | {us:.3} | {ratio} | {worst:.1e} | {wrong} |");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::scenes::{blocks, rounded};
    use crate::data::PEERS;

    fn surface() -> Surface {
        let flat = [[DVec3::ZERO, DVec3::X, DVec3::X * 2.0]];
        Surface::of(&Mesh::of(blocks(3, 1).into_iter().chain(flat).map(|tri| (1, tri.map(rounded)))))
    }

    #[test]
    fn peers_find_the_distances_of_brute_force() {
        let surface = surface();
        let with_area = (blocks(3, 1).len(), surface.mesh.triangles.len());
        assert_eq!((surface.corners.len(), surface.corners.len()), with_area);
        let tree = Bvh64::new(surface.corners.clone());
        let mut asked = 0;
        for kind in Kind::ALL {
            let points = kind.points(&surface, 1000);
            let exact = exact(&surface, &tree, &points).expect("equal distances");
            let singles: Vec<Vec3> = points.iter().map(|p| p.as_vec3()).collect();
            for rival in PEERS.iter().flat_map(|peer| rivals(peer, &surface)) {
                let mut found = vec![0.0; points.len()];
                rival.distances(&singles, &mut found);
                let (worst, wrong) = surface.off(&exact, found.iter().map(|&distance| f64::from(distance)));
                assert!(wrong == 0 && worst < FAR_OFF, "{}: {worst:e}", rival.name());
                asked += 1;
            }
        }
        assert!(asked >= 4, "parry3d is always here");
    }

    #[test]
    fn answers_that_are_wrong_in_any_way_are_told() {
        let surface = surface();
        let (p, prim) = (DVec3::splat(-1.0), 0);
        let exact = point_distance(p, &surface.corners[0]);
        let near = outcrop::geom::distances::point_triangle(p, &surface.corners[0]);
        let right = NearestPoint { distance: exact, position: near.point, prim, ..NearestPoint::MISS };
        let told = |answer| check(&surface.mesh, &surface, &[p], &[exact], &[answer]);
        told(right).expect("a right answer");
        let last = surface.corners.len() as u64 - 1;
        let wrong = [
            NearestPoint { distance: exact * 1.000001, ..right },
            NearestPoint { position: near.point * 1.1, ..right },
            NearestPoint { prim: last, ..right },
        ];
        for answer in wrong {
            assert!(told(answer).expect_err("a wrong answer").to_string().contains("wrong answers"));
            assert_ne!(expected(&[answer]), expected(&[right]));
        }
        assert_eq!(surface.off(&[1.0, 1.0], [1.0, 1.0 + surface.diagonal].into_iter()), (1.0, 1));
    }
}
