//! Declaration of the parts and materials of an OBJ file from its survey.

use super::mtl::{Libraries, Material};
use super::survey::Survey;
use super::textures::{Textures, Used};
use crate::base::error::Result;
use crate::base::groups::Groups;
use crate::base::progress::Cancel;
use crate::import::access::Files;
use crate::import::{MaterialDesc, MaterialKey, PartDesc, PartKey, Sink, stem, text};
use std::collections::{BTreeSet, HashMap};
use std::path::Path;

/// Part and material colour of the triangles of a run of faces.
#[derive(Clone, Copy)]
pub(crate) struct Target {
    pub(crate) part: PartKey,
    pub(crate) colour: [f32; 3],
    pub(crate) texture: Option<Painted>,
}

/// A texture, and the factor of its colours.
#[derive(Clone, Copy)]
pub(crate) struct Painted {
    pub(crate) used: Used,
    pub(crate) factor: [f32; 3],
}

/// The targets of all runs of faces, in file order.
pub(crate) struct Parts<'a> {
    uses: Vec<Target>,
    runs: Vec<u32>,
    pub(crate) textures: Textures<'a>,
}

impl Parts<'_> {
    /// Returns the target of run `n`, if the first reading found that run.
    pub(crate) fn run(&self, n: usize) -> Option<Target> {
        self.uses.get(*self.runs.get(n)? as usize).copied()
    }

    /// True if some triangles have a texture.
    pub(crate) fn have_textures(&self) -> bool {
        self.uses.iter().any(|target| target.texture.is_some())
    }
}

/// Declares the materials that are used, and a part for each object, group and combination of group and material.
pub(crate) fn declare<'a>(
    path: &Path,
    files: &'a Files<'a>,
    survey: &Survey,
    sink: &mut dyn Sink,
) -> Result<Parts<'a>> {
    let mut libraries = Libraries::default();
    for library in &survey.libraries.items {
        sink.cancel().check()?;
        libraries.read(path, library, files, sink)?;
    }
    let mut textures = Textures::new(files);
    let looks = materials(path, survey, &libraries, &mut textures, sink)?;
    textures.note(path, sink);
    let of_group = Groups::of(survey.groups.items.len(), survey.uses.items.iter().map(|used| used.0));
    let mut declaration = Declaration { survey, looks, of_group, objects: HashMap::new() };
    let plain = Target { part: 0, colour: MaterialDesc::default().colour, texture: None };
    let mut uses = vec![plain; survey.uses.items.len()];
    for group in 0..survey.groups.items.len() {
        sink.cancel().check()?;
        declaration.group(path, group, &mut uses, sink)?;
    }
    Ok(Parts { uses, runs: survey.runs.clone(), textures })
}

/// State while the parts are declared.
struct Declaration<'a> {
    survey: &'a Survey,
    /// Keys and colours of the defined materials, by the index of their name.
    looks: HashMap<u32, Looks>,
    /// Combinations of a group and a material by group, as indices into `survey.uses`.
    of_group: Groups,
    /// Parts of the objects that were declared so far.
    objects: HashMap<u32, PartKey>,
}

impl Declaration<'_> {
    fn name(&self, index: u32) -> String {
        text::name(&self.survey.names.items[index as usize])
    }

    fn look(&self, used: u32) -> Option<Looks> {
        self.looks.get(&self.survey.uses.items[used as usize].1?).copied()
    }

    /// Returns the material of a group that uses only one.
    fn only_material(&self, group: usize) -> Option<MaterialKey> {
        match *self.of_group.get(group) {
            [one] => self.look(one).map(|l| l.key),
            _ => None,
        }
    }

    /// Declares the part of a group of faces, with a child for each material if there are several.
    fn group(&mut self, path: &Path, group: usize, targets: &mut [Target], sink: &mut dyn Sink) -> Result<()> {
        let (object, name) = self.survey.groups.items[group];
        let parent = object.map(|o| self.object(o, sink)).transpose()?;
        let part = match (parent, name) {
            (Some(object), None) => object,
            _ => {
                let name = name.map_or_else(|| stem(path), |n| self.name(n));
                sink.part(PartDesc { name, parent, material: self.only_material(group), id: None })?
            }
        };
        let uses = self.of_group.get(group);
        for &used in uses {
            let look = self.look(used);
            let (material, used) = (look.map(|l| l.key), used as usize);
            targets[used].part = part;
            if let Some(Looks { colour, texture, .. }) = look {
                (targets[used].colour, targets[used].texture) = (colour, texture);
            }
            if uses.len() > 1 {
                let name = self.survey.uses.items[used].1.map_or_else(|| "no material".into(), |m| self.name(m));
                targets[used].part = sink.part(PartDesc { name, parent: Some(part), material, id: None })?;
            }
        }
        Ok(())
    }

    /// Returns the part of an object, which holds the object's own faces and is the parent of its groups.
    fn object(&mut self, object: u32, sink: &mut dyn Sink) -> Result<PartKey> {
        if let Some(&part) = self.objects.get(&object) {
            return Ok(part);
        }
        let own = self.survey.groups.find(&(Some(object), None));
        let material = own.and_then(|group| self.only_material(group as usize));
        let part = sink.part(PartDesc { name: self.name(object), material, ..PartDesc::default() })?;
        self.objects.insert(object, part);
        Ok(part)
    }
}

/// A declared material.
#[derive(Clone, Copy)]
struct Looks {
    key: MaterialKey,
    /// Linear colour.
    colour: [f32; 3],
    texture: Option<Painted>,
}

/// Declares the materials that faces use. Returns them by the index of their name.
fn materials(
    path: &Path,
    survey: &Survey,
    libraries: &Libraries,
    textures: &mut Textures<'_>,
    sink: &mut dyn Sink,
) -> Result<HashMap<u32, Looks>> {
    let mut declared = HashMap::new();
    let mut missing = BTreeSet::new();
    for &(_, material) in &survey.uses.items {
        sink.cancel().check()?;
        let Some(material) = material.filter(|m| !declared.contains_key(m)) else { continue };
        match libraries.get(&survey.names.items[material as usize]) {
            Some(found) => {
                let (desc, texture) = painted(found, textures, sink.cancel())?;
                declared.insert(material, Looks { key: sink.material(desc)?, colour: desc.colour, texture });
            }
            None => {
                missing.insert(material);
            }
        }
    }
    if let Some(&first) = missing.first() {
        let (file, n, first) = (path.display(), missing.len(), text::name(&survey.names.items[first as usize]));
        sink.note(format!(
            "{file}: {n} materials are used but not defined (\"{first}\"...); the default material is used instead"
        ));
    }
    Ok(declared)
}

/// Returns the looks of a material with its texture, if it has one that can be used. The material's own colour is then
/// the mean of the texture.
///
/// `Kd` is a factor of the texture's colours. `Kd 0 0 0` would hide the texture: programs write it for materials that
/// have no colour of their own.
fn painted(
    material: &Material,
    textures: &mut Textures<'_>,
    cancel: &Cancel,
) -> Result<(MaterialDesc, Option<Painted>)> {
    let mut looks = material.looks;
    let Some(map) = &material.map else { return Ok((looks, None)) };
    let factor = material.factor.filter(|&factor| factor != [0.0; 3]);
    let Some((used, texture)) = textures.add(map, cancel)? else {
        if factor.is_none() {
            looks.colour = MaterialDesc::default().colour;
        }
        return Ok((looks, None));
    };
    let factor = factor.unwrap_or([1.0; 3]);
    let mean = texture.mean_of_all().unwrap_or([1.0; 3]);
    looks.colour = std::array::from_fn(|i| factor[i] * mean[i]);
    Ok((looks, Some(Painted { used, factor })))
}
