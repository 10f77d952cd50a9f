//! `EXT_mesh_gpu_instancing`: a node that places its mesh several times.

use super::accessor::Elements;
use super::buffers::Buffers;
use super::model::{Model, unit_quaternion};
use crate::import::input::Parsed;
use glam::{DAffine3, DVec3};

/// Returns the transforms of the instances to their node, from the accessors of its attributes.
pub(crate) fn transforms(
    model: &Model,
    attributes: &[(Box<str>, usize)],
    buffers: &mut Buffers<'_>,
) -> Parsed<Vec<DAffine3>> {
    let accessor = |name: &str| attributes.iter().find(|(known, _)| **known == *name).map(|(_, index)| *index);
    let translations = list::<3>(model, accessor("TRANSLATION"), buffers)?;
    let rotations = list::<4>(model, accessor("ROTATION"), buffers)?;
    let scales = list::<3>(model, accessor("SCALE"), buffers)?;
    // Other attributes, such as ids, are not read, but can be the only ones.
    let count = match attributes.first() {
        Some(&(_, index)) => Elements::open(model, index, &[1, 2, 3, 4], buffers)?.count as usize,
        None => 0,
    };
    let lengths =
        [translations.as_ref().map(Vec::len), rotations.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)];
    if lengths.into_iter().flatten().any(|len| len != count) {
        return Err("EXT_mesh_gpu_instancing: the attributes differ in their number of elements".into());
    }
    let vector = |list: &Option<Vec<[f32; 3]>>, i: usize, or: f64| {
        list.as_ref().map_or(DVec3::splat(or), |list| DVec3::from(list[i].map(f64::from)))
    };
    let transform = |i: usize| {
        let rotation = rotations.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |list| list[i].map(f64::from));
        let (scale, translation) = (vector(&scales, i, 1.0), vector(&translations, i, 0.0));
        DAffine3::from_scale_rotation_translation(scale, unit_quaternion(rotation), translation)
    };
    Ok((0..count).map(transform).collect())
}

fn list<const N: usize>(
    model: &Model,
    accessor: Option<usize>,
    buffers: &mut Buffers<'_>,
) -> Parsed<Option<Vec<[f32; N]>>> {
    let Some(index) = accessor else { return Ok(None) };
    Ok(Some(Elements::open(model, index, &[N], buffers)?.floats::<N>(buffers)?))
}
