//! The proxies of all trees, collected while blocks are written, and numbered for the file.

use super::output::Output;
use super::{BuildOptions, StandIns};
use crate::base::error::{Error, Result};
use crate::base::memory::room;
use crate::store::Proxies;
use crate::store::proxies::{Collecting, ProxyRow, Run};
use crate::structure::bake::{BakedProxy, ProxyOptions};

/// Number of lines into each subtree, if none is asked for.
pub const PROXY_RAYS: u32 = 512;
/// Greatest number of lines into each subtree.
pub const MOST_PROXY_RAYS: u32 = 1 << 20;

impl BuildOptions {
    /// The options of the proxies of a chunk whose first proxy has number `first`; `None` for no proxies.
    pub(super) fn proxies(&self, first: usize) -> Option<ProxyOptions> {
        let rays = if self.proxy_rays == 0 { PROXY_RAYS } else { self.proxy_rays };
        (self.stand_ins == StandIns::Proxies).then_some(ProxyOptions {
            rays,
            triangles: self.proxy_triangles,
            first: first as u32,
        })
    }
}

/// Runs of the nodes of blocks that show the same proxy, in the order of the blocks.
#[derive(Default)]
pub struct BlockRuns {
    /// Number of blocks.
    blocks: u32,
    /// Block, first node and proxy of each run.
    runs: Vec<(u32, u16, u32)>,
}

impl BlockRuns {
    /// Adds a block.
    pub fn push(&mut self, runs: &[(u16, u32)]) {
        self.runs.extend(runs.iter().map(|&(node, proxy)| (self.blocks, node, proxy)));
        self.blocks += 1;
    }

    /// Adds all blocks of `other`.
    pub fn append(&mut self, other: Self) {
        self.runs.extend(other.runs.into_iter().map(|(block, node, proxy)| (self.blocks + block, node, proxy)));
        self.blocks += other.blocks;
    }

    /// Returns the proxies in the order in which the runs show them. `baked` are those that the runs mean.
    pub fn finish(self, baked: &[BakedProxy]) -> Result<Proxies> {
        const UNKNOWN: u32 = u32::MAX;
        let what = "the proxies of a model";
        let mut new = room(baked.len(), what)?;
        new.resize(baked.len(), UNKNOWN);
        let mut rows: Vec<ProxyRow> = room(baked.len(), what)?;
        for (id, &(.., proxy)) in self.runs.iter().enumerate() {
            if let (Some(number @ &mut UNKNOWN), Some(baked)) = (new.get_mut(proxy as usize), baked.get(proxy as usize))
            {
                *number = rows.len() as u32;
                rows.push(ProxyRow { looks: baked.looks, area: baked.area, id: id as u32 });
            }
        }
        let refuse = |why: crate::base::bytes::Malformed| Error::bad_argument(format!("model: {why}"));
        let mut all = Collecting::new(rows.len(), self.runs.len(), self.blocks)?;
        rows.into_iter().try_for_each(|row| all.push_row(row)).map_err(refuse)?;
        for (block, node, proxy) in self.runs {
            all.push_run(Run { block, node, proxy: new.get(proxy as usize).copied() }).map_err(refuse)?;
        }
        all.finish().map_err(refuse)
    }
}

impl Output<'_> {
    /// The proxies of all trees, for the file.
    pub fn all_proxies(&mut self) -> Result<Proxies> {
        std::mem::take(&mut self.runs).finish(&std::mem::take(&mut self.proxies))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn baked(area: f32) -> BakedProxy {
        BakedProxy { looks: [area as u32; 18], area }
    }

    /// Coarse blocks are encoded last and come first in the file: proxies are numbered as they are met there.
    #[test]
    fn proxies_are_numbered_in_the_order_of_the_blocks() {
        let (mut fine, mut all) = (BlockRuns::default(), BlockRuns::default());
        fine.push(&[(0, 1), (4, 2)]);
        fine.push(&[]);
        all.push(&[(0, 2), (1, 0), (3, u32::MAX)]);
        all.append(fine);
        let proxies = all.finish(&[baked(10.0), baked(11.0), baked(12.0)]).expect("sound");
        assert_eq!(
            proxies.rows().iter().map(|row| (row.area, row.id)).collect::<Vec<_>>(),
            [(12.0, 0), (10.0, 1), (11.0, 3)]
        );
        let area = |block, node| proxies.of(block, node).map(|row| row.area);
        assert_eq!([area(0, 0), area(0, 2), area(0, 3)], [Some(12.0), Some(10.0), None]);
        assert_eq!([area(1, 3), area(1, 4), area(2, 0), area(3, 0)], [Some(11.0), Some(12.0), None, None]);
        assert!(BlockRuns::default().finish(&[]).expect("sound").is_empty());
    }
}
