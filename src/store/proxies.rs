//! The proxies of subtrees, and which nodes show which of them (FORMAT.md, section 5). They stay in memory while a
//! model is open. Their looks are opaque to this module.

use super::sections::{FileRow, PlainRow, of_row};
use crate::base::bytes::{ByteReader, Checked, Malformed, PutBytes, ensure};
use crate::base::error::Result;
use crate::base::memory::room;

/// Number of words of the looks of a proxy.
const LOOKS: usize = 18;
/// Number of bytes of a run in the file.
pub(super) const RUN_LEN: usize = 10;
/// The proxy of nodes that have none.
const NO_PROXY: u32 = u32::MAX;
/// Number of runs that are encoded at a time.
const TOGETHER: usize = 4096;
/// Use of the memory, in errors.
const WHAT: &str = "the proxies of a model";

/// A proxy: the look of a subtree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProxyRow {
    /// The looks from eighteen directions (`lod::proxy`).
    pub looks: [u32; LOOKS],
    /// Surface area of the subtree's triangles, in square units of its tree; finite, > 0.
    pub area: f32,
    /// Number of the run that begins with the root of the subtree. Ascending.
    pub id: u32,
}

/// Consecutive nodes of a block that show the same proxy: they end where the next run begins, or with the block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// The geometry block.
    pub block: u32,
    /// First node.
    pub node: u16,
    /// Row of the proxy; `None` if these nodes have none.
    pub proxy: Option<u32>,
}

/// All proxies of a model, and the nodes that show them.
///
/// Each node shows the proxy of the smallest subtree with a proxy that it is in.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Proxies {
    rows: Vec<ProxyRow>,
    /// For each geometry block the number of its first run, and the number of all runs.
    starts: Vec<u32>,
    /// First node and proxy of each run.
    nodes: Vec<u16>,
    shown: Vec<u32>,
}

impl Proxies {
    /// Number of proxies.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// All proxies.
    pub fn rows(&self) -> &[ProxyRow] {
        &self.rows
    }

    /// All runs, in the order of blocks and nodes.
    pub fn runs(&self) -> impl Iterator<Item = Run> {
        let of_block =
            |block: usize| (self.starts[block]..self.starts[block + 1]).map(move |run| (block, run as usize));
        (0..self.starts.len().saturating_sub(1)).flat_map(of_block).map(|(block, run)| Run {
            block: block as u32,
            node: self.nodes[run],
            proxy: (self.shown[run] != NO_PROXY).then_some(self.shown[run]),
        })
    }

    /// The proxy that a node of a geometry block shows, if it has one.
    #[inline]
    pub fn of(&self, block: u32, node: usize) -> Option<&ProxyRow> {
        let block = block as usize;
        let (&from, &end) = (self.starts.get(block)?, self.starts.get(block + 1)?);
        let before = self.nodes[from as usize..end as usize].partition_point(|first| usize::from(*first) <= node);
        let run = from as usize + before.checked_sub(1)?;
        self.rows.get(self.shown[run] as usize)
    }

    /// Bytes of memory of `rows` proxies and `runs` runs in a model of `blocks` geometry blocks.
    pub(super) fn memory_of(rows: u64, runs: u64, blocks: u32) -> u64 {
        let all = [(rows, size_of::<ProxyRow>()), (runs, 6), (u64::from(blocks) + 1, 4)];
        let of = |(count, each): (u64, usize)| count.saturating_mul(each as u64);
        if rows == 0 { 0 } else { all.map(of).into_iter().fold(0, u64::saturating_add) }
    }

    /// Bytes of memory.
    pub fn memory(&self) -> u64 {
        let blocks = self.starts.len().saturating_sub(1) as u32;
        Self::memory_of(self.rows.len() as u64, self.nodes.len() as u64, blocks)
    }

    /// Calls `take` with the bytes of the section, some at a time: all rows, then all runs.
    pub(super) fn encode(&self, take: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        super::sections::encode(&self.rows, take)?;
        let (mut out, mut runs) = (Vec::new(), self.runs().peekable());
        while runs.peek().is_some() {
            out.clear();
            for run in runs.by_ref().take(TOGETHER) {
                out.put_u32(run.block);
                out.put_u16(run.node);
                out.put_u32(run.proxy.unwrap_or(NO_PROXY));
            }
            take(&out)?;
        }
        Ok(())
    }
}

/// Proxies that are being collected: first all rows, then all runs.
#[derive(Debug)]
pub struct Collecting {
    all: Proxies,
    blocks: u32,
    /// The next proxy that no run has shown.
    next: u32,
    /// Block of the last run.
    last: Option<u32>,
}

impl Collecting {
    /// Begins with the numbers of rows and runs to come, in a model of `blocks` geometry blocks. Fails with `NoMemory`.
    pub fn new(rows: usize, runs: usize, blocks: u32) -> Result<Self> {
        let mut all = Proxies {
            rows: room(rows, WHAT)?,
            nodes: room(runs, WHAT)?,
            shown: room(runs, WHAT)?,
            ..Proxies::default()
        };
        if rows > 0 {
            all.starts = room(blocks as usize + 1, WHAT)?;
        }
        Ok(Self { all, blocks, next: 0, last: None })
    }

    /// Adds a proxy.
    pub fn push_row(&mut self, row: ProxyRow) -> Checked<()> {
        let index = self.all.rows.len();
        let check = || {
            ensure(row.area.is_finite() && row.area > 0.0, "the area is not finite and above 0")?;
            ensure(self.all.rows.last().is_none_or(|last| last.id < row.id), "the ids do not ascend")?;
            ensure(index < NO_PROXY as usize, "too many rows")
        };
        check().map_err(|why| of_row("proxy", index, &why))?;
        self.all.rows.push(row);
        Ok(())
    }

    /// Adds a run.
    pub fn push_run(&mut self, run: Run) -> Checked<()> {
        let index = self.all.nodes.len();
        self.check_run(index, run).map_err(|why| of_row("run", index, &why))?;
        for _ in self.all.starts.len()..=run.block as usize {
            self.all.starts.push(index as u32);
        }
        self.all.nodes.push(run.node);
        self.all.shown.push(run.proxy.unwrap_or(NO_PROXY));
        self.last = Some(run.block);
        Ok(())
    }

    fn check_run(&mut self, index: usize, run: Run) -> Checked<()> {
        ensure(!self.all.rows.is_empty(), "there are no proxies")?;
        ensure(run.block < self.blocks, "the block does not exist")?;
        ensure(self.last.is_none_or(|last| last <= run.block), "the blocks do not ascend")?;
        if self.last == Some(run.block) {
            ensure(self.all.nodes.last().is_none_or(|last| *last < run.node), "the nodes do not ascend")?;
            let same = self.all.shown.last() == Some(&run.proxy.unwrap_or(NO_PROXY));
            ensure(!same, "it goes on with the proxy of the run before")?;
        }
        let Some(proxy) = run.proxy else { return Ok(()) };
        let row = self.all.rows.get(proxy as usize).filter(|_| proxy <= self.next);
        let row = row.ok_or(Malformed::new("the proxy does not exist, or its subtree begins later"))?;
        if proxy == self.next {
            ensure(row.id as usize == index, "the id of the proxy is that of another run")?;
            self.next += 1;
        }
        Ok(())
    }

    /// Returns the proxies.
    pub fn finish(mut self) -> Checked<Proxies> {
        ensure(self.next as usize == self.all.rows.len(), "no node shows a proxy")?;
        if !self.all.rows.is_empty() {
            self.all.starts.resize(self.blocks as usize + 1, self.all.nodes.len() as u32);
        }
        Ok(self.all)
    }
}

impl FileRow for ProxyRow {
    const LEN: usize = 4 * LOOKS + 8;
    fn encode(&self, out: &mut Vec<u8>) {
        self.looks.iter().for_each(|&look| out.put_u32(look));
        out.put_f32s(&[self.area]);
        out.put_u32(self.id);
    }
}

impl PlainRow for ProxyRow {
    fn decode(r: &mut ByteReader) -> Checked<Self> {
        let mut looks = [0; LOOKS];
        for look in &mut looks {
            *look = r.u32()?;
        }
        Ok(Self { looks, area: r.f32()?, id: r.u32()? })
    }
}

/// Reads a run.
pub(super) fn decode_run(bytes: &[u8]) -> Checked<Run> {
    let mut r = ByteReader::new(bytes);
    let (block, node, proxy) = (r.u32()?, r.u16()?, r.u32()?);
    Ok(Run { block, node, proxy: (proxy != NO_PROXY).then_some(proxy) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(id: u32) -> ProxyRow {
        ProxyRow { looks: std::array::from_fn(|i| i as u32 + id), area: 1.5, id }
    }

    fn run(block: u32, node: u16, proxy: impl Into<Option<u32>>) -> Run {
        Run { block, node, proxy: proxy.into() }
    }

    fn collected(rows: &[ProxyRow], runs: &[Run]) -> Checked<Proxies> {
        let mut all = Collecting::new(rows.len(), runs.len(), 5).expect("memory");
        rows.iter().try_for_each(|row| all.push_row(*row))?;
        runs.iter().try_for_each(|run| all.push_run(*run))?;
        all.finish()
    }

    /// Two proxies: the second is below the first, and the first goes on behind it.
    fn two() -> (Vec<ProxyRow>, Vec<Run>) {
        (vec![row(0), row(1)], vec![run(1, 0, 0), run(1, 3, 1), run(1, 7, 0), run(3, 2, 1), run(3, 5, None)])
    }

    #[test]
    fn nodes_show_the_proxy_of_their_run() {
        let (rows, runs) = two();
        let all = collected(&rows, &runs).expect("sound");
        let shown = |block, node| all.of(block, node).map(|row| row.id);
        assert_eq!([shown(1, 0), shown(1, 2), shown(1, 3), shown(1, 6)], [Some(0), Some(0), Some(1), Some(1)]);
        assert_eq!([shown(1, 7), shown(1, 60_000), shown(3, 4)], [Some(0), Some(0), Some(1)]);
        let none = [(0, 0), (2, 9), (3, 1), (3, 5), (4, 0), (5, 0), (u32::MAX, 1)];
        assert!(none.iter().all(|&(block, node)| shown(block, node).is_none()));
        assert_eq!(all.runs().collect::<Vec<_>>(), runs);
        assert_eq!(Proxies::default().of(0, 0), None);
        assert_eq!(collected(&[], &[]), Ok(Proxies::default()));
    }

    #[test]
    fn tables_come_back() {
        let (rows, runs) = two();
        let all = collected(&rows, &runs).expect("sound");
        let mut bytes = Vec::new();
        all.encode(&mut |some| {
            bytes.extend_from_slice(some);
            Ok(())
        })
        .expect("memory");
        assert_eq!(bytes.len(), 2 * ProxyRow::LEN + 5 * RUN_LEN);
        let (first, rest) = bytes.split_at(2 * ProxyRow::LEN);
        let rows: Vec<_> =
            first.chunks(ProxyRow::LEN).map(|row| ProxyRow::decode(&mut ByteReader::new(row)).expect("row")).collect();
        let runs: Vec<_> = rest.chunks(RUN_LEN).map(|run| decode_run(run).expect("run")).collect();
        assert_eq!(collected(&rows, &runs), Ok(all));
    }

    /// Each lie has its message.
    #[test]
    fn lies_are_refused() {
        let (rows, runs) = two();
        let refused = |rows: &[ProxyRow], runs: &[Run], why: &str| {
            let found = collected(rows, runs).expect_err(why).to_string();
            assert!(found.contains(why), "{found} instead of {why}");
        };
        let with_row = |at: usize, row: ProxyRow| {
            let mut rows = rows.clone();
            rows[at] = row;
            rows
        };
        let with_run = |at: usize, run: Run| {
            let mut runs = runs.clone();
            runs[at] = run;
            runs
        };
        for area in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            refused(&with_row(1, ProxyRow { area, ..row(1) }), &runs, "proxy 1: the area is not finite and above 0");
        }
        refused(&with_row(1, row(0)), &runs, "proxy 1: the ids do not ascend");
        refused(&with_row(1, row(2)), &runs, "run 1: the id of the proxy is that of another run");
        refused(&rows, &with_run(4, run(5, 0, None)), "run 4: the block does not exist");
        refused(&rows, &with_run(3, run(0, 0, 1)), "run 3: the blocks do not ascend");
        refused(&rows, &with_run(2, run(1, 3, 0)), "run 2: the nodes do not ascend");
        refused(&rows, &with_run(2, run(1, 9, 1)), "run 2: it goes on with the proxy of the run before");
        refused(&rows, &with_run(0, run(1, 0, 1)), "run 0: the proxy does not exist, or its subtree begins later");
        refused(&rows, &with_run(3, run(3, 2, 2)), "run 3: the proxy does not exist, or its subtree begins later");
        refused(&rows, &runs[..1], "no node shows a proxy");
        refused(&[], &runs[..1], "run 0: there are no proxies");
    }
}
