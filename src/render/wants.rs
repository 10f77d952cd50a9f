//! The blocks that a picture is missing, and their weights.

use crate::scene::walk::Need;

/// Blocks that rays needed and that are not in memory, each with a weight: pixels × error, in pixels, that it removes.
#[derive(Debug, Clone, Default)]
pub(crate) struct Wants {
    list: Vec<(Need, f32)>,
}

/// Length of the list at which entries of the same block are first merged.
const MANY: usize = 4096;

impl Wants {
    /// Adds `weight` to a block that a ray found missing.
    #[inline]
    pub fn add(&mut self, need: Need, weight: f32) {
        match self.list.last_mut() {
            Some((last, sum)) if *last == need => *sum += weight,
            _ => self.list.push((need, weight)),
        }
        if self.list.len() >= MANY && self.list.len().is_power_of_two() {
            self.add_up();
        }
    }

    /// Adds all entries of `others`.
    pub fn append(&mut self, others: &Wants) {
        self.list.extend_from_slice(&others.list);
    }

    /// Removes all entries.
    pub fn clear(&mut self) {
        self.list.clear();
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Sorts by block and merges the entries of each block into one with the sum of their weights.
    pub fn add_up(&mut self) {
        self.list.sort_unstable_by_key(|w| w.0);
        self.list.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            kept.1 += if same { next.1 } else { 0.0 };
            same
        });
    }

    /// Iterates over blocks and weights. After [`Wants::add_up`] each block occurs once.
    pub fn iter(&self) -> impl Iterator<Item = (Need, f32)> {
        self.list.iter().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ids::BlockId;

    #[test]
    fn weights_of_a_block_are_added_up() {
        let need = |block| Need { model: 0, block: BlockId(block) };
        let mut wants = Wants::default();
        for (block, weight) in [(3, 1.0), (3, 2.0), (1, 4.0), (3, 8.0)] {
            wants.add(need(block), weight);
        }
        wants.add_up();
        assert_eq!(wants.iter().collect::<Vec<_>>(), [(need(1), 4.0), (need(3), 11.0)]);
        let mut many = Wants::default();
        for i in 0..100_000u32 {
            many.add(need(i % 7), 1.0);
        }
        assert!(many.list.len() < 2 * MANY);
    }
}
