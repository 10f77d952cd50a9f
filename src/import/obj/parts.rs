//! Declaration of the parts and materials of an OBJ file from its survey.

use super::mtl;
use super::survey::Survey;
use crate::base::error::Result;
use crate::import::{MaterialDesc, MaterialKey, PartDesc, PartKey, Sink, stem};
use std::collections::{BTreeSet, HashMap};
use std::path::Path;

/// Part and material colour of the triangles of a run of faces.
#[derive(Clone, Copy)]
pub(crate) struct Target {
    pub(crate) part: PartKey,
    pub(crate) colour: [f32; 3],
}

/// The targets of all runs of faces, in file order.
pub(crate) struct Parts {
    uses: Vec<Target>,
    runs: Vec<u32>,
}

impl Parts {
    /// Returns the target of run `n`, if the first reading found that run.
    pub(crate) fn run(&self, n: usize) -> Option<Target> {
        self.uses.get(*self.runs.get(n)? as usize).copied()
    }
}

/// Declares the materials that are used, and a part for each object, group and combination of group and material.
pub(crate) fn declare(path: &Path, survey: &Survey, sink: &mut dyn Sink) -> Result<Parts> {
    let looks = materials(path, survey, sink)?;
    let mut of_group: Vec<Vec<usize>> = vec![Vec::new(); survey.groups.items.len()];
    for (i, &(group, _)) in survey.uses.items.iter().enumerate() {
        of_group[group as usize].push(i);
    }
    let mut declaration = Declaration { survey, looks, of_group, objects: HashMap::new() };
    let mut uses = vec![Target { part: 0, colour: MaterialDesc::default().colour }; survey.uses.items.len()];
    for group in 0..survey.groups.items.len() {
        declaration.group(path, group, &mut uses, sink)?;
    }
    Ok(Parts { uses, runs: survey.runs.clone() })
}

/// State while the parts are declared.
struct Declaration<'a> {
    survey: &'a Survey,
    /// Keys and colours of the defined materials, by the index of their name.
    looks: HashMap<u32, Looks>,
    /// Combinations of each group, as indices into `survey.uses`.
    of_group: Vec<Vec<usize>>,
    /// Parts of the objects that were declared so far.
    objects: HashMap<u32, PartKey>,
}

impl Declaration<'_> {
    fn name(&self, index: u32) -> String {
        self.survey.names.items[index as usize].clone()
    }

    fn look(&self, used: usize) -> Option<Looks> {
        self.looks.get(&self.survey.uses.items[used].1?).copied()
    }

    /// Returns the material of a group that uses only one.
    fn only_material(&self, group: usize) -> Option<MaterialKey> {
        match self.of_group[group][..] {
            [one] => self.look(one).map(|l| l.0),
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
        let uses = &self.of_group[group];
        for &used in uses {
            let (material, colour) = self.look(used).unzip();
            targets[used] = Target { part, colour: colour.unwrap_or(MaterialDesc::default().colour) };
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

/// Key and linear colour of a declared material.
type Looks = (MaterialKey, [f32; 3]);

/// Returns keys and colours of the materials that faces use, by the index of their name.
fn materials(path: &Path, survey: &Survey, sink: &mut dyn Sink) -> Result<HashMap<u32, Looks>> {
    let mut defined = HashMap::new();
    for library in &survey.libraries.items {
        mtl::read(path, library, &mut defined, sink)?;
    }
    let mut keys = HashMap::new();
    let mut missing = BTreeSet::new();
    for &(_, material) in &survey.uses.items {
        let Some(material) = material.filter(|m| !keys.contains_key(m)) else { continue };
        match defined.get(&survey.names.items[material as usize]) {
            Some(&desc) => {
                keys.insert(material, (sink.material(desc)?, desc.colour));
            }
            None => {
                missing.insert(material);
            }
        }
    }
    if let Some(&first) = missing.first() {
        let (file, n, first) = (path.display(), missing.len(), &survey.names.items[first as usize]);
        sink.note(format!(
            "{file}: {n} materials are used but not defined (\"{first}\"...); the default material is used instead"
        ));
    }
    Ok(keys)
}
