//! Damage of seeds on stable Rust, where libFuzzer is not: changes of bits, bytes and numbers, insertions, deletions,
//! and parts of other seeds. The same seed of the generator gives the same inputs.

use super::rng::Rng;

/// Longest input that is made.
const LONGEST: usize = 16 << 10;
/// Bytes that readers treat in a special way.
const SPECIAL: [u8; 16] = [0, 1, 0x7f, 0x80, 0xff, b' ', b'\n', b'-', b'.', b'/', b'0', b'9', b'"', b'{', b'[', b'\\'];

/// Returns a damaged copy of one of `seeds`.
pub fn mutated(seeds: &[Vec<u8>], rng: &mut Rng) -> Vec<u8> {
    let mut bytes = seeds[rng.below(seeds.len())].clone();
    for _ in 0..1 + rng.below(4) {
        change(&mut bytes, seeds, rng);
    }
    bytes.truncate(LONGEST);
    bytes
}

fn change(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], rng: &mut Rng) {
    let at = rng.below(bytes.len() + 1);
    let len = 1 + rng.below(8);
    let end = (at + len).min(bytes.len());
    match rng.below(9) {
        0 if at < bytes.len() => bytes[at] ^= 1 << rng.below(8),
        1 if at < bytes.len() => bytes[at] = SPECIAL[rng.below(SPECIAL.len())],
        2 => drop(bytes.drain(at..end)),
        3 => bytes.truncate(at),
        4 => {
            let some: Vec<u8> = (0..len).map(|_| rng.bits() as u8).collect();
            bytes.splice(at..at, some);
        }
        5 => {
            let again = bytes[at..end].repeat(1 + rng.below(40));
            bytes.splice(at..at, again);
        }
        6 => {
            let other = &seeds[rng.below(seeds.len())];
            let from = rng.below(other.len() + 1);
            let to = (from + 1 + rng.below(64)).min(other.len());
            bytes.splice(at..end, other[from..to].iter().copied());
        }
        7 => digits(bytes, at, rng),
        _ => number(bytes, at, rng),
    }
}

/// Replaces the digits at `at`, or behind it, by another number.
fn digits(bytes: &mut Vec<u8>, at: usize, rng: &mut Rng) {
    let Some(first) = bytes[at..].iter().position(u8::is_ascii_digit).map(|i| at + i) else { return };
    let len = bytes[first..].iter().take_while(|b| b.is_ascii_digit()).count();
    let numbers =
        ["0", "1", "-1", "255", "65536", "4294967295", "4294967296", "1e400", "-0", "nan", "18446744073709551615"];
    bytes.splice(first..first + len, numbers[rng.below(numbers.len())].bytes());
}

/// Replaces four bytes by a little-endian number.
fn number(bytes: &mut [u8], at: usize, rng: &mut Rng) {
    let numbers = [0, 1, 0xff, 0xffff, 0x7fff_ffff, 0x8000_0000, u32::MAX, 0x7f80_0000, 0x7fc0_0000, rng.bits() as u32];
    let number: u32 = numbers[rng.below(numbers.len())];
    if let Some(place) = bytes.get_mut(at..at + 4) {
        place.copy_from_slice(&number.to_le_bytes());
    }
}
