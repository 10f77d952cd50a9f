//! Files of surfaces as input of a sink.

use super::meshes::{NurbsMesh, extent};
use super::{bpt, trimmed_nurbs};
use crate::base::error::{Error, Place, Result};
use crate::base::memory;
use crate::import::access::Files;
use crate::import::input::Input;
use crate::import::{MeshKey, PartDesc, Sink, stem};

/// The formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Bpt,
    TrimmedNurbs,
}

/// Memory of surfaces for each byte of their text, or less: a number takes two bytes at least, and eight here.
const BYTES: u64 = 8;

/// Reads a file; its surfaces are one part with its name. Faces with trims are left out with a note.
pub(crate) fn read(input: &mut Input, kind: Kind, files: &Files<'_>, sink: &mut dyn Sink) -> Result<()> {
    let (path, total) = (input.path().to_path_buf(), input.total());
    let mut claim = files.options.account.claim();
    if !claim.grow(total.saturating_mul(BYTES)) {
        return Err(claim.over(0.0, 0, format!("reading the surfaces of {}", path.display())));
    }
    let mut text = memory::zeroed(total as usize, "the text of surfaces")?;
    if !input.read_range(0, &mut text)? {
        return Err(input.fault("the file ends before its length"));
    }
    let surfaces = match kind {
        Kind::Bpt => bpt::parse(&text, &path, sink.cancel())?,
        Kind::TrimmedNurbs => {
            let faces = trimmed_nurbs::parse(&text, &path, sink.cancel())?;
            if let Some(first) = faces.trimmed.first() {
                let (file, count) = (path.display(), faces.trimmed.len());
                sink.note(format!("{file}: {count} faces have trims and are left out (first: face {first})"));
            }
            faces.surfaces
        }
    };
    drop(text);
    let part = sink.part(PartDesc { name: stem(&path), ..PartDesc::default() })?;
    if surfaces.is_empty() {
        sink.note(format!("{}: no surfaces; the model is empty", path.display()));
    }
    let extent = extent(surfaces.iter().flat_map(|it| &it.points));
    for it in &surfaces {
        let (is_reversed, domain) = (it.is_reversed, Some(it.domain));
        let mesh = NurbsMesh { desc: it.desc(), is_reversed, domain, extent, part };
        sink.nurbs(MeshKey::DIRECT, &mesh).map_err(|error| match error {
            Error::BadArgument(why) => Error::parse(&path, Place::File, format!("face {}: {why}", it.face)),
            other => other,
        })?;
    }
    Ok(())
}
