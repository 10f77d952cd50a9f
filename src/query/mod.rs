//! (query: being built.)
