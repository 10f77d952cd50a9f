//! Arrays of instances: many instances of a few models or scenes, with a transform each and next to nothing else.

use super::edit::Scene;
use super::measures::check_transform;
use super::model::Model;
use super::tints::{self, NO_TINT, Tint};
use super::values::Values;
use crate::base::error::{Error, Result};
use crate::residency::{Kept, Residency};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use std::mem::discriminant;
use std::ops::Range;
use std::sync::Arc;

/// A position with a rotation and a scale, in 48 bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// The place of the origin of the model or scene, in world space.
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

/// The transforms of an array, from the space of a model or a scene to world space.
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

    /// Bytes of memory of one transform.
    pub(super) fn bytes_each(&self) -> u64 {
        self.bytes() / self.len().max(1) as u64
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

    /// Overwrites transforms from `first` on by those of `by`, which have the same form, in `range`.
    fn overwrite(&mut self, first: usize, by: &Self, range: Range<usize>) {
        let to = first..first + range.len();
        match (self, by) {
            (Self::Affine(all), Self::Affine(by)) => Arc::make_mut(all)[to].copy_from_slice(&by[range]),
            (Self::Affine32(all), Self::Affine32(by)) => Arc::make_mut(all)[to].copy_from_slice(&by[range]),
            (Self::Places(all), Self::Places(by)) => Arc::make_mut(all)[to].copy_from_slice(&by[range]),
            _ => debug_assert!(false, "transforms of another form"),
        }
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

/// The prototypes of an array of instances, at least one.
#[derive(Clone)]
pub enum Prototypes {
    /// Models.
    Models(Vec<Model>),
    /// Scenes, each as committed last when the scene that has the array is committed.
    Scenes(Vec<Scene>),
}

impl Prototypes {
    fn len(&self) -> usize {
        match self {
            Self::Models(all) => all.len(),
            Self::Scenes(all) => all.len(),
        }
    }
}

impl From<Vec<Model>> for Prototypes {
    fn from(models: Vec<Model>) -> Self {
        Self::Models(models)
    }
}

/// Many instances that are added at once.
#[derive(Clone)]
pub struct Instances {
    /// Their models, or their scenes.
    pub prototypes: Prototypes,
    /// Index of each instance's prototype. Empty: all are of the first.
    pub prototype_of: Arc<[u32]>,
    /// The transform of each instance.
    pub transforms: Transforms,
    /// The id of the first instance; each further one has the next higher id.
    pub first_id: u64,
    /// They are visible to rays with a common bit in their masks.
    pub mask: u32,
    /// The mask of each instance, in addition to that of all: rays see it that have a bit in common with what both have
    /// in common. `None`: that of all.
    pub masks: Option<Arc<[u32]>>,
    /// The tint of each instance: linear factors to red, green, blue and opacity of all that it shows, where 255 stands
    /// for 1. Colours of looks, which replace those, have no tint. In scenes in scenes the tints of all levels are
    /// multiplied. `None`: no instance has one.
    pub tints: Option<Arc<[[u8; 4]]>>,
}

/// The memory of arrays, for messages.
const WHAT: &str = "an array of instances";

/// Bytes of memory of transforms, and of the prototypes of their instances.
fn bytes_of(transforms: &Transforms, prototype_of: &[u32]) -> u64 {
    transforms.bytes() + size_of_val(prototype_of) as u64
}

/// Number of transforms of a page: the least that is copied if others hold the array.
const PAGE: usize = 512;

/// The content of an array in a scene.
pub(super) struct Array {
    prototype_of: Arc<[u32]>,
    transforms: Transforms,
    /// Pages of transforms that replace those of `transforms`. Empty if there are none.
    pages: Vec<Option<Transforms>>,
    pub first_id: u64,
    masks: Values<u32>,
    tints: Values<Tint>,
    /// Number of members with see-through tints.
    clear: u32,
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
        if count == 0 || prototypes.len() == 0 {
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
        let of_masks = instances.masks.as_ref().map(|all| (all.len(), "masks"));
        let of_tints = instances.tints.as_ref().map(|all| (all.len(), "tints"));
        if let Some((have, what)) = of_masks.into_iter().chain(of_tints).find(|it| it.0 != count) {
            return bad(format!("{count} transforms, but {have} {what}"));
        }
        transforms.check("instances: instance")?;
        let (prototype_of, transforms) = (Arc::clone(prototype_of), transforms.clone());
        let memory = Arc::new(residency.keep(WHAT, bytes_of(&transforms, &prototype_of))?);
        let (pages, first_id, _pages) = (Vec::new(), *first_id, Kept::default());
        let (masks, tints) = (Values::all(u32::MAX), Values::all(NO_TINT));
        let mut new = Self { prototype_of, transforms, pages, first_id, masks, tints, clear: 0, memory, _pages };
        instances.masks.as_ref().map_or(Ok(()), |all| new.set_masks(0, all, residency))?;
        instances.tints.as_ref().map_or(Ok(()), |all| new.set_tints(0, all, residency))?;
        Ok(new)
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

    /// The mask of a member, without that of all.
    #[inline]
    pub fn mask(&self, member: u32) -> u32 {
        self.masks.get(member)
    }

    /// The tint of a member.
    #[inline]
    pub fn tint(&self, member: u32) -> Tint {
        self.tints.get(member)
    }

    /// True if members have masks of their own.
    pub fn has_masks(&self) -> bool {
        !self.masks.are_plain()
    }

    /// True if members have tints.
    pub fn has_tints(&self) -> bool {
        !self.tints.are_plain()
    }

    /// True if members have see-through tints.
    pub fn has_clear(&self) -> bool {
        self.clear > 0
    }

    /// The factors to the colours of a member in the cells above it. `None`: it is in none.
    pub fn in_cells(&self, member: u32) -> Option<Vec3> {
        tints::in_cells(self.mask(member), self.tint(member))
    }

    /// True if a member is shown here as in another array.
    pub fn shows_as(&self, other: &Self, member: u32) -> bool {
        (self.mask(member), self.tint(member)) == (other.mask(member), other.tint(member))
    }

    /// The member with an id.
    pub fn member(&self, id: u64) -> Option<u32> {
        let at = id.checked_sub(self.first_id)?;
        (at < u64::from(self.len())).then_some(at as u32)
    }

    /// The indices as they were given: empty if all members are of the first prototype.
    pub fn indices(&self) -> &[u32] {
        &self.prototype_of
    }

    /// The form of the transforms.
    pub fn form(&self) -> &Transforms {
        &self.transforms
    }

    /// The transforms in their form, in order: in pieces, each a range of others.
    pub fn pieces(&self) -> impl Iterator<Item = (&Transforms, Range<usize>)> {
        let count = self.transforms.len();
        (0..count.div_ceil(PAGE)).map(move |at| match self.pages.get(at) {
            Some(Some(page)) => (page, 0..page.len()),
            _ => (&self.transforms, at * PAGE..count.min((at + 1) * PAGE)),
        })
    }

    /// The index of each member's prototype.
    pub fn prototypes(&self) -> impl Iterator<Item = usize> {
        (0..self.len()).map(|member| self.prototype_of(member) as usize)
    }

    /// Replaces the transforms of members from `first` on. What others hold stays as it is: pages that change are
    /// copied, or all if most change. The copies count against the budget too. Fails with `BadArgument` for transforms
    /// of another form, or for the first that is wrong, and with `OverBudget`; then nothing has changed.
    pub fn replace(this: &mut Arc<Self>, first: u32, by: &Transforms, residency: &Residency) -> Result<()> {
        by.check("transform")?;
        if discriminant(by) != discriminant(&this.transforms) {
            return Err(Error::bad_argument("the instances of the array have transforms of another form"));
        }
        Self::own(this, by.len() > this.transforms.len() / 2, residency)?.overwrite(first as usize, by, residency)
    }

    /// The array itself, or a copy in its place if others hold it; `is_whole`: with transforms of its own. Fails with
    /// `OverBudget`.
    pub fn own<'a>(this: &'a mut Arc<Self>, is_whole: bool, residency: &Residency) -> Result<&'a mut Self> {
        if Arc::get_mut(this).is_none() {
            *this = Arc::new(this.copy(is_whole, residency)?);
        }
        Arc::get_mut(this).ok_or_else(|| Error::Internal("an array is shared".into()))
    }

    /// Replaces the masks of members from `first` on, in copied pages. Fails with `OverBudget`; then nothing has
    /// changed.
    pub fn set_masks(&mut self, first: u32, by: &[u32], residency: &Residency) -> Result<()> {
        self.masks = self.masks.replaced(self.transforms.len(), first as usize, by, residency)?;
        Ok(())
    }

    /// [`Array::set_masks`] for tints.
    pub fn set_tints(&mut self, first: u32, by: &[Tint], residency: &Residency) -> Result<()> {
        let tints = self.tints.replaced(self.transforms.len(), first as usize, by, residency)?;
        let old = (first..first + by.len() as u32).filter(|member| tints::is_clear(self.tint(*member))).count();
        let new = by.iter().filter(|tint| tints::is_clear(**tint)).count();
        (self.tints, self.clear) = (tints, self.clear - old as u32 + new as u32);
        Ok(())
    }

    /// A copy that shares the pages of this array, or with transforms of its own.
    fn copy(&self, is_whole: bool, residency: &Residency) -> Result<Self> {
        let (prototype_of, first_id) = (Arc::clone(&self.prototype_of), self.first_id);
        let (masks, tints, clear) = (self.masks.clone(), self.tints.clone(), self.clear);
        if !is_whole {
            let (transforms, pages, memory) = (self.transforms.clone(), self.pages.clone(), Arc::clone(&self.memory));
            let _pages = residency.keep(WHAT, self.bytes_of_pages(0))?;
            return Ok(Self { prototype_of, transforms, pages, first_id, masks, tints, clear, memory, _pages });
        }
        let memory = Arc::new(residency.keep(WHAT, bytes_of(&self.transforms, &prototype_of))?);
        let mut transforms = self.transforms.copy(0..self.transforms.len());
        for (at, page) in self.pages.iter().enumerate() {
            if let Some(page) = page {
                transforms.overwrite(at * PAGE, page, 0..page.len());
            }
        }
        let (pages, _pages) = (Vec::new(), Kept::default());
        Ok(Self { prototype_of, transforms, pages, first_id, masks, tints, clear, memory, _pages })
    }

    /// Bytes of the pages, and of so many more.
    fn bytes_of_pages(&self, more: usize) -> u64 {
        let count = self.transforms.len();
        let (table, page) =
            (count.div_ceil(PAGE) * size_of::<Option<Transforms>>(), self.transforms.bytes() * PAGE as u64);
        let pages = self.pages.iter().flatten().count() + more;
        if pages == 0 { 0 } else { table as u64 + pages as u64 * page.div_ceil(count as u64) }
    }

    /// Overwrites transforms from `first` on: in pages where others hold `transforms`.
    fn overwrite(&mut self, first: usize, by: &Transforms, residency: &Residency) -> Result<()> {
        let count = self.transforms.len();
        let is_own = Arc::strong_count(&self.memory) == 1;
        let touched = first / PAGE..(first + by.len()).div_ceil(PAGE);
        let has_page = |at: usize| self.pages.get(at).is_some_and(Option::is_some);
        let more = if is_own { 0 } else { touched.clone().filter(|at| !has_page(*at)).count() };
        if more > 0 {
            self._pages.grow_to(residency, WHAT, self.bytes_of_pages(more))?;
            self.pages.resize(count.div_ceil(PAGE), None);
        }
        for at in touched {
            let begin = at * PAGE;
            let [from, to] = [first, first + by.len()].map(|member| member.clamp(begin, begin + PAGE));
            let range = from - first..to - first;
            match self.pages.get_mut(at) {
                Some(Some(page)) => page.overwrite(from - begin, by, range),
                Some(page) if !is_own => {
                    page.insert(self.transforms.copy(begin..count.min(begin + PAGE))).overwrite(from - begin, by, range)
                }
                _ => self.transforms.overwrite(from, by, range),
            }
        }
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

    /// Ranges of any size are replaced, within a page, across pages, and of more than half of the array. A copy of the
    /// array that is held meanwhile does not change.
    #[test]
    fn ranges_of_transforms_are_replaced_in_copies() {
        let residency = Residency::new(ResidencyOptions { budget: 1 << 30, promote: false });
        let map = |value: usize| DAffine3::from_translation(DVec3::splat(value as f64));
        let mut expected: Vec<DAffine3> = (0..1500).map(map).collect();
        let (prototype_of, first_id) = (Arc::new([]), 7);
        let (pages, _pages, memory) = (Vec::new(), Kept::default(), Arc::default());
        let transforms = Transforms::Affine(expected.clone().into());
        let (masks, tints, clear) = (Values::all(u32::MAX), Values::all(NO_TINT), 0);
        let mut array =
            Arc::new(Array { prototype_of, transforms, pages, first_id, masks, tints, clear, memory, _pages });
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
