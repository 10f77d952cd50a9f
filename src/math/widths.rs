//! How many rays go together: widths of packets, streams and bundles, which every structure and all above it agree on.

/// Rays of a packet: two vectors of 16, so that a node's box tests serve twice as many rays, and of two tests of a
/// triangle one goes on while the other waits.
pub const PACKET: usize = 32;
/// Rays of a stream, at most.
pub const STREAM: usize = 1024;
/// Packets of a bundle: as many as a packet has rays, a lane each.
pub const BUNDLE: usize = PACKET;

/// The first `count` rays of a packet, a bit each.
#[inline]
pub const fn first_rays(count: usize) -> u32 {
    if count < PACKET { (1 << count) - 1 } else { u32::MAX }
}

/// The set bits of a mask, by number, the lowest first.
#[inline]
pub fn bits(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (mask != 0).then(|| {
            let i = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            i
        })
    })
}
