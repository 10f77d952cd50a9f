//! Widths of packets, streams and bundles of rays, on which all structures and the rooms above them agree.

/// Number of rays of a packet: two vectors of 16. Each box test of a node then serves twice as many rays, and the tests
/// of a triangle against the two vectors hide each other's latency.
pub const PACKET: usize = 32;
/// Maximum number of rays of a stream.
pub const STREAM: usize = 1024;
/// Number of packets of a bundle: one for each lane of a packet.
pub const BUNDLE: usize = PACKET;

/// Returns a mask of the first `count` rays of a packet, one bit each.
#[inline]
pub const fn first_rays(count: usize) -> u32 {
    if count < PACKET { (1 << count) - 1 } else { u32::MAX }
}

/// Returns the indices of the set bits of a mask, the lowest first.
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
