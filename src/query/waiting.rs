//! Pieces of a quest that lack blocks, in a plain list. Groups of rays, which may be many, have an
//! [index](super::parked).

use super::needs::together;
use super::rounds::WaitList;
use crate::scene::walk::Need;

/// A piece that goes on in steps, each with its blocks in memory.
pub(super) trait Lacking: Send {
    /// The blocks of a step.
    type Step: IntoIterator<Item = Need>;

    /// Bytes of its memory.
    fn bytes(&self) -> u64;
    /// The steps of which any takes the piece further.
    fn steps(&self) -> impl Iterator<Item = Self::Step>;
    /// Sorts the steps of all pieces, the most urgent first.
    fn sort(steps: &mut Vec<Self::Step>);
}

/// The pieces that wait.
pub(super) struct Waiting<P>(Vec<P>);

impl<P> Default for Waiting<P> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<P: Lacking> WaitList for Waiting<P> {
    type Piece = P;
    type Parked = P;

    fn bytes(piece: &P) -> u64 {
        size_of::<P>() as u64 + piece.bytes()
    }

    fn piece(piece: &P) -> &P {
        piece
    }

    fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn push(&mut self, piece: P) {
        self.0.push(piece);
    }

    fn take(&mut self, is_there: impl Fn(Need) -> bool) -> Vec<P> {
        let can_go_on = |piece: &mut P| piece.steps().any(|step| step.into_iter().all(&is_there));
        self.0.extract_if(.., can_go_on).collect()
    }

    fn plan(&self, room: u64, bytes: impl Fn(Need) -> u64) -> (Vec<Need>, bool) {
        let mut steps: Vec<P::Step> = self.0.iter().flat_map(P::steps).collect();
        P::sort(&mut steps);
        together(steps, room, bytes)
    }
}
