//! The blocks that a ray waits for.

use crate::scene::walk::{Need, Snapshots};

/// The last blocks that a ray requested.
///
/// Most steps of a walk need one block. One needs four: of two hits at the same distance the lower primitive id wins,
/// and the comparison takes the block and the block of ids of each. No step of any structure may need more
/// ([`crate::structure::Outcome::Pending`]).
#[derive(Debug, Clone, Copy)]
pub(super) struct Asks {
    /// The most recent block comes first.
    last: [Need; 4],
    count: u8,
    /// True if the ray requested a block that it had requested before: the step needs several blocks at once.
    in_circles: bool,
}

impl Asks {
    /// Starts with a first block.
    pub fn of(need: Need) -> Self {
        Self { last: [need; 4], count: 1, in_circles: false }
    }

    /// Adds the block that the ray requested next.
    pub fn push(&mut self, need: Need) {
        let known = self.last[..usize::from(self.count)].iter().position(|n| *n == need);
        self.in_circles = known.is_some();
        let end = known.unwrap_or(usize::from(self.count).min(self.last.len() - 1));
        self.last.copy_within(..end, 1);
        self.last[0] = need;
        self.count = self.count.max(end as u8 + 1);
    }

    /// The blocks that must be in memory before the ray goes on.
    pub fn needs(&self) -> &[Need] {
        &self.last[..if self.in_circles { usize::from(self.count) } else { 1 }]
    }

    /// True if these blocks are in memory.
    pub fn are_in(&self, snapshots: &Snapshots) -> bool {
        self.needs().iter().all(|&need| snapshots.has(need))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ids::BlockId;

    fn need(block: u32) -> Need {
        Need { model: 0, block: BlockId(block) }
    }

    #[test]
    fn a_ray_requests_one_block_until_requests_repeat() {
        let mut asks = Asks::of(need(1));
        asks.push(need(2));
        assert_eq!(asks.needs(), [need(2)]);
        asks.push(need(1));
        assert_eq!(asks.needs(), [need(1), need(2)]);
        asks.push(need(3));
        assert_eq!(asks.needs(), [need(3)]);
        asks.push(need(2));
        assert_eq!(asks.needs(), [need(2), need(3), need(1)]);
        [4, 5, 4].iter().for_each(|&n| asks.push(need(n)));
        assert_eq!(asks.needs(), [need(4), need(5), need(2), need(3)]);
        asks.push(need(3));
        assert_eq!(asks.needs(), [need(3), need(4), need(5), need(2)]);
    }
}
