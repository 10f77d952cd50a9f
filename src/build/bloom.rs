//! A set of hashes in a few bytes each. It may hold hashes that were not inserted; it always answers the same for the
//! same hash. (A Bloom filter: Bloom, "Space/time trade-offs in hash coding with allowable errors", CACM 1970.)

use crate::base::error::Result;
use crate::base::memory::zeroed;

/// The set. Each hash sets four bits.
pub struct Bloom {
    words: Vec<u64>,
}

impl Bloom {
    /// An empty set of at least `bits` bits.
    pub fn with_bits(bits: u64, what: &str) -> Result<Self> {
        let words = usize::try_from(bits / 64).unwrap_or(usize::MAX / 16).max(1).next_power_of_two();
        Ok(Self { words: zeroed(words, what)? })
    }

    /// The words and bits of a hash.
    fn bits(&self, hash: u64) -> impl Iterator<Item = (usize, u64)> + use<> {
        let (last, step) = (self.words.len() - 1, hash.rotate_left(32) | 1);
        (1..=4u64).map(move |i| {
            let at = hash.wrapping_add(step.wrapping_mul(i));
            ((at >> 6) as usize & last, 1 << (at & 63))
        })
    }

    /// Adds a hash.
    pub fn insert(&mut self, hash: u64) {
        for (word, bit) in self.bits(hash) {
            self.words[word] |= bit;
        }
    }

    /// True if the hash was inserted, and sometimes otherwise.
    pub fn has(&self, hash: u64) -> bool {
        self.bits(hash).all(|(word, bit)| self.words[word] & bit != 0)
    }
}

/// The hash of a pair of a hash and a number.
pub fn pair(hash: u64, number: usize) -> u64 {
    (hash ^ (number as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)).wrapping_mul(0xff51_afd7_ed55_8ccd)
}
