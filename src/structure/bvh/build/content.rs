//! The triangles of a tree, and which of them a line hits.

use super::coverage::Beside;
use super::lines::Line;
use super::refs::Ref;
use super::tree::{InnerNode, Piece, Sub};
use crate::simd::Simd;
use crate::structure::bake::TreeInput;

/// The geometry that lines are tested against.
pub(super) struct Scene<'a> {
    pub(super) pieces: &'a [Piece],
    pub(super) input: TreeInput<'a>,
    pub(super) refs: &'a [Ref],
    pub(super) beside: Beside,
}

impl<'a> Scene<'a> {
    /// True if a line hits a triangle below the nodes on the stack, in the first `at_most` nodes and leaves that it
    /// crosses. The stack is left empty.
    #[inline(always)]
    pub(super) fn meets<S: Simd>(&self, s: S, line: &Line, at_most: usize, stack: &mut Vec<&'a Sub>) -> bool {
        let mut left = at_most;
        while let Some(sub) = stack.pop() {
            if left == 0 {
                stack.clear();
                return false;
            }
            left -= 1;
            match sub {
                Sub::Leaf { first, count, .. } => {
                    for r in self.refs(*first, *count) {
                        if line.crosses(r) && line.meets(s, &self.input.triangles[r.triangle()]) {
                            stack.clear();
                            return true;
                        }
                    }
                }
                Sub::InnerNode(inner) => {
                    push_crossed(s, line, inner, stack);
                }
                Sub::Placed(_) => {}
            }
        }
        false
    }

    pub(super) fn refs(&self, first: u32, count: u32) -> &[Ref] {
        &self.refs[first as usize..(first + count) as usize]
    }

    /// Appends the triangles below a node.
    pub(super) fn below(&self, sub: &Sub, out: &mut Vec<u32>) {
        match sub {
            Sub::Leaf { first, count, .. } => out.extend(self.refs(*first, *count).iter().map(|r| r.triangle() as u32)),
            Sub::InnerNode(inner) => inner.children.iter().for_each(|(_, sub)| self.below(sub, out)),
            Sub::Placed(_) => {}
        }
    }
}

/// Pushes the children with boxes that a line crosses.
#[inline(always)]
pub(super) fn push_crossed<'a, S: Simd>(s: S, line: &Line, inner: &'a InnerNode, stack: &mut Vec<&'a Sub>) {
    let mut met = line.boxes(s, &inner.node);
    while met != 0 {
        let slot = met.trailing_zeros() as usize;
        met &= met - 1;
        stack.extend(inner.children.get(slot).map(|(_, sub)| sub));
    }
}
