//! Instruction sets chosen at run time, and vectors of 8 and 16 floats and of 4 doubles that use them.
//!
//! This is the only room with intrinsics. An algorithm is written once, generic over [`Simd`], as an [`Op`];
//! [`dispatch`] runs it compiled for the chosen set. All functions on the hot path of an `Op` must be
//! `#[inline(always)]`, or they are compiled without the set. Closures are always compiled without it, and so are
//! functions that take closures, such as `array::map`: hot paths use plain functions only.
//!
//! Soundness: a vector of a set can be made only through that set's token, and a token exists only if [`dispatch`] has
//! checked the CPU. So the operations themselves are safe to call.
//!
//! All sets give the same bits (they use no approximate reciprocals), except for `mul_add` and `slabs`. Only three
//! kinds of code use these: box tests and filters of exact signs, which are conservative by more than the rounding,
//! and planes of cells, whose products are exact, so that there is only one rounding.

mod common;
mod doubles;
mod lanes;
mod one;
mod portable;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "x86_64")]
mod order;

pub use common::Common;
pub use doubles::{Array4, Doubles};
pub use lanes::{Lanes, Mask, Simd};
pub use portable::{Array, Portable};

use std::sync::OnceLock;

/// An instruction set that code can be compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u32)]
pub enum Isa {
    /// The set that every CPU of the target has (SSE2 on x86-64).
    Baseline = 1,
    /// AVX2 with FMA and BMI, which CPUs with AVX2 have.
    Avx2 = 2,
    /// AVX-512 F, VL, DQ and BW, and all of AVX2.
    Avx512 = 3,
}

impl Isa {
    /// All sets, from the least to the greatest.
    pub const ALL: [Isa; 3] = [Isa::Baseline, Isa::Avx2, Isa::Avx512];

    /// True if this CPU has the set.
    pub fn is_available(self) -> bool {
        match self {
            Isa::Baseline => true,
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("fma")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("lzcnt")
                    && is_x86_feature_detected!("popcnt")
            }
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => {
                Isa::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// The greatest set of this CPU. Detected once.
    pub fn best() -> Self {
        static BEST: OnceLock<Isa> = OnceLock::new();
        *BEST.get_or_init(|| Self::ALL.into_iter().rev().find(|isa| isa.is_available()).unwrap_or(Isa::Baseline))
    }

    /// The usual name.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Baseline => "baseline",
            Isa::Avx2 => "AVX2",
            Isa::Avx512 => "AVX-512",
        }
    }
}

/// An algorithm that is compiled once for each instruction set.
pub trait Op {
    /// The result.
    type Out;
    /// The algorithm. Implementations are `#[inline(always)]`.
    fn run<S: Simd>(self, s: S) -> Self::Out;
}

/// Runs `op` compiled for `isa`, or for the best set of the CPU if that is less.
///
/// The call cannot be inlined into its caller, which is compiled without the set: dispatch once for each batch, not for
/// each element.
///
/// In the crate's unit tests AVX2 takes the place of AVX-512, but in the tests of this room: to compile all kernels for
/// a third set takes longer than all of these tests, and the tests in `tests/` compare the sets kernel by kernel.
#[inline]
pub fn dispatch<O: Op>(isa: Isa, op: O) -> O::Out {
    #[cfg(target_arch = "x86_64")]
    {
        // Each set contains those before it, so the lesser of `isa` and the best set is available.
        match isa.min(Isa::best()) {
            // SAFETY: the CPU has the set, which is not greater than the best one that was detected.
            #[cfg(not(test))]
            Isa::Avx512 => return unsafe { avx512::run(op) },
            // SAFETY: as above; AVX-512 contains AVX2.
            #[cfg(test)]
            Isa::Avx512 => return unsafe { avx2::run(op) },
            // SAFETY: as above.
            Isa::Avx2 => return unsafe { avx2::run(op) },
            Isa::Baseline => {}
        }
    }
    let _ = isa;
    op.run(Portable::new())
}

/// Asks the CPU to load the cache line at `data` into the L1 cache. A hint that never faults, whatever the address.
#[inline(always)]
pub fn prefetch<T>(data: *const T) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: a prefetch has no architectural effect, and SSE is part of x86-64.
    unsafe {
        std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(data.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = data;
}

/// Asks the CPU to load the cache line at `data` into the L2 cache, for data that is needed later, or that is large.
/// Otherwise like [`prefetch`].
#[inline(always)]
pub fn prefetch_l2<T>(data: *const T) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: as in `prefetch`.
    unsafe {
        std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T1 }>(data.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = data;
}

/// Sets the calling thread to flush-to-zero and denormals-are-zero until dropped: a denormal operand costs a hundred
/// cycles. The error bounds of this crate cover the difference. The guard also sets rounding to nearest and masks
/// exceptions, which the bounds rely on, whatever the host has set.
#[derive(Debug)]
pub struct DenormalsOff {
    #[cfg(target_arch = "x86_64")]
    before: u32,
    /// The setting belongs to the thread, so the guard must not be sent to another.
    _not_send: std::marker::PhantomData<*const ()>,
}

impl DenormalsOff {
    /// Sets the calling thread.
    #[allow(deprecated)] // reading MXCSR has no replacement but inline assembly
    pub fn set() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::x86_64::{_mm_getcsr, _mm_setcsr};
            // SAFETY: SSE is part of x86-64.
            let before = unsafe { _mm_getcsr() };
            // SAFETY: as above. The value sets FTZ (bit 15) and DAZ (bit 6), masks all exceptions (bits 7 to 12), and
            // selects rounding to nearest (bits 13 and 14 zero). It is restored on drop.
            unsafe { _mm_setcsr(0x1f80 | 0x8040) };
            Self { before, _not_send: std::marker::PhantomData }
        }
        #[cfg(not(target_arch = "x86_64"))]
        Self { _not_send: std::marker::PhantomData }
    }
}

impl Drop for DenormalsOff {
    #[allow(deprecated)]
    fn drop(&mut self) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: restores the value that `set` read in this thread.
        unsafe {
            std::arch::x86_64::_mm_setcsr(self.before);
        }
    }
}

#[cfg(test)]
mod tests;
