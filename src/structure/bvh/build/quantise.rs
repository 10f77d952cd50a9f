//! Quantises the boxes of a node's children to its grid.

use crate::math::Bounds;
use crate::structure::bvh::layout::{Node, WIDTH};

/// Returns a node with its children's boxes on its grid, rounded outward.
pub fn quantise(children: impl ExactSizeIterator<Item = Bounds> + Clone) -> Node {
    let all = children.clone().fold(Bounds::EMPTY, Bounds::union);
    let mut node = Node {
        origin: all.min.to_array(),
        exponent: [1; 3],
        valid: ((1u32 << children.len()) - 1) as u8,
        planes: [[0; WIDTH]; 6],
        child: [0; WIDTH],
        slabs: [0; WIDTH],
        normal: [[0; WIDTH]; 2],
    };
    for axis in 0..3 {
        node.exponent[axis] = exponent(f64::from(all.max[axis]) - f64::from(all.min[axis]));
        let step = f64::from(node.step(axis));
        let origin = f64::from(all.min[axis]);
        for (slot, bounds) in children.clone().enumerate() {
            let [low, high] = on_grid(origin, step, [bounds.min[axis], bounds.max[axis]]);
            node.planes[axis][slot] = low.clamp(0.0, 255.0) as u8;
            node.planes[axis + 3][slot] = high.clamp(0.0, 255.0) as u8;
        }
    }
    // `valid` masks empty slots. An inverted box also keeps them out of most tests.
    for slot in children.len()..WIDTH {
        for axis in 0..3 {
            node.planes[axis][slot] = 255;
        }
    }
    node
}

/// The planes of a box on an axis of a grid, in steps from its origin, rounded outward.
fn on_grid(origin: f64, step: f64, [min, max]: [f32; 2]) -> [f64; 2] {
    let [min, max] = [min, max].map(f64::from);
    let (mut low, mut high) = (((min - origin) / step).floor(), ((max - origin) / step).ceil());
    // Differences of coordinates that are 2^53 apart are rounded: one step outward corrects that.
    if origin + low * step > min {
        low -= 1.0;
    }
    if origin + high * step < max {
        high += 1.0;
    }
    [low, high]
}

/// Gives a child of a node another box: on the grid that the node has if that is large enough, else on a new one.
pub fn set_box(node: &mut Node, slot: usize, to: Bounds) {
    let planes: [[f64; 2]; 3] = std::array::from_fn(|axis| {
        on_grid(node.origin[axis].into(), node.step(axis).into(), [to.min[axis], to.max[axis]])
    });
    if planes.iter().all(|[low, high]| *low >= 0.0 && *high <= 255.0) {
        for (axis, [low, high]) in planes.into_iter().enumerate() {
            (node.planes[axis][slot], node.planes[axis + 3][slot]) = (low as u8, high as u8);
        }
        return;
    }
    let boxes: Vec<Bounds> =
        (0..node.valid.count_ones() as usize).map(|i| if i == slot { to } else { node.child_box(i) }).collect();
    let Node { origin, exponent, planes, .. } = quantise(boxes.iter().copied());
    (node.origin, node.exponent, node.planes) = (origin, exponent, planes);
}

/// Returns the biased exponent of the least power of two of which 255 steps cover `extent`.
fn exponent(extent: f64) -> u8 {
    // Slightly more, for the step outward that `quantise` may take.
    let extent = extent * (1.0 + 1e-12);
    let least = (extent / 255.0).max(f64::from(f32::MIN_POSITIVE));
    let mut e = least.log2().ceil() as i32;
    while 255.0 * f64::from(e).exp2() < extent {
        e += 1;
    }
    (e + 127).clamp(1, 254) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Vec3> {
        let c = prop_oneof![-1e6f32..1e6, -1.0f32..1.0, Just(0.0f32), -1e-30f32..1e-30, -1e30f32..1e30];
        [c.clone(), c.clone(), c].prop_map(Vec3::from_array)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn stored_boxes_are_rounded_outward(corners in prop::collection::vec((point(), point()), 1..=8)) {
            let node = quantise(corners.iter().map(|(a, b)| Bounds::of(&[*a, *b])));
            for (slot, (a, b)) in corners.iter().enumerate() {
                let bounds = Bounds::of(&[*a, *b]);
                for axis in 0..3 {
                    let at = |q: u8| f64::from(node.origin[axis]) + f64::from(q) * f64::from(node.step(axis));
                    prop_assert!(at(node.planes[axis][slot]) <= f64::from(bounds.min[axis]));
                    prop_assert!(f64::from(bounds.max[axis]) <= at(node.planes[axis + 3][slot]));
                }
                prop_assert!(node.child_box(slot).contains(&bounds) && node.stored_box(slot).contains(&bounds));
            }
            let boxes = (0..corners.len()).map(|slot| node.child_box(slot));
            prop_assert_eq!(node.children_box(), boxes.fold(Bounds::EMPTY, Bounds::union));
        }
    }
}
