//! `EXT_mesh_gpu_instancing`: a node that places its mesh several times.
//!
//! Many nodes may name the same accessors, so that a small file can have more instances than fit in memory. Therefore
//! only the elements of one node are in memory at a time, and transforms are made where they are used.

use super::accessor::Elements;
use super::buffers::Buffers;
use super::model::{Accessor, Attributes, Component, Model, unit_quaternion};
use crate::import::input::Parsed;
use glam::{DAffine3, DVec3};

/// The accessors of a node's instances. Their types, ranges and numbers of elements are checked, the elements are not.
pub(crate) struct Accessors {
    pub(crate) count: u64,
    /// True if the rotations have a type that the extension does not allow, but that has a meaning.
    pub(crate) has_unsigned_rotations: bool,
    translations: Option<Elements>,
    rotations: Option<Elements>,
    scales: Option<Elements>,
}

/// The elements of a node's instances.
pub(crate) struct Instances {
    count: usize,
    translations: Option<Vec<[f32; 3]>>,
    rotations: Option<Vec<[f32; 4]>>,
    scales: Option<Vec<[f32; 3]>>,
}

impl Accessors {
    /// Opens the accessors of at least one attribute.
    pub(crate) fn open(model: &Model, attributes: &Attributes, buffers: &mut Buffers<'_>) -> Parsed<Self> {
        let count = count(model, attributes)?;
        let find = |name: &str| attributes.iter().find(|(known, _)| **known == *name).map(|(_, index)| *index);
        let mut open = |name: &str, width: usize| {
            let Some(index) = find(name) else { return Ok(None) };
            let open = check_type(model, name, index).and_then(|()| Elements::open(model, index, &[width], buffers));
            open.map(Some).map_err(|fault| super::within(name, fault))
        };
        let (translations, rotations) = (open("TRANSLATION", 3)?, open("ROTATION", 4)?);
        let scales = open("SCALE", 3)?;
        if let (None, None, None, Some((name, index))) = (&translations, &rotations, &scales, attributes.first()) {
            // Other attributes, such as ids, are not read, but can be the only ones. Their bytes bound the number.
            let all = Elements::open(model, *index, &[1, 2, 3, 4, 9, 16], buffers);
            all.map_err(|fault| super::within(name, fault))?;
        }
        let rotation = find("ROTATION").and_then(|index| model.accessors.find(index));
        let has_unsigned_rotations = rotation.is_some_and(|r| matches!(r.component, Component::U8 | Component::U16));
        Ok(Self { count, has_unsigned_rotations, translations, rotations, scales })
    }

    /// Number of bytes of the elements in memory.
    pub(crate) fn bytes(&self) -> u64 {
        let of = |elements: &Option<Elements>, width: u64| elements.as_ref().map_or(0, |e| e.bytes(width));
        of(&self.translations, 3) + of(&self.rotations, 4) + of(&self.scales, 3)
    }

    /// Reads the elements. Fails if one of them is no transform.
    pub(crate) fn read(&self, buffers: &mut Buffers<'_>) -> Parsed<Instances> {
        let translations = finite(&self.translations, "TRANSLATION", buffers)?;
        let rotations = finite(&self.rotations, "ROTATION", buffers)?;
        let scales = finite(&self.scales, "SCALE", buffers)?;
        if let (Some(elements), Some(list)) = (&self.rotations, &rotations)
            && let Some(i) = list.iter().position(|rotation| *rotation == [0.0; 4])
        {
            return Err(format!("element {i} of ROTATION ({}) is zero, which is no rotation", elements.name()).into());
        }
        Ok(Instances { count: self.count as usize, translations, rotations, scales })
    }
}

impl Instances {
    /// A node without the extension, which places its mesh once.
    pub(crate) const ONE: Self = Self { count: 1, translations: None, rotations: None, scales: None };

    /// Returns the transforms of the instances to the world, from that of their node.
    pub(crate) fn worlds(&self, world_from_node: DAffine3) -> impl Iterator<Item = DAffine3> {
        (0..self.count).map(move |i| match self.node_from_instance(i) {
            Some(node_from_instance) => world_from_node * node_from_instance,
            None => world_from_node,
        })
    }

    fn node_from_instance(&self, i: usize) -> Option<DAffine3> {
        let Self { translations, rotations, scales, .. } = self;
        if translations.is_none() && rotations.is_none() && scales.is_none() {
            return None;
        }
        let vector = |list: &Option<Vec<[f32; 3]>>, or: f64| {
            list.as_ref().map_or(DVec3::splat(or), |list| DVec3::from(list[i].map(f64::from)))
        };
        let rotation = rotations.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |list| list[i].map(f64::from));
        let (scale, translation) = (vector(scales, 1.0), vector(translations, 0.0));
        Some(DAffine3::from_scale_rotation_translation(scale, unit_quaternion(rotation), translation))
    }
}

/// Returns the number of elements, which all attributes have in common, also those that are not read.
fn count(model: &Model, attributes: &Attributes) -> Parsed<u64> {
    let mut first: Option<(u64, &str)> = None;
    for (name, index) in attributes {
        let count = model.accessors.get(*index).map_err(|fault| super::within(name, fault))?.count;
        match first {
            Some((expected, other)) if count != expected => {
                let differ = "the attributes differ in their number of elements";
                return Err(format!("{differ}: {expected} elements of {other}, but {count} of {name}").into());
            }
            _ => first = Some((count, name)),
        }
    }
    Ok(first.map_or(0, |(count, _)| count))
}

/// Fails if the components have a type that gives no transform: the extension allows floats, and normalised bytes and
/// shorts for rotations. Normalised unsigned rotations are read too, because programs write them.
fn check_type(model: &Model, name: &str, index: usize) -> Parsed<()> {
    let &Accessor { component, normalized, .. } = model.accessors.get(index)?;
    let is_small = !matches!(component, Component::F32 | Component::U32);
    if component == Component::F32 || name == "ROTATION" && normalized && is_small {
        return Ok(());
    }
    let allowed = if name == "ROTATION" { "floats or normalised bytes or shorts" } else { "floats" };
    let normalised = if normalized { "normalised " } else { "" };
    Err(format!("accessors[{index}] has {normalised}{}; expected {allowed}", component.name()).into())
}

/// Reads the elements of an attribute, which must be finite numbers.
fn finite<const N: usize>(
    elements: &Option<Elements>,
    name: &str,
    buffers: &mut Buffers<'_>,
) -> Parsed<Option<Vec<[f32; N]>>> {
    let Some(elements) = elements else { return Ok(None) };
    let list = elements.floats::<N>(buffers)?;
    match list.iter().position(|element| !element.iter().all(|x| x.is_finite())) {
        Some(i) => Err(format!("element {i} of {name} ({}) is not finite", elements.name()).into()),
        None => Ok(Some(list)),
    }
}
