//! Positions of the vertices of a primitive in the file's default pose: morph targets at their default weights, and
//! skinned vertices at their joints.

use super::accessor::Elements;
use super::buffers::Buffers;
use super::model::{Model, Primitive};
use super::scene::Worlds;
use crate::import::input::{Fault, Parsed};
use glam::{DAffine3, DMat3, DVec3};
use std::collections::HashMap;
use std::rc::Rc;

/// The pose of a mesh at a node.
#[derive(Clone, Default)]
pub(crate) struct Pose {
    /// Weights of the morph targets.
    pub(crate) weights: Rc<[f64]>,
    /// Transform of each joint from the mesh to the world, for a skinned mesh.
    pub(crate) joints: Option<Rc<[DAffine3]>>,
}

/// Vertex positions, which need double precision only if they were computed.
pub(crate) enum Positions {
    AsStored(Vec<[f32; 3]>),
    /// In mesh coordinates.
    Morphed(Vec<DVec3>),
    /// In world coordinates.
    Skinned(Vec<DVec3>),
}

impl Positions {
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::AsStored(list) => list.len(),
            Self::Morphed(list) | Self::Skinned(list) => list.len(),
        }
    }

    /// Returns the position of a vertex that exists.
    #[inline]
    pub(crate) fn get(&self, vertex: usize) -> DVec3 {
        match self {
            Self::AsStored(list) => DVec3::from(list[vertex].map(f64::from)),
            Self::Morphed(list) | Self::Skinned(list) => list[vertex],
        }
    }

    fn into_double(self) -> Vec<DVec3> {
        match self {
            Self::AsStored(list) => list.into_iter().map(|p| DVec3::from(p.map(f64::from))).collect(),
            Self::Morphed(list) | Self::Skinned(list) => list,
        }
    }
}

/// Reads the positions of a primitive in a pose. `accessor` holds the stored positions.
pub(crate) fn positions(
    model: &Model,
    primitive: &Primitive,
    accessor: usize,
    pose: &Pose,
    buffers: &mut Buffers<'_>,
) -> Parsed<Positions> {
    let stored = Elements::open(model, accessor, &[3], buffers)?.floats::<3>(buffers)?;
    let morphed = morphed(model, primitive, Positions::AsStored(stored), &pose.weights, buffers)?;
    match &pose.joints {
        Some(joints) if is_skinned(primitive) => skinned(model, primitive, morphed, joints, buffers),
        _ => Ok(morphed),
    }
}

/// True if the primitive has joints and weights.
pub(crate) fn is_skinned(primitive: &Primitive) -> bool {
    primitive.attribute("JOINTS_0").is_some() && primitive.attribute("WEIGHTS_0").is_some()
}

/// Adds the weighted displacements of the morph targets.
fn morphed(
    model: &Model,
    primitive: &Primitive,
    mut positions: Positions,
    weights: &[f64],
    buffers: &mut Buffers<'_>,
) -> Parsed<Positions> {
    for (&target, &weight) in primitive.targets.iter().zip(weights) {
        let Some(accessor) = target.filter(|_| weight != 0.0) else { continue };
        let displacements = Elements::open(model, accessor, &[3], buffers)?.floats::<3>(buffers)?;
        if displacements.len() != positions.len() {
            return Err(differing("displacements of a morph target", displacements.len(), positions.len()));
        }
        let mut sum = positions.into_double();
        for (position, displacement) in sum.iter_mut().zip(displacements) {
            *position += weight * DVec3::from(displacement.map(f64::from));
        }
        positions = Positions::Morphed(sum);
    }
    Ok(positions)
}

/// Sum of weighted transforms of joints.
#[derive(Clone, Copy)]
struct Blend {
    matrix: DMat3,
    translation: DVec3,
    weight: f64,
}

/// Moves each vertex by the mean of its joints' transforms, weighted by `WEIGHTS_n`.
fn skinned(
    model: &Model,
    primitive: &Primitive,
    positions: Positions,
    joints: &[DAffine3],
    buffers: &mut Buffers<'_>,
) -> Parsed<Positions> {
    let mut positions = positions.into_double();
    let nothing = Blend { matrix: DMat3::ZERO, translation: DVec3::ZERO, weight: 0.0 };
    let mut blends = vec![nothing; positions.len()];
    let mut first_joints = vec![0; positions.len()];
    for set in 0.. {
        let attribute = |name: &str| primitive.attribute(&format!("{name}_{set}"));
        let (Some(of), Some(weights)) = (attribute("JOINTS"), attribute("WEIGHTS")) else { break };
        let of = Elements::open(model, of, &[4], buffers)?.floats::<4>(buffers)?;
        let weights = Elements::open(model, weights, &[4], buffers)?.floats::<4>(buffers)?;
        if of.len() != positions.len() || weights.len() != positions.len() {
            return Err(differing("joints and weights", of.len().min(weights.len()), positions.len()));
        }
        for (vertex, (of, weights)) in of.iter().zip(&weights).enumerate() {
            if set == 0 {
                first_joints[vertex] = of[0] as usize;
            }
            for (&joint, &weight) in of.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
                blends[vertex].add(joint_of(joints, joint as usize)?, f64::from(weight));
            }
        }
    }
    for (vertex, (position, mut blend)) in positions.iter_mut().zip(blends).enumerate() {
        if blend.weight == 0.0 {
            // A vertex without weights belongs to its first joint.
            blend.add(joint_of(joints, first_joints[vertex])?, 1.0);
        }
        *position = (blend.matrix * *position + blend.translation) / blend.weight;
    }
    Ok(Positions::Skinned(positions))
}

impl Blend {
    fn add(&mut self, joint: &DAffine3, weight: f64) {
        self.matrix += joint.matrix3 * weight;
        self.translation += joint.translation * weight;
        self.weight += weight;
    }
}

fn joint_of(joints: &[DAffine3], index: usize) -> Parsed<&DAffine3> {
    joints.get(index).ok_or_else(|| Fault::Why(format!("a vertex refers to joint {index} of {}", joints.len())))
}

fn differing(what: &str, found: usize, positions: usize) -> Fault {
    Fault::Why(format!("{found} {what} for {positions} positions"))
}

/// The skins of a document that were used so far.
#[derive(Default)]
pub(crate) struct Skins<'m> {
    worlds: Option<Worlds<'m>>,
    known: HashMap<usize, Rc<[DAffine3]>>,
}

impl<'m> Skins<'m> {
    /// Returns the transforms of the joints of skin `index`: from the mesh to the joint, and to the world.
    pub(crate) fn joints(
        &mut self,
        index: usize,
        model: &'m Model,
        buffers: &mut Buffers<'_>,
    ) -> Parsed<Rc<[DAffine3]>> {
        if let Some(joints) = self.known.get(&index) {
            return Ok(Rc::clone(joints));
        }
        let named = |fault: Fault| super::within(&format!("skins[{index}]"), fault);
        let skin = model.skins.get(index)?;
        let inverse_bind = match skin.inverse_bind {
            Some(accessor) => Some(matrices(model, accessor, buffers).map_err(named)?),
            None => None,
        };
        if let Some(found) = inverse_bind.as_ref().map(Vec::len).filter(|&found| found < skin.joints.len()) {
            return Err(named(format!("{found} inverse bind matrices for {} joints", skin.joints.len()).into()));
        }
        let worlds = self.worlds.get_or_insert_with(|| Worlds::new(model));
        let mut joints = Vec::with_capacity(skin.joints.len());
        for (i, &joint) in skin.joints.iter().enumerate() {
            let from_mesh = inverse_bind.as_ref().map_or(DAffine3::IDENTITY, |list| list[i]);
            joints.push(worlds.of(joint).map_err(named)? * from_mesh);
        }
        let joints: Rc<[DAffine3]> = joints.into();
        self.known.insert(index, Rc::clone(&joints));
        Ok(joints)
    }
}

fn matrices(model: &Model, accessor: usize, buffers: &mut Buffers<'_>) -> Parsed<Vec<DAffine3>> {
    let list = Elements::open(model, accessor, &[16], buffers)?.floats::<16>(buffers)?;
    let affine = |m: [f32; 16]| {
        let column = |i: usize| DVec3::new(m[4 * i].into(), m[4 * i + 1].into(), m[4 * i + 2].into());
        DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(1), column(2)), column(3))
    };
    Ok(list.into_iter().map(affine).collect())
}
