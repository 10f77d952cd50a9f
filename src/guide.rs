// The guide for users, one module a page. The modules hold documentation only; `tests/guide.rs` compiles and runs the
// snippets of the pages. `links.md` defines the links between pages for rustdoc. The definitions at the end of each
// page are for readers of the files: the first definition of a name counts.
#![doc = include_str!("guide/links.md")]
#![doc = include_str!("guide/index.md")]

#[doc = include_str!("guide/links.md")]
#[doc = include_str!("guide/concepts.md")]
pub mod concepts {}

#[doc = include_str!("guide/links.md")]
#[doc = include_str!("guide/promise.md")]
pub mod promise {}

#[doc = include_str!("guide/links.md")]
#[doc = include_str!("guide/budgets.md")]
pub mod budgets {}

#[doc = include_str!("guide/links.md")]
#[doc = include_str!("guide/embree.md")]
pub mod embree {}

#[doc = include_str!("guide/links.md")]
#[doc = include_str!("guide/limits.md")]
pub mod limits {}

#[doc = include_str!("store/FORMAT.md")]
#[allow(rustdoc::broken_intra_doc_links)] // brackets of types such as u8[8] are no links
pub mod format {}

#[doc = include_str!("guide/links.md")]
#[doc = include_str!("guide/figures.md")]
pub mod figures {}

#[doc = include_str!("guide/links.md")]
#[doc = include_str!("guide/questions.md")]
pub mod questions {}
