//! Commits: all instances added, and edits of a committed scene, beside Embree's instances.

use super::forest::{Edit, Forest, affine};
use super::side_of;
use crate::expected::Expected;
use crate::failure::Failure;
use crate::pairs::{Clock, Pairs, Spread, steady};
use crate::peers::embree_calls::{Options, Scene as EmbreeScene, resident};
use crate::placed::Placed;
use crate::record::{Against, Many, Outcomes, Record};
use crate::trace::Task;
use outcrop::scene::{Context, Instances, Look, Model, Place, Scene, Transforms};
use std::sync::Arc;

/// The id of the first instance.
const FIRST: u64 = 1;

/// What Embree's scenes of instances are built with; the faster one is measured.
const QUALITIES: [(&str, i32); 2] = [("low", 0), ("medium", 1)];

/// Seconds of all threads.
fn timed(work: impl FnOnce()) -> f64 {
    let begun = Clock::Process.now();
    work();
    Clock::Process.now() - begun
}

/// A side whose scene is committed and edited.
trait Side {
    /// Adds all instances to a new scene, and commits it; seconds.
    fn commit(&mut self) -> f64;
    /// Edits the committed scene, or undoes what it did last, and commits it; seconds. `None`: it has no such edit.
    fn edit(&mut self, edit: Edit) -> Option<f64>;
    /// Bytes that it counts itself.
    fn bytes(&self) -> u64;
}

/// outcrop's scene.
pub struct Mine<'a> {
    context: &'a Context,
    model: &'a Model,
    forest: &'a Forest,
    scene: Scene,
    is_edited: bool,
}

impl<'a> Mine<'a> {
    /// The forest, committed.
    pub fn new(context: &'a Context, model: &'a Model, forest: &'a Forest) -> Self {
        let mut mine = Self { context, model, forest, scene: Scene::new(context), is_edited: false };
        mine.commit();
        mine
    }

    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Edits the scene, and commits it.
    pub fn edited(mut self, edit: Edit) -> Self {
        self.edit(edit);
        self
    }
}

/// The scene of a forest, not committed.
fn planted(context: &Context, model: &Model, places: &Arc<[Place]>) -> Scene {
    let scene = Scene::new(context);
    let transforms = Transforms::Places(Arc::clone(places));
    let (prototypes, prototype_of) = (vec![model.clone()].into(), Arc::new([]));
    let instances =
        Instances { prototypes, prototype_of, transforms, first_id: FIRST, mask: u32::MAX, masks: None, tints: None };
    scene.add_instances(&instances).expect("places are not singular, and there is memory");
    scene
}

impl Side for Mine<'_> {
    fn commit(&mut self) -> f64 {
        // The old one gives back its memory first.
        (self.scene, self.is_edited) = (Scene::new(self.context), false);
        timed(|| {
            self.scene = planted(self.context, self.model, &self.forest.places);
            self.scene.commit().expect("there is memory");
        })
    }

    fn edit(&mut self, edit: Edit) -> Option<f64> {
        let moved = self.forest.moved(edit, self.is_edited);
        self.is_edited = !self.is_edited;
        let look = Look { selected: self.is_edited, ..Look::default() };
        Some(timed(|| {
            for (i, place) in moved {
                let transforms = Transforms::Places([place].into());
                self.scene.set_transforms(FIRST + i as u64, &transforms).expect("a place of an instance");
            }
            if edit == Edit::Highlight {
                self.scene.set_instance_look(FIRST + self.forest.middle() as u64, look).expect("an instance");
            }
            self.scene.commit().expect("there is memory");
        }))
    }

    fn bytes(&self) -> u64 {
        self.context.memory_used()
    }
}

/// Embree's scene of two levels.
struct Theirs<'a> {
    scene: EmbreeScene,
    options: Options,
    forest: &'a Forest,
    placed: &'a Placed,
    is_edited: bool,
}

impl Side for Theirs<'_> {
    fn commit(&mut self) -> f64 {
        self.scene.clear();
        self.is_edited = false;
        timed(|| self.scene.place(&self.placed.places, self.options))
    }

    fn edit(&mut self, edit: Edit) -> Option<f64> {
        let moved = self.forest.moved(edit, self.is_edited).into_iter();
        let moved: Vec<_> = moved.map(|(i, place)| (i, affine(&place))).collect();
        self.is_edited = !self.is_edited;
        // Looks are the caller's business.
        (edit != Edit::Highlight).then(|| timed(|| self.scene.shift(&moved)))
    }

    fn bytes(&self) -> u64 {
        self.scene.bytes()
    }
}

/// Commits once; bytes an instance: by the side's own count, and by which resident memory grew.
fn grown(side: &mut dyn Side, count: usize) -> [f64; 2] {
    let before = (side.bytes(), resident());
    side.commit();
    let own = side.bytes() as f64 - before.0 as f64;
    let grew = before.1.zip(resident()).map_or(f64::NAN, |(before, now)| now as f64 - before as f64);
    [own, grew].map(|bytes| bytes / count as f64)
}

/// Records of a commit of all, and of edits.
pub fn measure(task: &mut Task, context: &Context, model: &Model, forest: &Forest) -> Result<Vec<Record>, Failure> {
    let empty = Forest::new(1);
    let count = forest.places.len();
    let mut mine = Mine::new(context, model, &empty);
    mine.forest = forest;
    let one = mine.bytes();
    let bytes = grown(&mut mine, count);
    // The budget counts the same bytes on every machine.
    let name = format!("{}/{}", task.benchmark.name, task.scene.row.name);
    task.book.check(&format!("{name}/commit"), Expected::of_hash(count, mine.bytes() - one))?;
    if task.is_only_expecting {
        return Ok(Vec::new());
    }
    let side = side_of(task);
    let of_mine = Many { side, asked: "commit".into(), instances: count, bytes: Some(bytes), ..Many::default() };
    let mut records = Vec::new();
    let mesh = Arc::new(task.scene.mesh()?);
    let placed = forest.placed(&mesh);
    let mut rival =
        task.benchmark.peers.iter().any(|peer| peer == "embree").then(|| fastest(forest, &placed)).flatten();
    let mut add = |found: Many| {
        let key = format!("{name}/{}/{}", found.asked, found.side);
        records.push(task.record(key, (count * mesh.triangles.len()) as u64, Outcomes::Many(Box::new(found))));
    };
    let rounds = task.benchmark.rounds;
    let (seconds, against) = match &mut rival {
        Some((call, theirs)) => {
            let bytes = Some(grown(theirs, count));
            let pairs = Pairs::in_turn(rounds, || mine.commit(), || theirs.commit());
            let (side, seconds) = ("embree".to_owned(), Spread::of(&pairs.b));
            let (call, is_peer) = (call.clone(), true);
            let against = Against { side: side.clone(), call: call.clone(), seconds, ratio: pairs.ratio() };
            add(Many { side, is_peer, call, seconds, bytes, of_commit: Some(1.0), ..of_mine.clone() });
            (Spread::of(&pairs.a), Some(against))
        }
        None => (Spread::of(&(0..rounds).map(|_| mine.commit()).collect::<Vec<_>>()), None),
    };
    add(Many { seconds, against: against.clone(), of_commit: Some(1.0), ..of_mine.clone() });
    let theirs_whole = against.map(|against| against.seconds.median);
    for edit in Edit::ALL {
        let of_mine = Many { asked: edit.name().into(), bytes: None, ..of_mine.clone() };
        let mut once = || steady(|| mine.edit(edit).expect("outcrop has all edits"));
        let is_of_both = edit != Edit::Highlight;
        let (edited, against) = match &mut rival {
            Some((call, theirs)) if is_of_both => {
                let pairs = Pairs::in_turn(rounds, once, || theirs.edit(edit).expect("Embree moves instances"));
                let (side, seconds) = ("embree".to_owned(), Spread::of(&pairs.b));
                let (call, of_commit) = (call.clone(), theirs_whole.map(|whole| seconds.median / whole));
                let against = Against { side: side.clone(), call: call.clone(), seconds, ratio: pairs.ratio() };
                add(Many { side, is_peer: true, call, seconds, of_commit, ..of_mine.clone() });
                (Spread::of(&pairs.a), Some(against))
            }
            _ => (Spread::of(&(0..rounds).map(|_| once()).collect::<Vec<_>>()), None),
        };
        add(Many { seconds: edited, against, of_commit: Some(edited.median / seconds.median), ..of_mine });
    }
    Ok(records)
}

/// Embree in the quality that commits faster, of two commits each.
fn fastest<'a>(forest: &'a Forest, placed: &'a Placed) -> Option<(String, Theirs<'a>)> {
    let side = |(quality, number): (&str, i32)| {
        let options = Options { quality: number, is_compact: false, threads: 1 };
        let scene = match EmbreeScene::of_meshes(&placed.meshes, options) {
            Ok(scene) => scene,
            Err(why) => {
                eprintln!("skipped: Embree ({why}; Debian's package is libembree-dev)");
                return None;
            }
        };
        let call = format!("Embree {}, single instances, {quality}", scene.version());
        let mut theirs = Theirs { scene, options, forest, placed, is_edited: false };
        let seconds = theirs.commit().min(theirs.commit());
        theirs.scene.clear();
        Some((seconds, call, theirs))
    };
    let all = QUALITIES.into_iter().filter_map(side);
    all.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, call, theirs)| (call, theirs))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peers::embree_calls::{Context, NONE, RtcHit, RtcRay, RtcRayHit};
    use crate::scenes::Mesh;
    use glam::DVec3;

    /// A small square around the foot, seen from above each place.
    #[test]
    fn embree_moves_the_instances_that_an_edit_moves() {
        let at = |x: f64, y: f64| DVec3::new(0.2 * x, 0.2 * y, 0.0);
        let square = [[at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0)], [at(-1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)]];
        let mesh = Arc::new(Mesh::of(square.into_iter().map(|tri| (0, tri))));
        let forest = Forest::new(300);
        let placed = forest.placed(&mesh);
        let Some((call, mut theirs)) = fastest(&forest, &placed) else { return };
        assert!(call.contains("single instances"), "{call}");
        let instances = |theirs: &Theirs, places: &[Place]| -> Vec<u32> {
            let ray = |place: &Place| {
                let org = (place.position + DVec3::new(0.05, 0.0, 9.0)).as_vec3().to_array();
                let ray = RtcRay { org, dir: [0.0, 0.0, -1.0], tfar: 99.0, mask: u32::MAX, ..RtcRay::default() };
                let hit = RtcHit { prim: NONE, geometry: NONE, instance: NONE, ..RtcHit::default() };
                RtcRayHit { ray, hit }
            };
            let mut rays: Vec<RtcRayHit> = places.iter().map(ray).collect();
            theirs.scene.intersect(&mut Context::new(false), &mut rays);
            rays.iter().map(|ray| ray.hit.instance).collect()
        };
        theirs.commit();
        assert!(instances(&theirs, &forest.places).into_iter().eq(0..300));
        assert!(theirs.bytes() > 0 && resident().is_none_or(|bytes| bytes > 1 << 20));
        let after = forest.after(Edit::MoveMany);
        let moved: Vec<usize> = forest.moved(Edit::MoveMany, false).iter().map(|(i, _)| *i).collect();
        assert!(theirs.edit(Edit::MoveMany).is_some());
        let (now, old) = (instances(&theirs, &after.places), instances(&theirs, &forest.places));
        assert!(moved.iter().all(|&i| now[i] == i as u32 && old[i] != i as u32));
        // Undone.
        theirs.edit(Edit::MoveMany);
        assert!(instances(&theirs, &forest.places).into_iter().eq(0..300));
        assert_eq!(theirs.edit(Edit::Highlight), None);
    }
}
