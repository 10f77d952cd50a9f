//! Arrays of instances: many instances of a few models, with a transform each and next to nothing else.

use super::model::Model;
use super::placed::check_transform;
use crate::base::error::{Error, Result};
use crate::residency::{Kept, Residency};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use std::sync::Arc;

/// A position with a rotation and a scale, in 48 bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// The place of the model's origin, in world space.
    pub position: DVec3,
    /// Quaternion x, y, z, w of the rotation, applied after the scale. Its length must not be 0, and is ignored.
    pub rotation: [f32; 4],
    /// Scale along all axes: finite, not 0. Below 0 it mirrors at the origin.
    pub scale: f32,
}

impl Place {
    /// The affine map, in double precision.
    fn affine(&self) -> DAffine3 {
        let [x, y, z, w] = self.rotation.map(f64::from);
        let turn = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        DAffine3 { matrix3: turn * f64::from(self.scale), translation: self.position }
    }
}

/// The transforms of an array, from model to world space.
#[derive(Debug, Clone)]
pub enum Transforms {
    /// Affine maps, 96 bytes each.
    Affine(Arc<[DAffine3]>),
    /// Affine maps in single precision, 48 bytes each: three columns of the linear part, then the translation.
    Affine32(Arc<[[f32; 12]]>),
    /// Positions in double precision with rotation and scale, 48 bytes each.
    Places(Arc<[Place]>),
}

impl Transforms {
    /// Number of transforms.
    pub fn len(&self) -> usize {
        match self {
            Self::Affine(all) => all.len(),
            Self::Affine32(all) => all.len(),
            Self::Places(all) => all.len(),
        }
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes of memory.
    fn bytes(&self) -> u64 {
        let bytes = match self {
            Self::Affine(all) => size_of_val(&**all),
            Self::Affine32(all) => size_of_val(&**all),
            Self::Places(all) => size_of_val(&**all),
        };
        bytes as u64
    }

    /// Transform `i`.
    #[inline]
    fn get(&self, i: usize) -> DAffine3 {
        match self {
            Self::Affine(all) => all[i],
            Self::Affine32(all) => DAffine3::from_cols_array(&all[i].map(f64::from)),
            Self::Places(all) => all[i].affine(),
        }
    }

    /// Fails with `BadArgument`, which names the first transform that is wrong, after `what`.
    fn check(&self, what: &str) -> Result<()> {
        (0..self.len()).try_for_each(|i| match check_transform(&self.get(i)) {
            Err(Error::BadArgument(why)) => Err(Error::BadArgument(format!("{what} {i}: {why}"))),
            other => other,
        })
    }

    /// Overwrites transforms from `first` on. Fails with `BadArgument` for those of another form.
    fn overwrite(&mut self, first: usize, by: &Self) -> Result<()> {
        let range = first..first + by.len();
        match (self, by) {
            (Self::Affine(all), Self::Affine(by)) => Arc::make_mut(all)[range].copy_from_slice(by),
            (Self::Affine32(all), Self::Affine32(by)) => Arc::make_mut(all)[range].copy_from_slice(by),
            (Self::Places(all), Self::Places(by)) => Arc::make_mut(all)[range].copy_from_slice(by),
            _ => return Err(Error::bad_argument("the instances of the array have transforms of another form")),
        }
        Ok(())
    }
}

/// Many instances that are added at once.
#[derive(Clone)]
pub struct Instances {
    /// The models, at least one.
    pub prototypes: Vec<Model>,
    /// Index among the prototypes of each instance's model. Empty: all are of the first.
    pub prototype_of: Arc<[u32]>,
    /// The transform of each instance.
    pub transforms: Transforms,
    /// The id of the first instance; each further one has the next higher id.
    pub first_id: u64,
    /// They are visible to rays with a common bit in their masks.
    pub mask: u32,
}

/// The memory of arrays, for messages.
const WHAT: &str = "an array of instances";

/// The content of an array in a scene.
pub(super) struct Array {
    prototype_of: Arc<[u32]>,
    transforms: Transforms,
    pub first_id: u64,
    _memory: Kept,
}

impl Array {
    /// Checks the instances. Fails with `BadArgument`, which names the first that is wrong, and with `OverBudget`.
    pub fn new(instances: &Instances, residency: &Residency) -> Result<Self> {
        let Instances { prototypes, prototype_of, transforms, first_id, .. } = instances;
        let bad = |why: String| Err(Error::bad_argument(format!("instances: {why}")));
        let count = transforms.len();
        if count == 0 || prototypes.is_empty() {
            return bad("there must be at least one transform and one prototype".into());
        }
        if !prototype_of.is_empty() && prototype_of.len() != count {
            return bad(format!("{count} transforms, but {} indices of prototypes", prototype_of.len()));
        }
        if let Some(i) = prototype_of.iter().position(|&it| it as usize >= prototypes.len()) {
            let (given, have) = (prototype_of[i], prototypes.len());
            return bad(format!("instance {i} has prototype {given}, of {have}"));
        }
        // The highest id stands for no instance.
        if first_id.checked_add(count as u64).is_none() {
            return bad(format!("{count} ids from {first_id} on are too many"));
        }
        transforms.check("instances: instance")?;
        let (prototype_of, transforms) = (Arc::clone(prototype_of), transforms.clone());
        let mut array = Self { prototype_of, transforms, first_id: *first_id, _memory: Kept::default() };
        array._memory = residency.keep(WHAT, array.bytes())?;
        Ok(array)
    }

    /// Number of its members.
    pub fn len(&self) -> u32 {
        self.transforms.len() as u32
    }

    /// Index of the prototype of a member.
    #[inline]
    pub fn prototype_of(&self, member: u32) -> u32 {
        self.prototype_of.get(member as usize).copied().unwrap_or(0)
    }

    /// The map of a member to the world.
    #[inline]
    pub fn transform(&self, member: u32) -> DAffine3 {
        self.transforms.get(member as usize)
    }

    /// The member with an id.
    pub fn member(&self, id: u64) -> Option<u32> {
        let at = id.checked_sub(self.first_id)?;
        (at < u64::from(self.len())).then_some(at as u32)
    }

    /// The index of each member's prototype.
    pub fn prototypes(&self) -> impl Iterator<Item = usize> {
        (0..self.len()).map(|member| self.prototype_of(member) as usize)
    }

    /// Replaces the transforms of members from `first` on. Where others hold the array, replaces it by a copy, which
    /// counts against the budget too. Fails with `BadArgument` for transforms of another form, or for the first that is
    /// wrong, and with `OverBudget`.
    pub fn replace(this: &mut Arc<Self>, first: u32, by: &Transforms, residency: &Residency) -> Result<()> {
        by.check("transform")?;
        if let Some(own) = Arc::get_mut(this) {
            return own.transforms.overwrite(first as usize, by);
        }
        let memory = residency.keep(WHAT, this.bytes())?;
        // The first write copies them.
        let (prototype_of, mut transforms) = (Arc::clone(&this.prototype_of), this.transforms.clone());
        transforms.overwrite(first as usize, by)?;
        *this = Arc::new(Self { prototype_of, transforms, first_id: this.first_id, _memory: memory });
        Ok(())
    }

    /// The transforms that stand for an affine map in the form of the array. Fails with `BadArgument` if it has places.
    pub fn in_form(&self, map: &DAffine3) -> Result<Transforms> {
        match self.transforms {
            Transforms::Affine(_) => Ok(Transforms::Affine([*map].into())),
            Transforms::Affine32(_) => Ok(Transforms::Affine32([map.to_cols_array().map(|x| x as f32)].into())),
            Transforms::Places(_) => Err(Error::bad_argument("the array has places, and takes no affine maps")),
        }
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        self.transforms.bytes() + size_of_val(&*self.prototype_of) as u64
    }
}
