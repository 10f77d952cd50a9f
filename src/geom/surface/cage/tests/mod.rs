//! Tests of cages with access to their parts. Comparisons with other libraries: `tests/surfaces.rs`.

mod bad_input;
mod closed_forms;
mod enclosure;
mod limits;
pub(crate) mod shapes;
mod words;
