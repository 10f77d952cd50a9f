//! One battery of operations for every set: each must give the baseline's bits.

use super::*;

const VALUES: [f32; 16] = [
    0.0,
    -0.0,
    1.0,
    -1.5,
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    3.4e38,
    1e-30,
    -7.25,
    255.0,
    0.1,
    0.3,
    -2e10,
    1e-3,
    42.0,
];

struct Battery;

impl Op for Battery {
    type Out = Vec<u32>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<u32> {
        let mut out = Vec::new();
        for shift in 0..16 {
            let b: [f32; 16] = std::array::from_fn(|i| VALUES[(i + shift) % 16]);
            sixteen(s.load16(&VALUES), s.load16(&b), s.splat16(2.5), &mut out);
            let (a8, b8) = (first8(&VALUES), first8(&b));
            eight(s.load8(&a8), s.load8(&b8), s.splat8(2.5), &mut out);
            doubles(s, shift, &mut out);
            let bytes = std::array::from_fn(|i| (i * 37 + shift * 11) as u8);
            out.extend(s.bytes8(&bytes).to_array().map(f32::to_bits));
            let words = std::array::from_fn(|i| 0x9e37_79b9u32.wrapping_mul((i + shift * 8) as u32));
            for (from, count) in [(0, 7), (shift as u32, 5), (30, 2)] {
                out.extend(s.fields8(&words, from, count).to_array().map(f32::to_bits));
            }
            let word = 0x9a7f_0180u32.rotate_left(shift as u32);
            s.powers8(word).iter().for_each(|p| out.extend(p.to_array().map(f32::to_bits)));
            sorted(s, shift as u32, &a8, &mut out);
            let plain = b.map(|x| if x.is_nan() { 5.0 } else { x });
            let (v8, v16) = (s.load8(&first8(&plain)), s.load16(&plain));
            // The sum with 0.0 makes zeros of either sign equal.
            out.extend([v8.least(), v8.greatest(), v16.least(), v16.greatest()].map(|x| (x + 0.0).to_bits()));
            let rows = std::array::from_fn(|i| std::array::from_fn(|j| (16 * i + j + shift) as f32));
            let mut columns = [[0.0; 16]; 16];
            s.transpose16(&rows, &mut columns);
            out.extend(columns.as_flattened().iter().map(|x| x.to_bits()));
            for first in [0, 10, 12] {
                let four = s.columns4(&rows, first).map(|column| column.to_array().map(f32::to_bits));
                assert_eq!(four, [0, 1, 2, 3].map(|i| columns[first + i].map(f32::to_bits)));
            }
            out.extend(s.lookup16(s.table16(&b), s.index8(&bytes)).to_array().map(f32::to_bits));
            let steps: [u8; 52] = std::array::from_fn(|i| bytes[i % 8].wrapping_mul(37 + i as u8));
            let all = [[0, 1, 2, 3, 4, 5, 6, 7], [8, 9, 10, 11, 12, 13, 14, 15]];
            out.extend(
                all.map(|eight| s.lookup16(s.steps16(b[0], &steps), s.index8(&eight)).to_array().map(f32::to_bits))
                    .as_flattened(),
            );
            numbers(s, shift, &words, &mut out);
            out.extend([s.same16(&b, u32::MAX, VALUES[3].to_bits()), s.same16(&b, 1 << 31, 1 << 31)]);
        }
        out
    }
}

/// Four doubles.
#[inline(always)]
fn doubles<S: Simd>(s: S, shift: usize, out: &mut Vec<u32>) {
    let four = |from: usize| std::array::from_fn(|i| f64::from(VALUES[(i + from) % 16]) * 1.000_000_01);
    let (a, b, c) = (s.load_d4(&four(shift)), s.load_d4(&four(shift / 3 + 5)), s.splat_d4(-2.5));
    let vectors = [a + b, a - b, a * b, a.min(b), a.max(b), c.abs(), b.abs(), a.select(a.le(b), c)];
    // The sign and the content of a NaN are those of either operand.
    let bits = |x: f64| if x.is_nan() { 7 } else { x.to_bits() };
    out.extend(vectors.iter().flat_map(|v| v.to_array()).flat_map(|x| [bits(x) as u32, (bits(x) >> 32) as u32]));
    // Exact: the products of these have few digits.
    let (x, y, z) = (s.load_d4(&[1.0, -2.0, 3.0, 1e10]), s.splat_d4(1.5 + shift as f64), s.splat_d4(-4.25));
    out.extend(
        [x.mul_add(y, z), x.negated_mul_add(y, z)].iter().flat_map(|v| v.to_array()).map(|x| (x as f32).to_bits()),
    );
    let (le, lt) = (a.le(b), a.lt(b));
    out.extend([le.bits(), lt.bits(), le.and(c.lt(a)).bits(), lt.or(a.le(c)).bits()]);
}

/// Numbers near the first one, and at the limits of that.
#[inline(always)]
fn numbers<S: Simd>(s: S, shift: usize, words: &[u32; 8], out: &mut Vec<u32>) {
    let least = -(1 << 23);
    let kinds =
        |i: usize| [least - 1, least, -1, 1, -least - 1, -least, words[i % 8] as i32 >> 9, 1 << 24, -1 << 24, i32::MIN];
    let steps: [i32; 16] = std::array::from_fn(|i| kinds(i)[(i + shift) % 10]);
    let all: [u32; 16] = std::array::from_fn(|i| words[1].wrapping_add_signed(if i == 0 { 0 } else { steps[i] }));
    let fits = |i: usize| i == 0 || (least..-least).contains(&steps[i]);
    assert_eq!(s.near16(&all), (0..16).map(|i| u32::from(fits(i)) << i).sum::<u32>());
    let mut bytes = [0xa5; 4 + 52 + 8];
    s.put_steps16(&all, bytes[4..].first_chunk_mut().expect("52"));
    assert_eq!((bytes[..4].to_vec(), bytes[4 + 52..].to_vec()), (vec![0xa5; 4], vec![0xa5; 8]));
    out.extend(bytes[4..][..45].iter().map(|byte| u32::from(*byte)));
    // The steps are read back for the numbers that are near.
    let table = bytes.first_chunk().expect("52");
    for (from, eight) in [(0, [0, 1, 2, 3, 4, 5, 6, 7]), (8, [8, 9, 10, 11, 12, 13, 14, 15])] {
        let read = s.lookup16(s.steps16(f32::from_bits(all[0]), table), s.index8(&eight)).to_array();
        assert!((0..8).all(|i| !fits(from + i) || read[i].to_bits() == all[from + i]));
    }
}

/// Sorts children: various sets of lanes, and equal distances.
#[inline(always)]
fn sorted<S: Simd>(s: S, seed: u32, values: &[f32; 8], out: &mut Vec<u32>) {
    let enter: [f32; 8] = std::array::from_fn(|i| if values[i].is_nan() { 2.0 } else { values[i].abs() });
    let child = std::array::from_fn(|i| (i * 1000 + seed as usize) as u16);
    for k in 0..16u32 {
        let hits = (seed * 37 + k * 83) & 0xff;
        let (mut t, mut to) = ([0.0; 8], [0; 8]);
        s.far_first(s.load8(&enter), hits, &child, &mut t, &mut to);
        let count = hits.count_ones() as usize;
        assert!(t[..count].is_sorted_by(|a, b| a >= b));
        out.extend(t[..count].iter().map(|t| t.to_bits()));
        out.extend(&to[..count]);
        let links = child.map(u32::from);
        let (mut same_t, mut same_to) = ([0.0; 8], [0; 8]);
        s.order8(s.load8(&enter), hits, &links, &mut same_t, &mut same_to);
        assert_eq!((&same_t[..count], &same_to[..count]), (&t[..count], &to[..count]));
        s.pack8(s.load8(&enter), hits, &links, &mut same_t, &mut same_to);
        let kept: Vec<usize> = (0..8).filter(|i| hits >> i & 1 == 1).collect();
        assert!(kept.iter().zip(same_t).all(|(&i, t)| enter[i].to_bits() == t.to_bits()));
        assert!(kept.iter().zip(same_to).all(|(&i, to)| links[i] == to));
    }
}

fn first8(v: &[f32; 16]) -> [f32; 8] {
    std::array::from_fn(|i| v[i])
}

macro_rules! battery {
    ($name:ident, $n:literal) => {
        #[inline(always)]
        fn $name<L: Lanes<$n>>(a: L, b: L, c: L, out: &mut Vec<u32>) {
            for v in [a + b, a - b, a * b, a.div(b), a.min(b), a.max(b), c, b.select(a.le(b), c)] {
                // The payload of a NaN may differ between sets.
                out.extend(v.to_array().map(|x| if x.is_nan() { 0x7fc0_0000 } else { x.to_bits() }));
            }
            out.extend([a.le(b).bits(), a.eq(b).bits(), a.le(b).and(b.le(c)).bits(), a.le(b).or(b.le(c)).bits()]);
        }
    };
}
battery!(eight, 8);
battery!(sixteen, 16);

#[test]
fn every_set_gives_the_bits_of_the_baseline() {
    let expected = dispatch(Isa::Baseline, Battery);
    assert!(expected.len() > 3000);
    for isa in Isa::ALL {
        if isa.is_available() {
            assert_eq!(dispatch(isa, Battery), expected, "{}", isa.name());
            #[cfg(target_arch = "x86_64")]
            if isa == Isa::Avx512 {
                // SAFETY: the CPU has the set. In unit tests `dispatch` does not choose it.
                assert_eq!(unsafe { avx512::run(Battery) }, expected);
            }
        } else {
            println!("skipped: this CPU lacks {}", isa.name());
        }
    }
}

#[test]
fn denormals_are_flushed_only_while_the_guard_lives() {
    let half = |x: f32| std::hint::black_box(x) * std::hint::black_box(0.5);
    assert!(half(f32::MIN_POSITIVE) > 0.0);
    {
        let _off = DenormalsOff::set();
        if cfg!(target_arch = "x86_64") {
            assert_eq!(half(f32::MIN_POSITIVE), 0.0);
        }
    }
    assert!(half(f32::MIN_POSITIVE) > 0.0);
}

#[cfg(target_arch = "x86_64")]
#[test]
#[allow(deprecated)] // there is no replacement but inline assembly
fn rounding_is_to_nearest_whatever_a_host_has_set() {
    use std::arch::x86_64::{_mm_getcsr, _mm_setcsr};
    const TO_ZERO: u32 = 0x6000;
    let third = || std::hint::black_box(1.0f32) / std::hint::black_box(3.0f32);
    // SAFETY: SSE is part of x86-64; the setting is restored below.
    let before = unsafe { _mm_getcsr() };
    // SAFETY: as above.
    unsafe { _mm_setcsr(before | TO_ZERO) };
    let (unguarded, guarded) = (third(), {
        let _off = DenormalsOff::set();
        third()
    });
    // SAFETY: as above.
    let after = unsafe { _mm_getcsr() };
    // SAFETY: as above.
    unsafe { _mm_setcsr(before) };
    assert_eq!([guarded, unguarded].map(f32::to_bits), [0x3eaa_aaab, 0x3eaa_aaaa]);
    assert_eq!(after & TO_ZERO, TO_ZERO);
    assert_eq!(third().to_bits(), 0x3eaa_aaab);
}
