//! Sets of parts.

use crate::base::error::{Error, Result};
use crate::base::memory::room;
use crate::lod::summary_bit;
use crate::residency::Kept;
use crate::scene::SceneState;

/// A set of parts of a scene. Instances and parts are named by the caller's ids.
#[derive(Debug, Clone, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct PartSet {
    entries: Vec<Entry>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Entry {
    All,
    Instance(u64),
    /// A part with all parts below it: of one instance, or of all instances of models that have it.
    Part(Option<u64>, u64),
}

impl PartSet {
    /// The set of all parts of all instances.
    pub fn all() -> Self {
        Self { entries: vec![Entry::All] }
    }

    /// Adds all parts of an instance.
    pub fn add_instance(&mut self, instance: u64) {
        self.entries.push(Entry::Instance(instance));
    }

    /// Adds a part with all parts below it: of `instance`, or if that is `None`, of all instances whose model has it.
    pub fn add_part(&mut self, instance: Option<u64>, part: u64) {
        self.entries.push(Entry::Part(instance, part));
    }

    /// True if nothing was added.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }
}

/// The members of a [`PartSet`] among the instances and parts of a scene, by their indices.
pub(in crate::query) struct Members {
    of: Vec<Of>,
    _memory: Kept,
}

/// Number of instances, and of placed trees, that a scene must not reach. Searches among parts number them in 32 bits.
const MOST: usize = 1 << 31;
/// Sets of fewer bytes do not count against the budget.
const UNCOUNTED: usize = 16 << 20;

/// The members among the parts of an instance.
enum Of {
    None,
    All,
    /// Bit `i % 64` of word `i / 64`: part `i` is a member.
    Some(Vec<u64>),
}

impl Members {
    /// The visible members of `set`. Fails with `BadArgument` for an instance or part that the scene lacks.
    pub fn of(scene: &SceneState, set: &PartSet, name: &str) -> Result<Self> {
        let count = scene.instance_count();
        if count.max(usize::try_from(scene.placement.len()).unwrap_or(MOST)) >= MOST {
            let why = "sets of parts need a scene of fewer than 2^31 placed meshes and instances";
            return Err(Error::BadArgument(format!("{name}: {why}")));
        }
        let (what, bytes) = ("a set of parts", count * size_of::<Of>());
        let memory = if bytes > UNCOUNTED { bytes as u64 } else { 0 };
        let memory = scene.context().residency().keep(what, memory)?;
        let mut all = room(count, what)?;
        all.extend((0..count).map(|_| Of::None));
        let (ids, everywhere) = (scene.instance_ids(), 0..count as u64);
        for entry in &set.entries {
            let mut is_known = false;
            let instances = match *entry {
                Entry::All | Entry::Part(None, _) => everywhere.clone(),
                Entry::Instance(id) | Entry::Part(Some(id), _) => ids.with(id),
            };
            for instance in instances {
                let of = &mut all[instance as usize];
                let Entry::Part(_, part) = *entry else {
                    (*of, is_known) = (Of::All, true);
                    continue;
                };
                let model = scene.model_of_instance(instance);
                if let Some(part) = model.part_index(part) {
                    of.add(&model.parts().with_all_below(part));
                    is_known = true;
                }
            }
            match *entry {
                Entry::All => {}
                _ if is_known => {}
                Entry::Instance(id) => {
                    return Err(Error::BadArgument(format!("{name}: the scene has no instance {id}")));
                }
                Entry::Part(None, part) => {
                    return Err(Error::BadArgument(format!("{name}: no model of the scene has a part {part}")));
                }
                Entry::Part(Some(id), part) => {
                    return Err(Error::BadArgument(format!(
                        "{name}: the scene has no instance {id} with a part {part}"
                    )));
                }
            }
        }
        Ok(Self { of: all, _memory: memory })
    }

    /// True if a part of an instance is a member.
    #[inline]
    pub fn has(&self, instance: u64, part: u32) -> bool {
        match &self.of[instance as usize] {
            Of::None => false,
            Of::All => true,
            Of::Some(bits) => bits.get(part as usize / 64).is_some_and(|word| word >> (part % 64) & 1 == 1),
        }
    }

    /// True if all parts of an instance are members.
    pub fn has_all(&self, instance: u64) -> bool {
        matches!(self.of[instance as usize], Of::All)
    }

    /// True if one of `count` parts of an instance, from `first` on, is a member.
    pub fn has_any(&self, instance: u64, first: u32, count: u32) -> bool {
        match &self.of[instance as usize] {
            Of::None => false,
            Of::All => count > 0,
            Of::Some(_) => (first..first.saturating_add(count)).any(|part| self.has(instance, part)),
        }
    }
}

impl Members {
    /// The bits (`lod::summary_bit`) of the members among `count` parts of an instance from `first` on, as parts of
    /// their tree.
    pub fn bits(&self, instance: u64, first: u32, count: u32) -> u32 {
        match &self.of[instance as usize] {
            Of::None => 0,
            Of::All => u32::MAX,
            Of::Some(_) => (0..count)
                .filter(|part| self.has(instance, first.saturating_add(*part)))
                .fold(0, |all, part| all | summary_bit(part)),
        }
    }
}

impl Of {
    fn add(&mut self, bits: &[u64]) {
        match self {
            Self::All => {}
            Self::None => *self = Self::Some(bits.to_vec()),
            Self::Some(own) => {
                own.resize(own.len().max(bits.len()), 0);
                own.iter_mut().zip(bits).for_each(|(own, bits)| *own |= bits);
            }
        }
    }
}
