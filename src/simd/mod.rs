//! Instruction sets chosen at run time, and vectors of 8 and 16 floats over them.
//!
//! The only room with intrinsics. An algorithm is written once, generic over [`Simd`], as an
//! [`Op`]; [`dispatch`] runs it compiled for the chosen set. Everything an `Op` calls on its hot
//! path must be `#[inline(always)]`, or it is compiled without the set. A closure never is, and neither is
//! what takes one (`array::map`): plain functions only.
//!
//! Soundness: a vector of a set can only be made through that set's token, and a token only exists
//! where [`dispatch`] has checked the CPU. So the operations themselves are safe to call.
//!
//! All sets give the same bits (no approximate reciprocals) but for `mul_add` and `slabs`. Box tests use them, which
//! are conservative by more than their rounding; and planes of cells, whose products are exact, so that there is one
//! rounding.

mod common;
mod lanes;
mod one;
mod portable;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;

pub use common::Common;
pub use lanes::{Lanes, Mask, Simd};
pub use portable::{Array, Portable};

use std::sync::OnceLock;

/// An instruction set that code can be run with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u32)]
pub enum Isa {
    /// What every CPU of the target has (SSE2 on x86-64).
    Baseline = 1,
    /// AVX2 with FMA and BMI, which come along.
    Avx2 = 2,
    /// AVX-512 F, VL, DQ and BW, and all of AVX2.
    Avx512 = 3,
}

impl Isa {
    /// All sets, from the least to the greatest.
    pub const ALL: [Isa; 3] = [Isa::Baseline, Isa::Avx2, Isa::Avx512];

    /// Whether this CPU has it.
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

    /// The greatest set that this CPU has. Detected once.
    pub fn best() -> Self {
        static BEST: OnceLock<Isa> = OnceLock::new();
        *BEST.get_or_init(|| Self::ALL.into_iter().rev().find(|isa| isa.is_available()).unwrap_or(Isa::Baseline))
    }

    /// Its usual name.
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
    /// What it returns.
    type Out;
    /// The algorithm. Implementations are `#[inline(always)]`.
    fn run<S: Simd>(self, s: S) -> Self::Out;
}

/// Runs `op` compiled for `isa`, or for the baseline where the CPU lacks it.
///
/// In an unoptimised caller the call costs one branch: dispatch once for each batch, not for each
/// element.
#[inline]
pub fn dispatch<O: Op>(isa: Isa, op: O) -> O::Out {
    #[cfg(target_arch = "x86_64")]
    {
        // Each set contains those before it, so one comparison with the best answers for all.
        match isa.min(Isa::best()) {
            // SAFETY: the CPU has the set: it is not beyond the best that was detected.
            Isa::Avx512 => return unsafe { avx512::run(op) },
            // SAFETY: as above.
            Isa::Avx2 => return unsafe { avx2::run(op) },
            Isa::Baseline => {}
        }
    }
    let _ = isa;
    op.run(Portable::new())
}

/// Asks the CPU to bring the cache line at `data` into the L1; a hint, never a fault, whatever the address.
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

/// Asks the CPU to bring the cache line at `data` into the L2: of what comes later, and much of it. Otherwise as
/// [`prefetch`].
#[inline(always)]
pub fn prefetch_l2<T>(data: *const T) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: as of `prefetch`.
    unsafe {
        std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T1 }>(data.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = data;
}

/// Sets the calling thread to flush-to-zero and denormals-are-zero until dropped: a denormal operand costs a hundred
/// cycles. Results of ours do not depend on it: error bounds cover it. And to what these rely on, whatever a host has
/// set: rounding to nearest, and no exceptions.
#[derive(Debug)]
pub struct DenormalsOff {
    #[cfg(target_arch = "x86_64")]
    before: u32,
    /// The setting is the thread's: the guard must not leave it.
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
            // SAFETY: as above: FTZ (bit 15), DAZ (bit 6), all exceptions masked (bits 7 to 12), rounding to nearest
            // (13 and 14 zero); restored on drop.
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
        // SAFETY: restores what `set` read from this same thread.
        unsafe {
            std::arch::x86_64::_mm_setcsr(self.before);
        }
    }
}

#[cfg(test)]
mod tests;
