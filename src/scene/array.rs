//! Arrays of instances: many instances of a few models, with a transform each and next to nothing else.

use super::measures::check_transform;
use super::model::Model;
use crate::base::error::{Error, Result};
use crate::residency::{Kept, Residency};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use std::ops::Range;
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

    /// Overwrites transforms from `first` on by those of `by` in `range`. Fails with `BadArgument` for those of another
    /// form.
    fn overwrite(&mut self, first: usize, by: &Self, range: Range<usize>) -> Result<()> {
        let to = first..first + range.len();
        match (self, by) {
            (Self::Affine(all), Self::Affine(by)) => Arc::make_mut(all)[to].copy_from_slice(&by[range]),
            (Self::Affine32(all), Self::Affine32(by)) => Arc::make_mut(all)[to].copy_from_slice(&by[range]),
            (Self::Places(all), Self::Places(by)) => Arc::make_mut(all)[to].copy_from_slice(&by[range]),
            _ => return Err(Error::bad_argument("the instances of the array have transforms of another form")),
        }
        Ok(())
    }

    /// A copy of some.
    fn copy(&self, range: Range<usize>) -> Self {
        match self {
            Self::Affine(all) => Self::Affine(all[range].into()),
            Self::Affine32(all) => Self::Affine32(all[range].into()),
            Self::Places(all) => Self::Places(all[range].into()),
        }
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

/// Number of transforms of a page: the least that is copied if others hold the array.
const PAGE: usize = 512;

/// The content of an array in a scene.
pub(super) struct Array {
    prototype_of: Arc<[u32]>,
    transforms: Transforms,
    /// Pages of transforms that replace those of `transforms`. Empty if there are none.
    pages: Vec<Option<Transforms>>,
    pub first_id: u64,
    /// Of `transforms`, shared with the arrays that this one is made of.
    memory: Arc<Kept>,
    _pages: Kept,
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
        let memory = Arc::new(residency.keep(WHAT, transforms.bytes() + size_of_val(&*prototype_of) as u64)?);
        let (pages, first_id) = (Vec::new(), *first_id);
        Ok(Self { prototype_of, transforms, pages, first_id, memory, _pages: Kept::default() })
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
        let member = member as usize;
        match self.pages.get(member / PAGE) {
            Some(Some(page)) => page.get(member % PAGE),
            _ => self.transforms.get(member),
        }
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

    /// Replaces the transforms of members from `first` on. Where others hold the array, replaces it by one with copies
    /// of the pages that change, or of all if most do. The copies count against the budget too. Fails with
    /// `BadArgument` for transforms of another form, or for the first that is wrong, and with `OverBudget`.
    pub fn replace(this: &mut Arc<Self>, first: u32, by: &Transforms, residency: &Residency) -> Result<()> {
        by.check("transform")?;
        let (first, count) = (first as usize, this.transforms.len());
        if let Some(own) = Arc::get_mut(this)
            && own.pages.is_empty()
        {
            return own.transforms.overwrite(first, by, 0..by.len());
        }
        let (prototype_of, first_id) = (Arc::clone(&this.prototype_of), this.first_id);
        if by.len() > count / 2 {
            let memory = residency.keep(WHAT, this.transforms.bytes() + size_of_val(&*prototype_of) as u64)?;
            let mut transforms = this.transforms.copy(0..count);
            for (at, page) in this.pages.iter().enumerate().filter_map(|(at, page)| Some((at, page.as_ref()?))) {
                transforms.overwrite(at * PAGE, page, 0..page.len())?;
            }
            transforms.overwrite(first, by, 0..by.len())?;
            let (pages, memory) = (Vec::new(), Arc::new(memory));
            *this = Arc::new(Self { prototype_of, transforms, pages, first_id, memory, _pages: Kept::default() });
            return Ok(());
        }
        let mut pages = this.pages.clone();
        pages.resize(count.div_ceil(PAGE), None);
        for (at, page) in pages.iter_mut().enumerate().take((first + by.len()).div_ceil(PAGE)).skip(first / PAGE) {
            let begin = at * PAGE;
            let [from, to] = [first, first + by.len()].map(|member| member.clamp(begin, begin + PAGE));
            let page = page.get_or_insert_with(|| this.transforms.copy(begin..count.min(begin + PAGE)));
            page.overwrite(from - begin, by, from - first..to - first)?;
        }
        let table = (pages.len() * size_of::<Option<Transforms>>()) as u64;
        let bytes = table + pages.iter().flatten().map(Transforms::bytes).sum::<u64>();
        let _pages = residency.keep(WHAT, bytes)?;
        let (transforms, memory) = (this.transforms.clone(), Arc::clone(&this.memory));
        *this = Arc::new(Self { prototype_of, transforms, pages, first_id, memory, _pages });
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::residency::ResidencyOptions;

    /// Any ranges may be replaced, across pages and by more than half of them; who holds the array before keeps it.
    #[test]
    fn ranges_of_transforms_are_replaced_in_copies() {
        let residency = Residency::new(ResidencyOptions { budget: 1 << 30, promote: false });
        let map = |value: usize| DAffine3::from_translation(DVec3::splat(value as f64));
        let mut expected: Vec<DAffine3> = (0..1500).map(map).collect();
        let (prototype_of, first_id) = (Arc::new([]), 7);
        let (pages, _pages, memory) = (Vec::new(), Kept::default(), Arc::default());
        let transforms = Transforms::Affine(expected.clone().into());
        let mut array = Arc::new(Array { prototype_of, transforms, pages, first_id, memory, _pages });
        let all = |array: &Array| (0..1500).map(|member| array.transform(member)).collect::<Vec<_>>();
        let mut held: Vec<(Arc<Array>, Vec<DAffine3>)> = Vec::new();
        let ranges = [5..6, 511..513, 512..1024, 1499..1500, 3..700, 1000..1500, 10..1400, 0..1500, 1023..1025];
        for (round, range) in ranges.into_iter().enumerate() {
            for is_held in [true, false] {
                if is_held {
                    held.push((Arc::clone(&array), expected.clone()));
                }
                let by: Vec<DAffine3> = range.clone().map(|member| map(10_000 * (round + 1) + member)).collect();
                expected[range.clone()].copy_from_slice(&by);
                let by = Transforms::Affine(by.into());
                Array::replace(&mut array, range.start as u32, &by, &residency).expect("transforms");
                assert!(all(&array) == expected, "{range:?}");
                assert!(held.iter().all(|(array, was)| all(array) == *was), "{range:?}");
            }
        }
        let other = Transforms::Affine32([[0.0; 12]].into());
        assert!(Array::replace(&mut array, 0, &other, &residency).is_err());
    }
}
