//! (build: being built.)
