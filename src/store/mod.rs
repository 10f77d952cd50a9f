//! The model file: written once from front to back, read at random offsets, with every byte checked. The payload of a
//! block is opaque to this module. The scene file names models and places them. `FORMAT.md` in this folder describes
//! both files byte by byte. Uses base.
#![forbid(unsafe_code)]

mod aside;
pub mod codec;
pub mod contents;
pub mod directory;
pub mod header;
mod opening;
#[cfg(unix)]
mod page_cache;
pub mod part_sets;
mod parts;
pub mod proxies;
pub mod reader;
pub mod scene_file;
pub mod sections;
pub mod source;
pub mod writer;

pub use aside::Aside;
pub use codec::{Codec, EncodedBlock};
pub use header::{Drops, Header, Options};
pub use opening::Outline;
pub use part_sets::PartSets;
pub use parts::{Part, Parts};
pub use proxies::{Proxies, ProxyRow};
pub use reader::{CheckReport, ModelFile};
pub use sections::{CLASSES, InstanceRow, MaterialRow, PartRow, TreeRow};
pub use source::{CallbackSource, FileSource, MemorySource, Source};
pub use writer::Writer;
