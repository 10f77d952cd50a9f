//! Groups of clashes, for `outcrop clash --group`.

use outcrop::math::DBounds;
use outcrop::query::clash::Clash;
use std::collections::BTreeMap;

/// The way in which clashes are grouped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grouping {
    /// All clashes of a part; each clash is in the groups of both parts.
    Part,
    /// All clashes of two parts.
    Pair,
    /// Clashes whose boxes overlap, also by way of others: one place that a person looks at.
    Near,
}

/// A group of clashes.
pub struct Group {
    /// Instance and part of [`Grouping::Part`].
    pub part: Option<[u64; 2]>,
    /// Indices of the clashes, in order.
    pub clashes: Vec<usize>,
}

impl Grouping {
    pub const ALL: [Self; 3] = [Self::Part, Self::Pair, Self::Near];

    pub fn name(self) -> &'static str {
        match self {
            Self::Part => "part",
            Self::Pair => "pair",
            Self::Near => "near",
        }
    }

    /// Returns the groups, in order. Boxes grow by `near` for [`Grouping::Near`].
    pub fn of(self, clashes: &[Clash], near: f64) -> Vec<Group> {
        let mut groups: BTreeMap<[[u64; 2]; 2], Vec<usize>> = BTreeMap::new();
        for (i, clash) in clashes.iter().enumerate() {
            let [a, b] = [0, 1].map(|k| [clash.instances[k], clash.parts[k]]);
            match self {
                Self::Part => [a, b].into_iter().for_each(|part| groups.entry([part; 2]).or_default().push(i)),
                Self::Pair => groups.entry([a, b]).or_default().push(i),
                Self::Near => return near_groups(clashes, near),
            }
        }
        let part = |key: [[u64; 2]; 2]| (self == Self::Part).then_some(key[0]);
        groups.into_iter().map(|(key, clashes)| Group { part: part(key), clashes }).collect()
    }
}

/// Groups of clashes whose boxes, grown by `near`, overlap: a sweep along x that joins boxes.
fn near_groups(clashes: &[Clash], near: f64) -> Vec<Group> {
    let grown = |clash: &Clash| DBounds { min: clash.bounds.min - near, max: clash.bounds.max + near };
    let boxes: Vec<DBounds> = clashes.iter().map(grown).collect();
    let mut order: Vec<usize> = (0..boxes.len()).collect();
    order.sort_by(|&a, &b| boxes[a].min.x.total_cmp(&boxes[b].min.x));
    let mut first: Vec<usize> = (0..boxes.len()).collect();
    let mut open: Vec<usize> = Vec::new();
    for i in order {
        open.retain(|&other| boxes[other].max.x >= boxes[i].min.x);
        for &other in open.iter().filter(|&&other| boxes[other].overlaps(&boxes[i])) {
            let (a, b) = (root(&mut first, i), root(&mut first, other));
            first[a.max(b)] = a.min(b);
        }
        open.push(i);
    }
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for i in 0..boxes.len() {
        groups.entry(root(&mut first, i)).or_default().push(i);
    }
    groups.into_values().map(|clashes| Group { part: None, clashes }).collect()
}

/// The least index of a group.
fn root(first: &mut [usize], mut i: usize) -> usize {
    while first[i] != i {
        first[i] = first[first[i]];
        i = first[i];
    }
    i
}
