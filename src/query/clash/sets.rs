//! Sets of parts, and rules for pairs of parts that are not compared.

use crate::base::error::{Error, Result};
use crate::lod::summary_bit;
use crate::scene::SceneState;
use crate::scene::model::PartInfo;
use std::collections::HashSet;

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

/// Pairs of parts that are not compared.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ClashRules {
    /// Skips pairs in instances of one model.
    pub same_model: bool,
    /// Skips pairs in one instance.
    pub same_instance: bool,
    /// Skips pairs of one instance whose parts have the same parent part.
    pub same_parent: bool,
    /// Skips pairs of one model whose parts have equal materials.
    pub same_material: bool,
    /// Skips these pairs of parts, in any instances and either order.
    pub pairs: Vec<[u64; 2]>,
}

/// The members of a [`PartSet`] among the instances and parts of a scene, by their indices.
pub(in crate::query) struct Members(Vec<Of>);

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
        let mut all: Vec<Of> = scene.instances.iter().map(|_| Of::None).collect();
        for entry in &set.entries {
            let mut is_known = false;
            for (instance, of) in scene.instances.iter().zip(&mut all) {
                match *entry {
                    Entry::All => (*of, is_known) = (Of::All, true),
                    Entry::Instance(id) if id == instance.id => (*of, is_known) = (Of::All, true),
                    Entry::Instance(_) => {}
                    Entry::Part(of_instance, part) => {
                        if of_instance.is_none_or(|id| id == instance.id) {
                            let model = &scene.models[instance.model as usize];
                            if let Some(part) = model.part_index(part) {
                                of.add(&model.parts().with_all_below(part));
                                is_known = true;
                            }
                        }
                    }
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
        Ok(Self(all))
    }

    /// True if a part of an instance is a member.
    #[inline]
    pub fn has(&self, instance: u32, part: u32) -> bool {
        match &self.0[instance as usize] {
            Of::None => false,
            Of::All => true,
            Of::Some(bits) => bits.get(part as usize / 64).is_some_and(|word| word >> (part % 64) & 1 == 1),
        }
    }

    /// True if all parts of an instance are members.
    pub fn has_all(&self, instance: u32) -> bool {
        matches!(self.0[instance as usize], Of::All)
    }

    /// True if one of `count` parts of an instance, from `first` on, is a member.
    pub fn has_any(&self, instance: u32, first: u32, count: u32) -> bool {
        match &self.0[instance as usize] {
            Of::None => false,
            Of::All => count > 0,
            Of::Some(_) => (first..first.saturating_add(count)).any(|part| self.has(instance, part)),
        }
    }
}

impl Members {
    /// The bits (`lod::summary_bit`) of the members among `count` parts of an instance from `first` on, as parts of
    /// their tree.
    pub fn bits(&self, instance: u32, first: u32, count: u32) -> u32 {
        match &self.0[instance as usize] {
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

fn material(part: &PartInfo) -> ([f32; 4], f32, f32) {
    (part.colour, part.metalness, part.roughness)
}

/// [`ClashRules`], prepared for a scene.
pub(super) struct Rules<'a> {
    scene: &'a SceneState,
    rules: &'a ClashRules,
    /// Both orders of each listed pair.
    pairs: HashSet<[u64; 2]>,
}

impl<'a> Rules<'a> {
    pub fn new(scene: &'a SceneState, rules: &'a ClashRules) -> Self {
        let pairs = rules.pairs.iter().flat_map(|&[a, b]| [[a, b], [b, a]]).collect();
        Self { scene, rules, pairs }
    }

    /// True if two parts, each given by the indices of instance and part, are not compared.
    pub fn skips(&self, a: [u32; 2], b: [u32; 2]) -> bool {
        let ClashRules { same_model, same_instance, same_parent, same_material, .. } = *self.rules;
        if !(same_model || same_instance || same_parent || same_material) && self.pairs.is_empty() {
            return false;
        }
        let of = |at: [u32; 2]| {
            let model = self.scene.instances[at[0] as usize].model;
            (model, self.scene.models[model as usize].parts())
        };
        let ((model_a, parts_a), (model_b, parts_b)) = (of(a), of(b));
        let (is_one_model, is_one_instance) = (model_a == model_b, a[0] == b[0]);
        if same_model && is_one_model || same_instance && is_one_instance {
            return true;
        }
        let (row_a, row_b) = (|| parts_a.get(a[1] as usize), || parts_b.get(b[1] as usize));
        if same_parent && is_one_instance && row_a().and_then(|p| p.parent) == row_b().and_then(|p| p.parent) {
            return true;
        }
        if same_material && is_one_model && row_a().map(|p| material(&p)) == row_b().map(|p| material(&p)) {
            return true;
        }
        let ids = || Some([parts_a.id(a[1] as usize)?, parts_b.id(b[1] as usize)?]);
        !self.pairs.is_empty() && ids().is_some_and(|ids| self.pairs.contains(&ids))
    }
}
