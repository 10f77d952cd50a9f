//! Saving a scene in a file: every scene in it once, inner ones before outer ones, and the models by their paths.

use super::array::{Array, Transforms};
use super::edit::Scene;
use super::given::Given1;
use super::light::{Background, Light, LightKind};
use super::model::Model;
use super::state::SceneState;
use crate::base::bytes::PutBytes;
use crate::base::error::{Error, Result};
use crate::base::inputs::{Identity, Inputs};
use crate::base::inside_read::refuse_inside_read;
use crate::residency::ModelBlocks;
use crate::store::scene_file::{
    ArrayRow, LightRow, MOST_LIGHTS, MOST_PATH, ModelFileRow, PLAIN_VERSION, SCENE_FOOTER_LEN, SCENE_HEADER_LEN,
    SCENE_VERSION, SceneFileRow, SceneHeader, SceneRow, SceneWriter, SingleRow, StateRow, check_path, padding,
};
use crate::store::{FileSource, Outline};
use std::collections::HashMap;
use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

impl Scene {
    /// Saves what the last commit has in a scene file, which [`Scene::open`] opens: instances, arrays and scenes in
    /// scenes with their transforms, masks and looks, and the lights and the background. Models are named by their
    /// paths, relative to the folder of the scene file, with their sizes and hashes. The file appears under its name
    /// once it is complete; an older file stays until then. Returns its size in bytes. Writes the disk.
    ///
    /// Fails with `BadState`, which names the instance or the model, if something cannot be saved: a model that was not
    /// opened from a file, looks of parts or of single occurrences; with `BadArgument` if the path is that of a model;
    /// and with `Io`. Nothing is then written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<u64> {
        refuse_inside_read()?;
        save(&self.state(), path.as_ref())
    }
}

/// The folder of a file that exists or will exist, without links.
pub(super) fn folder_of(path: &Path) -> Result<PathBuf> {
    let fail = |e| Error::io(path, "open", e);
    let file = std::path::absolute(path).map_err(fail)?;
    // A link stays where it is when the file that it names is written.
    let file = file.canonicalize().unwrap_or(file);
    match file.parent() {
        Some(folder) => folder.canonicalize().map_err(fail),
        None => Err(Error::bad_argument(format!("{}: no name of a file", path.display()))),
    }
}

/// The path from a folder to a file, both absolute and without links; `None` if there is none in UTF-8.
fn relative(folder: &Path, file: &Path) -> Option<String> {
    let same = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(same).map(|_| Some(".."));
    let down = file.components().skip(same).map(|name| match name {
        Component::Normal(name) => OsStr::to_str(name),
        _ => None,
    });
    Some(up.chain(down).collect::<Option<Vec<&str>>>()?.join("/"))
}

/// A scene that is being saved.
struct Saving<'a> {
    folder: PathBuf,
    /// Inner scenes before outer ones, and the index of each.
    scenes: Vec<&'a SceneState>,
    scene_at: HashMap<*const SceneState, u32>,
    /// In the order of their first use.
    models: Vec<(ModelFileRow, String)>,
    /// The index of each opened model, and of each path.
    model_at: HashMap<*const ModelBlocks, u32>,
    path_at: HashMap<String, u32>,
    inputs: Inputs,
}

fn save(state: &SceneState, path: &Path) -> Result<u64> {
    let (scenes, scene_at, models) = (Vec::new(), HashMap::new(), Vec::new());
    let (model_at, path_at, inputs) = (HashMap::new(), HashMap::new(), Inputs::default());
    let mut saving = Saving { folder: folder_of(path)?, scenes, scene_at, models, model_at, path_at, inputs };
    saving.visit(state)?;
    let (background, colours) = match state.background {
        Background::Colour([r, g, b, a]) => (0, [r, g, b, a, 0.0, 0.0, 0.0, 0.0]),
        Background::Gradient { bottom: [r, g, b, a], top: [r2, g2, b2, a2] } => (1, [r, g, b, a, r2, g2, b2, a2]),
    };
    let count = |n: usize| u32::try_from(n).map_err(|_| Error::bad_argument("the scene has 2^32 parts or more"));
    if state.lights.len() > MOST_LIGHTS as usize {
        return Err(Error::BadState(format!(
            "the scene has more than {MOST_LIGHTS} lights, which a scene file does not hold"
        )));
    }
    let has_lists = |state: &&SceneState| state.placement.own_arrays().any(|it| it.has_masks() || it.has_tints());
    let header = SceneHeader {
        version: if saving.scenes.iter().any(has_lists) { SCENE_VERSION } else { PLAIN_VERSION },
        models: count(saving.models.len())?,
        scenes: count(saving.scenes.len())?,
        lights: count(state.lights.len())?,
        background,
        colours,
    };
    let bytes = saving.bytes(state);
    let mut to = SceneWriter::create(path, &saving.inputs, &header, bytes)?;
    state.lights.iter().try_for_each(|light| to.row(&light_row(light)))?;
    for (row, path) in &saving.models {
        to.row(row)?;
        to.put(|out| out.put_bytes(path.as_bytes()))?;
        to.pad()?;
    }
    saving.scenes.iter().try_for_each(|scene| saving.write(scene, &mut to))?;
    to.finish()?;
    Ok(bytes)
}

fn light_row(light: &Light) -> LightRow {
    let (kind, vector) = match light.kind {
        LightKind::Headlight => (0, [0.0; 3]),
        LightKind::Point(at) => (1, at.to_array()),
        LightKind::Directional(along) => (2, along.to_array()),
    };
    LightRow { kind, shadows: light.shadows, colour: light.colour, intensity: light.intensity, vector }
}

impl<'a> Saving<'a> {
    /// Finds the scenes in a scene, then the scene itself, and their models. There are at most 64 levels.
    fn visit(&mut self, state: &'a SceneState) -> Result<()> {
        if self.scene_at.contains_key(&std::ptr::from_ref(state)) {
            return Ok(());
        }
        for inner in state.placement.inner_scenes() {
            self.visit(inner)?;
        }
        check(state)?;
        state.models.iter().try_for_each(|model| self.add_model(model))?;
        self.scene_at.insert(state, self.scenes.len() as u32);
        self.scenes.push(state);
        Ok(())
    }

    fn add_model(&mut self, model: &Model) -> Result<()> {
        let key = std::ptr::from_ref(model.blocks());
        if self.model_at.contains_key(&key) {
            return Ok(());
        }
        let file = model.blocks().file();
        let name = &model.info().name;
        let refuse = |why: &str| Error::BadState(format!("the model {name} cannot be saved in a scene: {why}"));
        let path = file.path().ok_or_else(|| refuse("it was not opened from a file"))?;
        let fail = |e| Error::io(path, "open", e);
        let folder = path.parent().unwrap_or(path).canonicalize().map_err(fail)?;
        let whole = folder.join(path.file_name().ok_or_else(|| refuse("its path has no name"))?);
        let path = relative(&self.folder, &whole).filter(|path| path.len() <= MOST_PATH && check_path(path).is_ok());
        let why = "its path from the folder of the scene is too long, or is no text in UTF-8";
        let path = path.ok_or_else(|| refuse(why))?;
        // The file may have been replaced since it was opened.
        let now = Outline::read(Arc::new(FileSource::open(&whole)?))?;
        if now.fingerprint() != file.fingerprint() {
            return Err(refuse("its file was replaced after it was opened"));
        }
        self.inputs.add(&whole, Identity::of(&whole).map_err(fail)?);
        let at = match self.path_at.get(&path) {
            Some(&at) => at,
            None => {
                let at = self.models.len() as u32;
                let (bytes, fingerprint, path_len) = (file.file_len(), file.fingerprint(), path.len() as u32);
                self.models.push((ModelFileRow { bytes, fingerprint, path_len }, path.clone()));
                self.path_at.insert(path, at);
                at
            }
        };
        self.model_at.insert(key, at);
        Ok(())
    }

    fn model(&self, state: &SceneState, index: u32) -> u32 {
        self.model_at[&std::ptr::from_ref(state.models[index as usize].blocks())]
    }

    fn scene(&self, state: &SceneState) -> u32 {
        self.scene_at[&std::ptr::from_ref(state)]
    }

    /// Number of bytes of the file.
    fn bytes(&self, state: &SceneState) -> u64 {
        let of_model = |(row, _): &(ModelFileRow, String)| {
            let len = u64::from(row.path_len);
            ModelFileRow::LEN as u64 + len + padding(len)
        };
        let of_scene = |state: &&SceneState| {
            let row = scene_row(state);
            let states = u64::from(row.single_states) + u64::from(row.scene_states);
            let singles = u64::from(row.singles) + u64::from(row.scenes);
            let arrays = arrays_of(state).map(|it| it.bytes()).sum::<u64>();
            SceneRow::LEN as u64 + singles * SingleRow::LEN as u64 + states * StateRow::LEN as u64 + arrays
        };
        let frame = SCENE_HEADER_LEN + SCENE_FOOTER_LEN + state.lights.len() * LightRow::LEN;
        frame as u64 + self.models.iter().map(of_model).sum::<u64>() + self.scenes.iter().map(of_scene).sum::<u64>()
    }

    fn write(&self, state: &SceneState, to: &mut SceneWriter) -> Result<()> {
        to.row(&scene_row(state))?;
        for it in &state.singles {
            let (id, of, map) = (it.id, self.model(state, it.model), it.world_from_model.to_cols_array());
            to.row(&SingleRow { id, of, map })?;
        }
        single_states(state).try_for_each(|it| to.row(&it))?;
        for it in state.placement.scenes.iter() {
            let (id, of, map) = (it.id, self.scene(&it.of.scene), it.world_from_scene.to_cols_array());
            to.row(&SingleRow { id, of, map })?;
        }
        state.states.given.scenes.iter().try_for_each(|it| to.row(&state_row(it)))?;
        arrays_of(state).try_for_each(|it| self.write_array(state, &it, to))
    }

    fn write_array(&self, state: &SceneState, it: &Saved, to: &mut SceneWriter) -> Result<()> {
        to.row(&it.row())?;
        for &of in &it.prototypes {
            let of = match of {
                Of::Model(index) => self.model(state, index),
                Of::Scene(scene) => self.scene(scene),
            };
            to.put(|out| out.put_u32(of))?;
        }
        it.array.indices().iter().try_for_each(|&index| to.put(|out| out.put_u32(index)))?;
        to.pad()?;
        for (transforms, range) in it.array.pieces() {
            for at in range {
                to.put(|out| match transforms {
                    Transforms::Affine(all) => out.put_f64s(&all[at].to_cols_array()),
                    Transforms::Affine32(all) => out.put_f32s(&all[at]),
                    Transforms::Places(all) => {
                        out.put_f64s(&all[at].position.to_array());
                        out.put_f32s(&all[at].rotation);
                        out.put_f32(all[at].scale);
                    }
                })?;
            }
        }
        to.pad()?;
        let members = 0..it.array.len();
        if it.array.has_masks() {
            members.clone().try_for_each(|member| to.put(|out| out.put_u32(it.array.mask(member))))?;
        }
        if it.array.has_tints() {
            members.clone().try_for_each(|member| to.put(|out| out.put_bytes(&it.array.tint(member))))?;
        }
        to.pad()?;
        it.own.iter().try_for_each(|it| to.row(&state_row(it)))
    }
}

/// The index of a model of the scene, or a scene in it.
#[derive(Clone, Copy)]
enum Of<'a> {
    Model(u32),
    Scene(&'a SceneState),
}

/// An array as it is saved.
struct Saved<'a> {
    array: &'a Array,
    prototypes: Vec<Of<'a>>,
    mask: u32,
    own: Vec<Given1>,
}

impl Saved<'_> {
    fn row(&self) -> ArrayRow {
        ArrayRow {
            form: match self.array.form() {
                Transforms::Affine(_) => 0,
                Transforms::Affine32(_) => 1,
                Transforms::Places(_) => 2,
            },
            members: self.array.len(),
            first_id: self.array.first_id,
            prototypes: self.prototypes.len() as u32,
            has_indices: !self.array.indices().is_empty(),
            has_masks: self.array.has_masks(),
            has_tints: self.array.has_tints(),
            mask: self.mask,
            states: self.own.len() as u32,
        }
    }

    fn bytes(&self) -> u64 {
        let indices = 4 * (self.prototypes.len() + self.array.indices().len()) as u64;
        let (row, members) = (self.row(), u64::from(self.array.len()));
        let transforms = row.transform_len() as u64 * members;
        let lists = 4 * members * (u64::from(row.has_masks) + u64::from(row.has_tints));
        let states = (self.own.len() * StateRow::LEN) as u64;
        let padded = [indices, transforms, lists].map(|bytes| bytes + padding(bytes));
        ArrayRow::LEN as u64 + padded.iter().sum::<u64>() + states
    }
}

/// The arrays of models, then those of scenes.
fn arrays_of(state: &SceneState) -> impl Iterator<Item = Saved<'_>> {
    let models = state.placement.arrays.iter().zip(&state.states.arrays).map(|(it, states)| {
        let mut own: Vec<Given1> = states.own.iter().map(|(&member, it)| (member, it.mask, it.look)).collect();
        own.sort_unstable_by_key(|it| it.0);
        let prototypes = it.prototypes.iter().map(|it| Of::Model(it.model)).collect();
        Saved { array: &it.array, prototypes, mask: states.common.mask, own }
    });
    let scenes = state.placement.scene_arrays.iter().zip(&state.states.given.arrays).map(|(it, (mask, own))| {
        let prototypes = it.prototypes.iter().map(|it| Of::Scene(&it.scene)).collect();
        Saved { array: &it.array, prototypes, mask: *mask, own: own.clone() }
    });
    models.chain(scenes)
}

fn scene_row(state: &SceneState) -> SceneRow {
    SceneRow {
        singles: state.singles.len() as u32,
        single_states: single_states(state).count() as u32,
        scenes: state.placement.scenes.len() as u32,
        scene_states: state.states.given.scenes.len() as u32,
        arrays: state.placement.arrays.len() as u32,
        scene_arrays: state.placement.scene_arrays.len() as u32,
    }
}

/// Those of single instances that are not as all others.
fn single_states(state: &SceneState) -> impl Iterator<Item = StateRow> {
    let all = (0..).zip(&state.states.singles).filter(|(_, it)| !it.is_plain());
    all.map(|(index, it)| state_row(&(index, it.mask, it.look)))
}

fn state_row(&(index, mask, look): &Given1) -> StateRow {
    StateRow { index, mask, visible: look.visible, selected: look.selected, colour: look.colour }
}

/// Fails with `BadState` for what scene files do not hold.
fn check(state: &SceneState) -> Result<()> {
    let of_singles = state.singles.iter().zip(&state.states.singles).map(|(it, state)| (it.id, state));
    let arrays = state.placement.arrays.iter().zip(&state.states.arrays);
    let of_arrays = arrays.flat_map(|(it, states)| {
        let own = states.own.iter().map(|(&member, state)| (it.array.first_id + u64::from(member), state));
        own.chain([(it.array.first_id, &states.common)])
    });
    let with_looks = of_singles.chain(of_arrays).filter(|(_, it)| !it.parts.looks.is_empty()).map(|it| it.0).min();
    if let Some(id) = with_looks {
        let why = format!("instance {id} has looks of parts, which a scene file does not hold");
        return Err(Error::BadState(why));
    }
    if let Some(&instance) = state.states.occurrences.keys().min() {
        let way = state.way_to(instance).iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
        let why =
            format!("one occurrence of an instance, on the way {way}, has a look, which a scene file does not hold");
        return Err(Error::BadState(why));
    }
    // The highest id stands for no instance.
    let scenes = state.placement.scenes.iter().map(|it| it.id);
    match state.singles.iter().map(|it| it.id).chain(scenes).any(|id| id == u64::MAX) {
        true => Err(Error::BadState(format!("instance {}: a scene file does not hold this id", u64::MAX))),
        false => Ok(()),
    }
}
