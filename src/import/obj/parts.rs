//! From the survey of an OBJ file to parts and materials in the sink.

use super::mtl;
use super::survey::Survey;
use crate::base::error::Result;
use crate::import::{MaterialDesc, MaterialKey, PartDesc, PartKey, Sink, stem};
use std::collections::HashMap;
use std::path::Path;

/// Where the triangles of a run of faces go.
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
    /// Where run `n` goes, if the first reading saw it.
    pub(crate) fn run(&self, n: usize) -> Option<Target> {
        self.uses.get(*self.runs.get(n)? as usize).copied()
    }
}

/// Declares the materials that are used and a part for each object, group and combination.
pub(crate) fn declare(path: &Path, survey: &Survey, sink: &mut dyn Sink) -> Result<Parts> {
    let looks = materials(path, survey, sink)?;
    let look = |material: Option<u32>| material.and_then(|m| looks.get(&m).copied());
    let name = |i: u32| survey.names.items[i as usize].clone();
    // The materials of each group, by index into `uses`.
    let mut of_group: Vec<Vec<usize>> = vec![Vec::new(); survey.groups.items.len()];
    for (i, &(group, _)) in survey.uses.items.iter().enumerate() {
        of_group[group as usize].push(i);
    }
    let single = |uses: &[usize]| match uses {
        [one] => look(survey.uses.items[*one].1).map(|(key, _)| key),
        _ => None,
    };
    let mut objects: HashMap<u32, PartKey> = HashMap::new();
    let mut own_materials: HashMap<u32, Option<MaterialKey>> = HashMap::new();
    for (&(object, group), uses) in survey.groups.items.iter().zip(&of_group) {
        if let (Some(object), None) = (object, group) {
            own_materials.insert(object, single(uses));
        }
    }
    let mut targets = vec![Target { part: 0, colour: MaterialDesc::default().colour }; survey.uses.items.len()];
    for (&(object, group), uses) in survey.groups.items.iter().zip(&of_group) {
        let mut key = None;
        if let Some(object) = object {
            key = Some(match objects.get(&object) {
                Some(&key) => key,
                None => {
                    let material = own_materials.get(&object).copied().flatten();
                    let part = sink.part(PartDesc { name: name(object), material, ..PartDesc::default() })?;
                    objects.insert(object, part);
                    part
                }
            });
        }
        let part = match (key, group) {
            (Some(object), None) => object,
            (parent, group) => {
                let name = group.map_or_else(|| stem(path), name);
                sink.part(PartDesc { name, parent, material: single(uses), id: None })?
            }
        };
        for &i in uses {
            let material = survey.uses.items[i].1;
            let (key, colour) = look(material).unzip();
            targets[i].part = part;
            targets[i].colour = colour.unwrap_or(MaterialDesc::default().colour);
            if uses.len() > 1 {
                let name = material.map_or_else(|| "no material".into(), name);
                targets[i].part = sink.part(PartDesc { name, parent: Some(part), material: key, id: None })?;
            }
        }
    }
    Ok(Parts { uses: targets, runs: survey.runs.clone() })
}

/// Keys and colours of the materials that faces use, by the index of their name.
fn materials(path: &Path, survey: &Survey, sink: &mut dyn Sink) -> Result<HashMap<u32, (MaterialKey, [f32; 3])>> {
    let mut defined = HashMap::new();
    for library in &survey.libraries.items {
        mtl::read(path, library, &mut defined, sink)?;
    }
    let mut keys = HashMap::new();
    let mut missing: Vec<u32> = Vec::new();
    for &(_, material) in &survey.uses.items {
        let Some(material) = material.filter(|m| !keys.contains_key(m)) else { continue };
        match defined.get(&survey.names.items[material as usize]) {
            Some(&desc) => {
                keys.insert(material, (sink.material(desc)?, desc.colour));
            }
            None if missing.contains(&material) => {}
            None => missing.push(material),
        }
    }
    if let Some(&first) = missing.first() {
        let (file, n, first) = (path.display(), missing.len(), &survey.names.items[first as usize]);
        sink.note(format!("{file}: {n} materials are used but not defined (\"{first}\"...); the default stands in"));
    }
    Ok(keys)
}
