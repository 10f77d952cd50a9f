//! Parts inside of others. Parts whose surfaces have no point in common are apart, or one is inside of the other: any
//! point of it decides.

use super::facts::{Found, PairKey};
use super::task::{PartKey, Task, near_pairs};
use crate::base::error::Result;
use crate::math::DBounds;
use glam::DVec3;
use std::collections::BTreeMap;

/// Returns the pairs of compared parts of which one is inside of the other, each with a corner of the part inside.
pub(super) fn search(task: &Task, found: &Found) -> Result<BTreeMap<PairKey, DVec3>> {
    let scene = task.scene;
    // All parts of the sets, with their bounds in the world.
    let mut parts: Vec<(PartKey, DBounds, bool)> = Vec::new();
    for instance in 0..scene.instance_count() as u32 {
        let model = scene.model_of_instance(instance.into());
        for (part, info) in (0u32..).zip(model.parts().iter()) {
            let key = [instance, part];
            if info.triangles > 0 && !info.bounds.is_empty() && task.has(key) {
                parts.push((key, info.bounds.transformed(&scene.world_from_model(instance.into())), info.is_closed));
            }
        }
    }
    let mut inner: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    let may = vec![[true; 2]; parts.len()];
    near_pairs(parts.iter().map(|part| part.1), &may, 0.0, |x, y| {
        for (outer, inside) in [(x, y), (y, x)] {
            let ([a, b], is_closed) = ([parts[outer].0, parts[inside].0], parts[outer].2);
            let key = if a < b { [a, b] } else { [b, a] };
            let meets = || found.facts.get(&key).is_some_and(|facts| facts.meets());
            if x != y && is_closed && holds(&parts[outer].1, &parts[inside].1) && task.wants(a, b) && !meets() {
                inner.entry(inside).or_default().push(outer);
            }
        }
    });
    let mut points = Vec::new();
    for &inside in inner.keys() {
        let [instance, part] = parts[inside].0;
        let first = scene
            .model_of_instance(instance.into())
            .read_part(part)?
            .next(1, task.cancel())?
            .first()
            .map(|t| t.corners[0]);
        let place = scene.world_from_model(instance.into());
        points.push(first.map_or(DVec3::NAN, |corner| place.transform_point3(corner)));
    }
    let mut contained = BTreeMap::new();
    let inner: Vec<(usize, Vec<usize>)> = inner.into_iter().collect();
    scene.parts_around(&points, &mut |at, holders| {
        let (inside, outers) = &inner[at];
        for &outer in outers {
            let [a, b] = [parts[outer].0, parts[*inside].0];
            if holders.iter().any(|&(instance, part, winding)| [instance as u32, part] == a && winding != 0) {
                contained.insert(if a < b { [a, b] } else { [b, a] }, points[at]);
            }
        }
    })?;
    Ok(contained)
}

/// True if a box holds another, with a tolerance for rounding.
fn holds(outer: &DBounds, inner: &DBounds) -> bool {
    let by = (outer.min.abs().max(outer.max.abs())).max_element() * 1e-12;
    (outer.min - by).cmple(inner.min).all() && (outer.max + by).cmpge(inner.max).all()
}
