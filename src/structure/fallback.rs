//! Packets and streams for structures that trace single rays only.
//!
//! Each ray of a packet or stream is walked as a single ray. A packet that stopped at a missing block continues with
//! the ray that needs the block; rays that have a result are not walked again.

use super::filter::PartFilter;
use super::hit::{Outcome, TriHit};
use super::packet::PacketWalk;
use super::place::Rooted;
use super::stream::Stream;
use super::walk::Walk;
use crate::math::STREAM;

/// A structure that traces single rays. The provided methods trace packets and streams with them.
pub trait SingleWalks: Rooted + Sized {
    /// See [`super::Tree::closest`].
    fn closest(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome;
    /// See [`super::Tree::any`].
    fn any(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome;

    /// See [`super::Tree::closest_together`].
    fn closest_together(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        together(walk, self, |alone| self.closest(filter, alone))
    }

    /// See [`super::Tree::any_together`].
    fn any_together(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        together(walk, self, |alone| self.any(filter, alone))
    }

    /// See [`super::Tree::closest_each`].
    fn closest_each(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
        each(stream, self, hits, |alone| self.closest(filter, alone));
    }

    /// See [`super::Tree::any_each`].
    fn any_each(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
        each(stream, self, hits, |alone| self.any(filter, alone));
    }
}

fn together(packet: &mut PacketWalk, tree: &impl Rooted, go_on: impl Fn(&mut Walk) -> Outcome) -> Outcome {
    while let Some(i) = packet.next_alone(tree) {
        if let Outcome::Pending(block) = go_on(&mut packet.alone) {
            return Outcome::Pending(block);
        }
        packet.take_alone(i);
    }
    Outcome::Done
}

fn each(stream: &mut Stream, tree: &impl Rooted, hits: &mut [TriHit], go_on: impl Fn(&mut Walk) -> Outcome) {
    stream.unfinished.clear();
    stream.first_cell.fill(f32::INFINITY);
    for (i, hit) in hits.iter_mut().enumerate().take(STREAM) {
        let ray = stream.ray(i);
        stream.alone.begin(tree, &ray);
        match go_on(&mut stream.alone) {
            Outcome::Done => (*hit, stream.first_cell[i]) = (stream.alone.best(), stream.alone.first_cell()),
            Outcome::Pending(_) | Outcome::Member(_) => {
                *hit = TriHit::none(ray.t_max);
                stream.unfinished.push(i as u32);
            }
        }
    }
    stream.counters += std::mem::take(&mut stream.alone.counters);
}
