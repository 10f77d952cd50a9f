//! Opening a scene file. The whole file is read and checked before a model is opened: rows that claim more than the
//! file has, references to later scenes, and ids that collide are refused first.

use super::array::{Array, Instances, Place, Prototypes, Transforms};
use super::commit::MOST_LEVELS;
use super::context::Context;
use super::draft::{Draft, DraftArray, DraftScene, DraftState, Draftee, OWN};
use super::edit::{Scene, check_look};
use super::light::{Background, Light, LightKind};
use super::looks::Look;
use super::measures::check_transform;
use super::model::Model;
use super::placed::Placed;
use super::placement::Placement;
use super::save::folder_of;
use super::state::{SceneState, States};
use super::tints::NO_TINT;
use crate::base::bytes::ByteReader;
use crate::base::error::{Error, Result};
use crate::base::inside_read::refuse_inside_read;
use crate::base::memory::room;
use crate::residency::{Kept, Residency, UNCOUNTED};
use crate::store::scene_file::{
    ArrayRow, LightRow, ModelFileRow, PLAIN_VERSION, SceneFileRow, SceneHeader, SceneReader, SceneRow, SingleRow,
    StateRow, check_path,
};
use crate::store::{FileSource, Outline, Source};
use glam::{DAffine3, DVec3};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The memory of a file's tables, for messages.
const WHAT: &str = "the tables of a scene file";

/// Bytes of memory of a scene that nothing else counts: its objects, and the room for its first instances.
const SCENE: u64 =
    (size_of::<Draft>() + size_of::<SceneState>() + size_of::<Placement>() + size_of::<States>() + 1024) as u64;

/// Bytes of the first instances of a scene, for which there is room at once.
const FIRST: u64 = 32 * (size_of::<Option<Draftee>>() as u64 + 34);

/// Bytes of memory for each single instance while a file is opened: the row, its id, and the scene that it may be.
const SINGLE: u64 = (size_of::<SingleRow>() + size_of::<(u64, u64)>() + size_of::<DraftScene>() + 64) as u64;

/// Bytes of a placed tree of a single instance, and of a member of an array, with their places in the tree over all.
const PLACED: u64 = size_of::<Placed>() as u64 + MEMBER;
const MEMBER: u64 = 100;

/// Bytes of memory of an array without its members.
const ARRAY: u64 = (size_of::<DraftArray<Scene>>() + size_of::<Array>() + 512) as u64;

/// A model that the file names.
struct ReadModel {
    row: ModelFileRow,
    path: String,
}

/// A scene of the file.
struct ReadScene {
    /// Offset in the file.
    at: u64,
    singles: Vec<SingleRow>,
    single_states: Vec<StateRow>,
    scenes: Vec<SingleRow>,
    scene_states: Vec<StateRow>,
    /// Arrays of models, then those of scenes.
    arrays: Vec<ReadArray>,
    scene_arrays: Vec<ReadArray>,
}

/// An array of the file.
struct ReadArray {
    at: u64,
    row: ArrayRow,
    prototypes: Vec<u32>,
    prototype_of: Arc<[u32]>,
    transforms: Transforms,
    masks: Option<Arc<[u32]>>,
    tints: Option<Arc<[[u8; 4]]>>,
    states: Vec<StateRow>,
    /// For the transforms, the indices, the masks and the tints.
    memory: Kept,
}

/// The content of the file.
struct Content {
    header: SceneHeader,
    lights: Vec<Light>,
    models: Vec<ReadModel>,
    scenes: Vec<ReadScene>,
    /// For all of it but the transforms.
    memory: Kept,
    /// Bytes of the scenes that nothing else counts.
    uncounted: u64,
}

impl Scene {
    /// Opens a scene file, and the models that it names, in the folder of the file. The scene is committed, can be
    /// edited like any other, and no longer depends on its file. Reads the disk.
    ///
    /// Fails with `Corrupt`, which names the file and the place in it, if the file is damaged, is no scene file, or
    /// names a model whose file is not the one that was saved; with `NewerFormat`; with `OverBudget` if the budget has
    /// no room for the scene or a model; and like [`Model::open`].
    pub fn open(context: &Context, path: impl AsRef<Path>) -> Result<Self> {
        refuse_inside_read()?;
        let path = path.as_ref();
        let source: Arc<dyn Source> = Arc::new(FileSource::open(path)?);
        let (mut reader, header) = SceneReader::open(source)?;
        let residency = context.residency();
        let is_plain = header.version == PLAIN_VERSION;
        let mut reading =
            Reading { reader: &mut reader, residency, is_plain, has_lists: false, charged: 0, uncounted: 0 };
        let content = reading.content(header);
        let (content, error) = content.map_or_else(|error| (None, Some(error)), |content| (Some(content), None));
        reader.finish(error)?;
        match content {
            Some(content) => Opening { context, path }.scene(content),
            None => Err(Error::Internal("a scene file without content".into())),
        }
    }
}

struct Reading<'a> {
    reader: &'a mut SceneReader,
    residency: &'a Residency,
    /// True for a file without masks and tints of members.
    is_plain: bool,
    /// True if an array so far has masks or tints of its members.
    has_lists: bool,
    /// Bytes of the tables so far, and of what is in memory as long as the scene.
    charged: u64,
    /// Bytes that stay and that nothing else counts: little memory of a scene or an array is not counted, but a file
    /// may have any number of small ones.
    uncounted: u64,
}

/// The index of a scene among those of the file, for messages.
fn in_scene(index: usize, why: impl std::fmt::Display) -> String {
    format!("scene {index}: {why}")
}

/// What is wrong with a value.
fn reason(error: Error) -> String {
    match error {
        Error::BadArgument(why) => why,
        other => other.to_string(),
    }
}

impl Reading<'_> {
    fn content(&mut self, header: SceneHeader) -> Result<Content> {
        let mut memory = Kept::default();
        let background = background(&header);
        background.check().map_err(|error| self.reader.corrupt_at(0, reason(error)))?;
        self.claim(header.lights, LightRow::LEN, size_of::<Light>() as u64, "lights", &mut memory)?;
        let mut lights = room(header.lights as usize, WHAT)?;
        for _ in 0..header.lights {
            let at = self.reader.offset();
            let light = light(&self.reader.row()?);
            light.check().map_err(|error| self.reader.corrupt_at(at, reason(error)))?;
            lights.push(light);
        }
        self.claim(header.models, ModelFileRow::LEN, 4 * size_of::<ReadModel>() as u64, "models", &mut memory)?;
        let mut models: Vec<ReadModel> = room(header.models as usize, WHAT)?;
        for _ in 0..header.models {
            models.push(self.model(&mut memory)?);
        }
        let mut paths = HashSet::new();
        if let Some(twice) = models.iter().find(|it| !paths.insert(&*it.path)) {
            return Err(self
                .reader
                .corrupt_at(self.reader.offset(), format!("the model {} is named twice", twice.path)));
        }
        self.claim(header.scenes, SceneRow::LEN, size_of::<ReadScene>() as u64, "scenes", &mut memory)?;
        let (mut scenes, mut levels) = (room(header.scenes as usize, WHAT)?, room(header.scenes as usize, WHAT)?);
        let mut is_used = (vec![false; models.len()], vec![false; header.scenes as usize]);
        for index in 0..header.scenes as usize {
            let scene = self.scene(index, &mut memory)?;
            let level = self.check(index, &scene, (&mut is_used.0, &mut is_used.1), &levels)?;
            levels.push(level);
            scenes.push(scene);
        }
        is_used.1[header.scenes as usize - 1] = true;
        let unused = |all: &[bool]| all.iter().position(|is_used| !is_used);
        let why = match (unused(&is_used.0), unused(&is_used.1)) {
            _ if !self.is_plain && !self.has_lists => "no array has masks or tints, as files of format 0.2 have".into(),
            (Some(model), _) => format!("the model {} is used nowhere", models[model].path),
            (_, Some(scene)) => in_scene(scene, "it is used nowhere"),
            _ => return Ok(Content { header, lights, models, scenes, memory, uncounted: self.uncounted }),
        };
        Err(self.reader.corrupt_at(self.reader.offset(), why))
    }

    /// Compares `count` rows of `each` bytes with the size of the file, then charges `bytes` of memory for each.
    fn claim(&mut self, count: u32, each: usize, bytes: u64, what: &str, memory: &mut Kept) -> Result<()> {
        self.reader.claim(count.into(), each, what)?;
        self.charged += u64::from(count) * bytes;
        memory.grow_to(self.residency, WHAT, self.charged)
    }

    /// Charges bytes that stay.
    fn charge(&mut self, bytes: u64, memory: &mut Kept) -> Result<()> {
        self.charged += bytes;
        self.uncounted += bytes;
        memory.grow_to(self.residency, WHAT, self.charged)
    }

    fn model(&mut self, memory: &mut Kept) -> Result<ReadModel> {
        let at = self.reader.offset();
        let row: ModelFileRow = self.reader.row()?;
        self.claim(row.path_len, 1, 1, "bytes of a path", memory)?;
        let path = std::str::from_utf8(self.reader.take(row.path_len as usize)?).map(str::to_owned);
        self.reader.pad()?;
        let path = path.map_err(|_| self.reader.corrupt_at(at, "the path of a model is no text in UTF-8"))?;
        check_path(&path).map_err(|why| self.reader.corrupt_at(at, format!("{why}: {path:?}")))?;
        Ok(ReadModel { row, path })
    }

    fn scene(&mut self, index: usize, memory: &mut Kept) -> Result<ReadScene> {
        let at = self.reader.offset();
        let row: SceneRow = self.reader.row()?;
        let first = if row.singles > 0 { FIRST } else { 0 };
        let placed = (u64::from(row.singles) + u64::from(row.scenes)) * PLACED;
        self.charge(SCENE + first + placed.min(UNCOUNTED), memory)?;
        let (singles, single_states) = self.singles(row.singles, row.single_states, index, memory)?;
        let (scenes, scene_states) = self.singles(row.scenes, row.scene_states, index, memory)?;
        let arrays = self.arrays(row.arrays, memory)?;
        let scene_arrays = self.arrays(row.scene_arrays, memory)?;
        Ok(ReadScene { at, singles, single_states, scenes, scene_states, arrays, scene_arrays })
    }

    /// Reads single instances and their states.
    fn singles(
        &mut self,
        count: u32,
        states: u32,
        index: usize,
        memory: &mut Kept,
    ) -> Result<(Vec<SingleRow>, Vec<StateRow>)> {
        self.claim(count, SingleRow::LEN, SINGLE, "instances", memory)?;
        let mut rows: Vec<SingleRow> = room(count as usize, WHAT)?;
        for _ in 0..count {
            let at = self.reader.offset();
            let row: SingleRow = self.reader.row()?;
            check_transform(&DAffine3::from_cols_array(&row.map)).map_err(|error| {
                let why = format!("instance {}: {}", row.id, reason(error));
                self.reader.corrupt_at(at, in_scene(index, why))
            })?;
            rows.push(row);
        }
        Ok((rows, self.states(states, count, memory)?))
    }

    /// Reads the states of some of `count` instances.
    fn states(&mut self, states: u32, count: u32, memory: &mut Kept) -> Result<Vec<StateRow>> {
        let at = self.reader.offset();
        if states > count {
            return Err(self.reader.corrupt_at(at, format!("{states} states of {count} instances")));
        }
        self.claim(states, StateRow::LEN, size_of::<StateRow>() as u64, "states", memory)?;
        let rows: Vec<StateRow> = self.reader.rows(states)?;
        let why = if !rows.is_sorted_by(|a, b| a.index < b.index) {
            "the states are not in the order of their instances"
        } else if rows.last().is_some_and(|it| it.index >= count) {
            "a state is that of no instance"
        } else if rows.iter().any(|it| check_look(&look(it)).is_err()) {
            "a colour is not finite, is below 0, or has an alpha above 1"
        } else {
            return Ok(rows);
        };
        Err(self.reader.corrupt_at(at, why))
    }

    fn arrays(&mut self, count: u32, memory: &mut Kept) -> Result<Vec<ReadArray>> {
        self.claim(count, ArrayRow::LEN, size_of::<ReadArray>() as u64, "arrays", memory)?;
        let mut all = room(count as usize, WHAT)?;
        for _ in 0..count {
            all.push(self.array(memory)?);
        }
        Ok(all)
    }

    fn array(&mut self, memory: &mut Kept) -> Result<ReadArray> {
        let at = self.reader.offset();
        let row: ArrayRow = self.reader.row()?;
        if self.is_plain && (row.has_masks || row.has_tints) {
            return Err(self.reader.corrupt_at(at, "masks or tints in a file of format 0.1"));
        }
        self.has_lists |= row.has_masks || row.has_tints;
        let (members, len) = (row.members as usize, row.transform_len());
        self.claim(row.prototypes, 4, 64, "prototypes", memory)?;
        let mut prototypes = room(row.prototypes as usize, WHAT)?;
        for _ in 0..row.prototypes {
            prototypes.push(self.number()?);
        }
        let indices = if row.has_indices { members } else { 0 };
        self.reader.claim(indices as u64, 4, "indices of prototypes")?;
        self.reader.claim(members as u64, len, "transforms")?;
        let in_memory = if row.form == 0 { 96 } else { 48 };
        let lists = 4 * (u64::from(row.has_masks) + u64::from(row.has_tints));
        self.reader.claim(members as u64, lists as usize, "masks and tints")?;
        let bytes = members as u64 * (in_memory + lists) + indices as u64 * 4;
        let of_array = self.residency.keep("an array of instances", bytes)?;
        let small = [bytes, members as u64 * MEMBER, u64::from(row.states) * OWN as u64];
        self.charge(ARRAY + small.into_iter().filter(|bytes| *bytes <= UNCOUNTED).sum::<u64>(), memory)?;
        let prototype_of = self.all(indices, 4, |r| r.u32().unwrap_or_default())?;
        self.reader.pad()?;
        // A row of the right length is read without an error; one that is not there is of zeros.
        let transforms = match row.form {
            0 => Transforms::Affine(
                self.all(members, len, |r| DAffine3::from_cols_array(&r.f64s().unwrap_or_default()))?,
            ),
            1 => Transforms::Affine32(self.all(members, len, |r| r.f32s().unwrap_or_default())?),
            _ => Transforms::Places(self.all(members, len, |r| Place {
                position: DVec3::from_array(r.f64s().unwrap_or_default()),
                rotation: r.f32s().unwrap_or_default(),
                scale: r.f32().unwrap_or_default(),
            })?),
        };
        self.reader.pad()?;
        let masks = if row.has_masks { Some(self.all(members, 4, |r| r.u32().unwrap_or_default())?) } else { None };
        let tint = |r: &mut ByteReader| r.u32().unwrap_or_default().to_le_bytes();
        let tints = if row.has_tints { Some(self.all(members, 4, tint)?) } else { None };
        self.reader.pad()?;
        let are_plain = |it: &Arc<[u32]>| it.iter().all(|mask| *mask == u32::MAX);
        if masks.as_ref().is_some_and(are_plain) {
            return Err(self.reader.corrupt_at(at, "no member has a mask of its own"));
        }
        if tints.as_ref().is_some_and(|it: &Arc<[_]>| it.iter().all(|tint| *tint == NO_TINT)) {
            return Err(self.reader.corrupt_at(at, "no member has a tint"));
        }
        let states = self.states(row.states, row.members, memory)?;
        Ok(ReadArray { at, row, prototypes, prototype_of, transforms, masks, tints, states, memory: of_array })
    }

    fn number(&mut self) -> Result<u32> {
        let mut bytes = [0; 4];
        bytes.copy_from_slice(self.reader.take(4)?);
        Ok(u32::from_le_bytes(bytes))
    }

    /// Reads `count` elements of `len` bytes straight into the memory that they stay in.
    fn all<T>(&mut self, count: usize, len: usize, of: impl Fn(&mut ByteReader) -> T) -> Result<Arc<[T]>> {
        let mut failed = None;
        let next = |_| match (&failed, self.reader.take(len)) {
            (None, Ok(bytes)) => of(&mut ByteReader::new(bytes)),
            (None, Err(error)) => {
                failed = Some(error);
                of(&mut ByteReader::new(&[]))
            }
            _ => of(&mut ByteReader::new(&[])),
        };
        let all = (0..count).map(next).collect();
        failed.map_or(Ok(all), Err)
    }

    /// Checks the references of a scene and its ids. Returns its level: 1 if there is no scene in it.
    fn check(
        &self,
        index: usize,
        scene: &ReadScene,
        (models, scenes): (&mut [bool], &mut [bool]),
        levels: &[u32],
    ) -> Result<u32> {
        let refuse = |at, why: String| Err(self.reader.corrupt_at(at, in_scene(index, why)));
        fn of_arrays(all: &[ReadArray]) -> impl Iterator<Item = u32> {
            all.iter().flat_map(|it| it.prototypes.iter().copied())
        }
        for of in scene.singles.iter().map(|it| it.of).chain(of_arrays(&scene.arrays)) {
            match models.get_mut(of as usize) {
                Some(is_used) => *is_used = true,
                None => return refuse(scene.at, format!("it has model {of}, but the file has {}", models.len())),
            }
        }
        let mut level = 1;
        for of in scene.scenes.iter().map(|it| it.of).chain(of_arrays(&scene.scene_arrays)) {
            match levels.get(of as usize) {
                Some(inner) => level = level.max(inner + 1),
                None => return refuse(scene.at, format!("it has scene {of}, which is not before it")),
            }
            scenes[of as usize] = true;
        }
        if level > MOST_LEVELS {
            return refuse(scene.at, format!("scenes are in each other at more than {MOST_LEVELS} levels"));
        }
        let arrays = || scene.arrays.iter().chain(&scene.scene_arrays);
        for it in arrays() {
            if let Some(i) = it.prototype_of.iter().position(|of| *of >= it.row.prototypes) {
                let (given, have) = (it.prototype_of[i], it.row.prototypes);
                return refuse(it.at, format!("member {i} has prototype {given}, of {have}"));
            }
        }
        // The first id of each list of consecutive ones, and their number.
        let singles = scene.singles.iter().chain(&scene.scenes).map(|it| (it.id, 1));
        let ids = singles.chain(arrays().map(|it| (it.row.first_id, u64::from(it.row.members))));
        let mut ids: Vec<(u64, u64)> = ids.collect();
        ids.sort_unstable();
        for (i, &(first, count)) in ids.iter().enumerate() {
            // The highest id stands for no instance.
            let Some(end) = first.checked_add(count) else {
                return refuse(scene.at, format!("{count} ids from {first} on are too many"));
            };
            if ids.get(i + 1).is_some_and(|next| next.0 < end) {
                return refuse(scene.at, format!("instance {} is there twice", ids[i + 1].0));
            }
        }
        Ok(level)
    }
}

fn background(header: &SceneHeader) -> Background {
    let [r, g, b, a, r2, g2, b2, a2] = header.colours;
    match header.background {
        0 => Background::Colour([r, g, b, a]),
        _ => Background::Gradient { bottom: [r, g, b, a], top: [r2, g2, b2, a2] },
    }
}

fn light(row: &LightRow) -> Light {
    let kind = match row.kind {
        0 => LightKind::Headlight,
        1 => LightKind::Point(DVec3::from_array(row.vector)),
        _ => LightKind::Directional(DVec3::from_array(row.vector)),
    };
    Light { kind, colour: row.colour, intensity: row.intensity, shadows: row.shadows }
}

fn look(row: &StateRow) -> Look {
    Look { visible: row.visible, colour: row.colour, selected: row.selected }
}

struct Opening<'a> {
    context: &'a Context,
    path: &'a Path,
}

impl Opening<'_> {
    /// The last scene of the file.
    fn scene(&self, content: Content) -> Result<Scene> {
        let Content { header, lights, models, scenes, mut memory, uncounted } = content;
        let folder = folder_of(self.path)?;
        let models: Vec<Model> = models.iter().map(|it| self.model(&folder, it)).collect::<Result<_>>()?;
        let count = scenes.len();
        let mut built: Vec<Scene> = room(count, WHAT)?;
        for (index, read) in scenes.into_iter().enumerate() {
            let (scene, at) = (Scene::new(self.context), read.at);
            let made = self.fill(&scene, read, &models, &built).and_then(|()| {
                if index + 1 == count {
                    scene.set_lights(lights.clone())?;
                    scene.set_background(background(&header))?;
                }
                scene.commit()
            });
            made.map_err(|error| self.of_file(error, at, index))?;
            built.push(scene);
        }
        let root = built.pop().ok_or_else(|| Error::Internal("a scene file without scenes".into()))?;
        // Tables are gone; scenes stay as long as this one.
        memory.shrink_to(uncounted);
        root.draft().opened = memory;
        Ok(root)
    }

    /// What the scene of a file does not allow is the fault of the file.
    fn of_file(&self, error: Error, at: u64, index: usize) -> Error {
        match error {
            Error::BadArgument(why) => Error::corrupt(self.path, None, format!("byte {at}: {}", in_scene(index, why))),
            other => other,
        }
    }

    fn model(&self, folder: &Path, it: &ReadModel) -> Result<Model> {
        let file: PathBuf = folder.join(&it.path);
        let source: Arc<dyn Source> = Arc::new(FileSource::open(&file)?);
        let outline = Outline::read(Arc::clone(&source))?;
        if (source.len(), outline.fingerprint()) != (it.row.bytes, it.row.fingerprint) {
            let why = format!("the model {} is not the file that the scene was saved with", file.display());
            return Err(Error::corrupt(self.path, None, why));
        }
        Model::open_source(self.context, source)
    }

    /// Fills a new scene. Its ids are known to be different, and the scenes in it to be others.
    fn fill(&self, scene: &Scene, read: ReadScene, models: &[Model], built: &[Scene]) -> Result<()> {
        let context = self.context;
        let mut draft = scene.draft();
        let draft = &mut *draft;
        for it in &read.singles {
            draft.pay_for_another(context)?;
            let (id, world_from_model) = (it.id, DAffine3::from_cols_array(&it.map));
            let (model, state) = (models[it.of as usize].clone(), DraftState::plain(&draft.plain));
            draft.index.insert(id, draft.instances.len());
            draft.instances.push(Some(Draftee { id, model, world_from_model, state }));
        }
        for it in &read.single_states {
            if let Some(draftee) = draft.instances[it.index as usize].as_mut() {
                set(&mut draftee.state, it);
            }
        }
        for (key, it) in (0..).zip(&read.scenes) {
            let (id, world_from_scene) = (it.id, DAffine3::from_cols_array(&it.map));
            let (scene, state) = (built[it.of as usize].clone(), DraftState::plain(&draft.plain));
            draft.scenes.insert(key, DraftScene { id, scene, world_from_scene, state });
            draft.scene_at.insert(id, key);
        }
        for it in &read.scene_states {
            if let Some(scene) = draft.scenes.get_mut(&u64::from(it.index)) {
                set(&mut scene.state, it);
            }
        }
        for it in read.arrays {
            let prototypes = it.prototypes.iter().map(|&of| models[of as usize].clone()).collect();
            let new = self.array(it, Prototypes::Models, prototypes, draft)?;
            draft.arrays.push(new);
        }
        for it in read.scene_arrays {
            let prototypes = it.prototypes.iter().map(|&of| built[of as usize].clone()).collect();
            let new = self.array(it, Prototypes::Scenes, prototypes, draft)?;
            draft.scene_arrays.push(new);
        }
        draft.moved = true;
        Ok(())
    }

    fn array<P: Clone>(
        &self,
        it: ReadArray,
        of: impl Fn(Vec<P>) -> Prototypes,
        prototypes: Vec<P>,
        draft: &Draft,
    ) -> Result<DraftArray<P>> {
        let ReadArray { at, row, prototype_of, transforms, masks, tints, states, mut memory, .. } = it;
        let (first_id, mask) = (row.first_id, row.mask);
        let lists = [masks.as_ref().map(|it| it.len()), tints.as_ref().map(|it| it.len())];
        let prototypes_of = of(prototypes.clone());
        let given = Instances { prototypes: prototypes_of, prototype_of, transforms, first_id, mask, masks, tints };
        // The array charges its own. It copies masks and tints.
        memory.shrink_to(4 * lists.into_iter().flatten().sum::<usize>() as u64);
        let array = Array::new(&given, self.context.residency());
        drop(memory);
        let array = array.map_err(|error| match error {
            Error::BadArgument(why) => Error::BadArgument(format!("the array at byte {at}: {why}")),
            other => other,
        })?;
        let common = DraftState { mask, ..DraftState::plain(&draft.plain) };
        let (own, memory) = (HashMap::new(), Kept::default());
        let mut new = DraftArray { array: Arc::new(array), prototypes, common, own, memory };
        states.iter().try_for_each(|state| new.state(self.context, state.index).map(|own| set(own, state)))?;
        Ok(new)
    }
}

fn set(state: &mut DraftState, row: &StateRow) {
    (state.mask, state.look) = (row.mask, look(row));
}
