//! Rules for pairs of parts that are not compared.

use crate::scene::PartInfo;
use crate::scene::SceneState;
use std::collections::HashSet;

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
            let model = self.scene.model_of_instance(at[0].into());
            (model, model.parts())
        };
        let ((model_a, parts_a), (model_b, parts_b)) = (of(a), of(b));
        let (is_one_model, is_one_instance) = (model_a.same(model_b), a[0] == b[0]);
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
