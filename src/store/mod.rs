//! (store: being built.)
