//! (residency: being built.)
