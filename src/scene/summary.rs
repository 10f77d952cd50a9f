//! What a committed scene holds: its models, and the numbers and the memory of its instances.

use super::array::Array;
use super::camera::{Camera, default_views};
use super::draft::Draftee;
use super::inner::PlacedScene;
use super::light::{Background, Light};
use super::measures::Measures;
use super::model::Model;
use super::placed::Placed;
use super::state::{Instance, SceneState};
use crate::base::units::UpAxis;
use std::collections::HashSet;
use std::path::Path;

/// Numbers of a committed scene, with all scenes in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SceneSummary {
    /// Number of levels of scenes in scenes, this one included.
    pub levels: u32,
    /// Number of scenes, this one included, each counted once.
    pub scenes: u64,
    /// Number of instances that are stored: single ones and members of arrays, of models and of scenes, in each scene
    /// once.
    pub stored: u64,
    /// Number of instances of models in all places.
    pub instances: u64,
    /// Number of placed meshes in all places: [`crate::query::Hit::occurrence`] is below it.
    pub occurrences: u64,
    /// Bytes of memory that the stored instances take, with the trees over them and without the models.
    pub bytes: u64,
}

impl SceneState {
    /// Its models, and those of the scenes in it, each once.
    pub fn models(&self) -> &[Model] {
        &self.models
    }

    /// Its lights.
    pub fn lights(&self) -> &[Light] {
        &self.lights
    }

    /// Its background.
    pub fn background(&self) -> Background {
        self.background
    }

    /// The model of an occurrence; `None` if there is no such occurrence.
    pub fn model_of(&self, occurrence: u64) -> Option<&Model> {
        (occurrence < self.placement.len()).then(|| self.model_of_instance(self.ids_of(occurrence).instance))
    }

    /// The up axis of its models; unknown if they have several, or none.
    pub fn up(&self) -> UpAxis {
        let mut all = self.models.iter().map(|model| model.info().up);
        let first = all.next().unwrap_or(UpAxis::Unknown);
        if all.all(|up| up == first) { first } else { UpAxis::Unknown }
    }

    /// Four views from its bounds, as [`Model::views_with`] returns them of a model.
    pub fn views_with(&self, up: UpAxis) -> [Camera; 4] {
        default_views(&self.bounds(), up)
    }

    /// Counts what it holds. Takes time in proportion to the scenes in it, each once, and to its single instances.
    pub fn summary(&self) -> SceneSummary {
        let count = &self.placement.count;
        let (levels, instances, occurrences) = (self.levels, count.instances, count.placed);
        let mut all = SceneSummary { levels, instances, occurrences, ..SceneSummary::default() };
        let (mut seen, mut seen_states, mut todo) =
            (HashSet::from([std::ptr::from_ref(self)]), HashSet::new(), vec![self]);
        while let Some(scene) = todo.pop() {
            all.scenes += 1;
            all.stored += scene.stored();
            all.bytes += scene.own_bytes();
            if seen_states.insert(&raw const *scene.states) {
                all.bytes += scene.states.bytes(&mut seen_states);
            }
            todo.extend(scene.placement.inner_scenes().map(|it| &**it).filter(|&it| seen.insert(it)));
        }
        all
    }

    /// Number of its own instances, of models and of scenes.
    fn stored(&self) -> u64 {
        let placement = &self.placement;
        let of_scenes = placement.scene_arrays.iter().map(|it| u64::from(it.array.len())).sum::<u64>();
        placement.own_instances() + placement.scenes.len() as u64 + of_scenes
    }

    /// Bytes of its own instances and of the tree over them, without their states.
    fn own_bytes(&self) -> u64 {
        let placement = &self.placement;
        let each = size_of::<Instance>() + size_of::<Draftee>() + size_of::<u32>();
        let singles = self.singles.len() * each + placement.singles.len() * size_of::<Placed>();
        let tables: usize = placement
            .arrays
            .iter()
            .map(|it| it.starts.len() * size_of::<u32>() + it.measures.len() * size_of::<Measures>())
            .sum();
        let scenes = placement.scenes.iter().map(|it| size_of::<PlacedScene>() + it.of.models.len() * size_of::<u32>());
        let arrays = placement.arrays.iter().map(|it| it.array.bytes());
        let scene_arrays = placement.scene_arrays.iter().map(|it| it.array.bytes());
        (singles + tables + scenes.sum::<usize>()) as u64
            + arrays.chain(scene_arrays).sum::<u64>()
            + placement.top.bytes()
            + self.groups.bytes()
    }
}

impl Array {
    /// Bytes of its transforms and indices.
    fn bytes(&self) -> u64 {
        let of_pieces: usize = self.pieces().map(|(_, range)| range.len()).sum();
        self.form().bytes_each() * of_pieces as u64 + size_of_val(self.indices()) as u64
    }
}

impl Model {
    /// The absolute path of its file; `None` if it was not opened from a file.
    pub fn path(&self) -> Option<&Path> {
        self.blocks().file().path()
    }
}
