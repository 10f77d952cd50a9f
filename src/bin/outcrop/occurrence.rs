//! What `outcrop render --occurrence` prints: which place of which mesh a picture shows at a pixel.

use outcrop::base::error::Error;
use outcrop::query::{HitKind, NONE};
use outcrop::render::{Buffer, Frame, Outputs};
use outcrop::scene::SceneState;
use serde_json::{Value, json};

/// Buffers that [`at_pixel`] reads.
pub const OUTPUTS: Outputs = Outputs(
    Outputs::of(Buffer::Part).0
        | Outputs::of(Buffer::Primitive).0
        | Outputs::of(Buffer::Kind).0
        | Outputs::of(Buffer::Error).0
        | Outputs::of(Buffer::Occurrence).0,
);

/// What the last picture shows at the centre of a pixel.
struct Shown {
    occurrence: u64,
    part: u64,
    prim: u64,
    /// A [`HitKind`].
    kind: u8,
    error: f32,
}

impl Shown {
    fn read(frame: &Frame, (x, y): (u32, u32)) -> Result<Self, Error> {
        let bytes = |buffer: Buffer| {
            let mapped = frame.map(buffer)?;
            let at = y as usize * mapped.row_pitch() + x as usize * buffer.pixel_bytes();
            let mut all = [0; 8];
            all[..buffer.pixel_bytes()].copy_from_slice(&mapped.bytes()[at..at + buffer.pixel_bytes()]);
            Ok::<_, Error>(all)
        };
        let id = |buffer: Buffer| bytes(buffer).map(u64::from_ne_bytes);
        let [a, b, c, d, ..] = bytes(Buffer::Error)?;
        Ok(Self {
            occurrence: id(Buffer::Occurrence)?,
            part: id(Buffer::Part)?,
            prim: id(Buffer::Primitive)?,
            kind: bytes(Buffer::Kind)?[0],
            error: f32::from_ne_bytes([a, b, c, d]),
        })
    }

    /// The kind in JSON and in text.
    fn kind(&self) -> (&'static str, &'static str) {
        match self.kind {
            kind if kind == HitKind::Exact as u8 => ("exact", "a triangle"),
            kind if kind == HitKind::Lod as u8 => ("lod", "a stand-in"),
            _ => ("missing", "a stand-in for data that is not in memory"),
        }
    }
}

/// Returns what the last picture shows at a pixel, as JSON and as text. Also the exact surface there.
pub fn at_pixel(frame: &Frame, state: &SceneState, (x, y): (u32, u32)) -> Result<(Value, String), Error> {
    let shown = Shown::read(frame, (x, y))?;
    let (Some((path, place)), Some(model)) = (state.path(shown.occurrence), state.model_of(shown.occurrence)) else {
        return Ok((Value::Null, format!("{x},{y}: nothing")));
    };
    let hit = frame.pick(x, y)?;
    let part = model.parts().iter().find(|part| part.id == shown.part);
    let name = part.as_ref().map_or("", |part| part.name);
    let (kind, kind_text) = shown.kind();
    let is_hit = hit.kind != HitKind::Miss;
    let value = json!({
        "pixel": [x, y], "number": shown.occurrence, "path": path, "world_from_model": place.to_cols_array(),
        "model": model.info().name, "part": shown.part, "name": name, "kind": kind,
        "prim": (shown.prim != NONE).then_some(shown.prim),
        // JSON has no infinity.
        "error": shown.error.is_finite().then_some(shown.error),
        "position": is_hit.then(|| hit.position.to_array()),
    });
    let path = path.iter().map(u64::to_string).collect::<Vec<_>>().join(" / ");
    let columns = place.to_cols_array();
    let [a, b, c, at] = [0, 3, 6, 9].map(|i| format!("{:.6} {:.6} {:.6}", columns[i], columns[i + 1], columns[i + 2]));
    let surface = match is_hit {
        true => format!("{:.6} {:.6} {:.6}", hit.position.x, hit.position.y, hit.position.z),
        false => "nowhere".into(),
    };
    let text = format!(
        "{x},{y}: occurrence {}, path {path}, part {} {name:?} of {}\n\
         {kind_text}, error {:?} units; the exact surface at the pixel's centre is at {surface}\n\
         columns of its map to the world: {a}, {b}, {c}; moved by {at}",
        shown.occurrence,
        shown.part,
        model.info().name,
        shown.error,
    );
    Ok((value, text))
}
