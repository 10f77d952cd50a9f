//! Primitive ids of pairs of triangles, read by block after the walks.

use super::super::batch::Policy;
use super::super::hit::NONE;
use super::super::sweep::sweep;
use super::facts::Met;
use crate::base::error::Result;
use crate::scene::SceneState;
use crate::structure::{Descent, Place};
use std::collections::BTreeMap;

/// Returns the primitive ids of both triangles of each pair.
pub(super) fn of_triangles(scene: &SceneState, met: &[Met]) -> Result<Vec<[u64; 2]>> {
    // The places of each placed tree, in order.
    let mut places: BTreeMap<u64, Vec<Place>> = BTreeMap::new();
    for (placed, place) in met.iter().flat_map(|met| met.at) {
        places.entry(placed).or_default().push(place);
    }
    places.values_mut().for_each(|places| {
        places.sort_unstable();
        places.dedup();
    });
    let trees: Vec<u64> = places.keys().copied().collect();
    let found = sweep(scene, &trees, Policy::Exact, &|view, visit, left, known: &mut Vec<Option<u64>>| {
        // Nothing of the tree is visited.
        *left = Descent::default();
        let (tree, places) = (view.tree(trees[visit]), &places[&trees[visit]]);
        known.resize(places.len(), None);
        let mut lacking = Vec::new();
        for (known, place) in known.iter_mut().zip(places).filter(|(known, _)| known.is_none()) {
            match tree.prim_at(*place) {
                Ok(prim) => *known = Some(prim.map_or(NONE, u64::from)),
                Err(block) if lacking.last() != Some(&block) => lacking.push(block),
                Err(_) => {}
            }
        }
        lacking
    })?;
    let of_tree: BTreeMap<u64, Vec<Option<u64>>> = trees.iter().copied().zip(found).collect();
    let id = |(placed, place): (u64, Place)| {
        let at = places[&placed].binary_search(&place).ok();
        at.and_then(|at| of_tree[&placed].get(at).copied().flatten()).unwrap_or(NONE)
    };
    Ok(met.iter().map(|met| met.at.map(id)).collect())
}
