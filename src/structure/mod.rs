//! (structure: being built.)
