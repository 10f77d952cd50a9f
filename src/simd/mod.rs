//! (simd: being built.)
