//! Plans of blocks: which frames a fine block and its leaf block take.

use super::frame::BuiltFrame;
use super::pack::{Item, Load, pack};
use crate::structure::patch::layout::{
    COMPUTED_WORDS, FRAME_WORDS, GRID_WORDS, HEAD_WORDS, LONG_VOXEL, MAX_WORDS, MOST_GRIDS, NODE_WORDS, tree_words,
};
use crate::structure::patch::net::NET_WORDS;
use std::collections::HashMap;

/// The frames of a fine block, at least one.
pub struct Plan {
    /// In order.
    pub frames: Vec<BuiltFrame>,
    /// The words of the nets of computed grids, in the order in which frames refer to them.
    pub net_words: Vec<u32>,
}

/// Number of blocks over that of full blocks: more blocks have smaller boxes.
pub const SPARE: f32 = 1.15;
/// Blocks that frames of a surface fill before plans are made of them: some megabytes.
const BLOCKS: u32 = 32;

/// Words of nodes and of their voxels, frames have none, for each frame: four for seven frames at most
/// (`nodes::most_nodes`).
const NODES_OF_FRAME: usize = ((NODE_WORDS + LONG_VOXEL) * 4).div_ceil(7);
/// Words of a leaf block and of a fine block that frames may take.
const ROOM: Load = [(MAX_WORDS - 2) as u32, (MAX_WORDS - HEAD_WORDS - NODE_WORDS - LONG_VOXEL) as u32];
const _: () = assert!(MAX_WORDS / (NODES_OF_FRAME + FRAME_WORDS) <= MOST_GRIDS);

/// The load for which plans are made at a time.
pub const AT_A_TIME: Load = [ROOM[0] * BLOCKS, ROOM[1] * BLOCKS];

/// About what frames of a level take of [`AT_A_TIME`], if none of them is divided.
pub fn expected(level: u32, frames: usize, is_computed: bool) -> Load {
    let side = (1 << level) + 1;
    let grid = if is_computed { COMPUTED_WORDS + NET_WORDS } else { GRID_WORDS + 3 * side * side };
    let fine = NODES_OF_FRAME + FRAME_WORDS + tree_words(level - 1);
    [1 + grid, fine].map(|words| u32::try_from(words * frames).unwrap_or(u32::MAX))
}

/// Words of a frame in its leaf block, but for its net, and in its fine block.
fn load(frame: &BuiltFrame) -> Load {
    [(1 + frame.grid.len()) as u32, (NODES_OF_FRAME + frame.words.len()) as u32]
}

/// Gathers frames that are neighbours, and makes plans of them.
#[derive(Default)]
pub struct Plans {
    open: Vec<BuiltFrame>,
    load: [u64; 2],
}

impl Plans {
    /// Adds a frame.
    pub fn push(&mut self, frame: BuiltFrame) {
        for (sum, words) in self.load.iter_mut().zip(load(&frame)) {
            *sum += u64::from(words);
        }
        self.open.push(frame);
    }

    /// True if frames take much more than [`AT_A_TIME`]: more than was expected.
    pub fn is_full(&self) -> bool {
        self.load.iter().zip(AT_A_TIME).any(|(sum, most)| *sum > 2 * u64::from(most))
    }

    /// Makes plans of all frames that are there.
    pub fn close(&mut self) -> Vec<Plan> {
        self.load = [0; 2];
        let frames = std::mem::take(&mut self.open);
        // Frames with the same net share its words if they share a block.
        let mut sharing: HashMap<&[u32], u32> = HashMap::new();
        for net in frames.iter().filter_map(|frame| frame.net.as_deref()) {
            *sharing.entry(net).or_default() += 1;
        }
        let of_net = |frame: &BuiltFrame| {
            let net = frame.net.as_deref()?;
            Some((net.len() as u32).div_ceil(sharing.get(net).copied().unwrap_or(1)))
        };
        let item = |(index, frame): (usize, &BuiltFrame)| {
            let [leaf, fine] = load(frame);
            let load = [leaf + of_net(frame).unwrap_or(0), fine];
            Item { bounds: frame.cell.bounds, load, index: index as u32 }
        };
        let mut items: Vec<Item> = frames.iter().enumerate().map(item).collect();
        let mut groups = Vec::new();
        divide(&frames, &mut items, ROOM, &mut groups);
        let mut frames: Vec<Option<BuiltFrame>> = frames.into_iter().map(Some).collect();
        let plan = |group: Vec<u32>| Plan::of(group.into_iter().filter_map(|index| frames[index as usize].take()));
        groups.into_iter().map(plan).collect()
    }
}

/// Divides frames into groups that fit a block. Nets that several groups need may take more room than was counted.
fn divide(frames: &[BuiltFrame], items: &mut [Item], room: Load, groups: &mut Vec<Vec<u32>>) {
    for range in pack(items, room, SPARE) {
        let group = &mut items[range];
        let leaf: u32 = group.iter().map(|item| load(&frames[item.index as usize])[0]).sum();
        let mut nets: Vec<&[u32]> =
            group.iter().filter_map(|item| frames[item.index as usize].net.as_deref()).collect();
        nets.sort_unstable();
        nets.dedup();
        let words = leaf as usize + nets.iter().map(|net| net.len()).sum::<usize>();
        if words <= ROOM[0] as usize || group.len() == 1 {
            groups.push(group.iter().map(|item| item.index).collect());
        } else {
            // In two parts, or a few.
            let sum = group.iter().fold([0; 2], |sum, item| [sum[0] + item.load[0], sum[1] + item.load[1]]);
            divide(frames, group, sum.map(|words: u32| words.div_ceil(2).max(1)), groups);
        }
    }
}

impl Plan {
    /// Nets follow each other; a computed grid refers to its own by the number of words before.
    fn of(frames: impl Iterator<Item = BuiltFrame>) -> Self {
        let (mut known, mut net_words) = (HashMap::<Vec<u32>, usize>::new(), Vec::new());
        let place = |mut frame: BuiltFrame| {
            if let Some(net) = frame.net.take() {
                let next = net_words.len();
                let at = *known.entry(net).or_insert_with_key(|net| {
                    net_words.extend(net);
                    next
                });
                frame.grid[4] = at as u32;
            }
            frame
        };
        Self { frames: frames.map(place).collect(), net_words }
    }
}
