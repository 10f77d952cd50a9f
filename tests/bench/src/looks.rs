//! What stand-ins look like in a picture: how bright they are, and what they show that is hidden.

use crate::common::foreign::{self, foreign_parts};
use crate::common::picture::{Colours, is_covered, radiance_ratio};
use crate::failure::Failure;
use crate::ours::Ours;
use crate::pictures::{self, Shown};
use crate::record::Accuracy;
use outcrop::scene::Camera;
use outcrop::{Buffer, Frame, Outputs};

/// Pixels of the exact picture for each, along each edge, where parts are compared.
const FINE: u32 = 3;

/// All that is compared of a picture.
pub struct Look {
    pub shown: Shown,
    /// Four values a pixel.
    linear: Vec<f32>,
    parts: Vec<u64>,
}

impl Look {
    /// Of a frame with [`Look::outputs`].
    pub fn of(frame: &Frame) -> Result<Self, Failure> {
        let linear = frame.map(Buffer::ColourLinear)?.floats().ok_or_else(|| Failure::new("no floats"))?.to_vec();
        Ok(Self { shown: Shown::of(frame)?, linear, parts: parts(frame)? })
    }

    /// Pixels that differ, in words.
    pub fn differences(&self, other: &Self) -> String {
        fn count<T: PartialEq>(a: &[T], b: &[T], each: usize) -> usize {
            a.chunks(each).zip(b.chunks(each)).filter(|(a, b)| a != b).count()
        }
        let (a, b) = (&self.shown, &other.shown);
        format!(
            "{} depths, {} normals, {} colours, {} parts of {} pixels",
            count(&a.depths, &b.depths, 1),
            count(&a.normals, &b.normals, 3),
            count(&a.colours, &b.colours, 4),
            count(&self.parts, &other.parts, 1),
            a.depths.len()
        )
    }

    /// What a frame needs beside [`pictures::outputs`].
    pub fn outputs() -> Outputs {
        pictures::outputs() | Outputs::of(Buffer::ColourLinear) | Outputs::of(Buffer::Part)
    }
}

fn parts(frame: &Frame) -> Result<Vec<u64>, Failure> {
    Ok(frame.map(Buffer::Part)?.ids().ok_or_else(|| Failure::new("parts are ids"))?.to_vec())
}

/// The exact picture of a view.
pub struct Truth {
    pub look: Look,
    /// With [`FINE`] times [`FINE`] pixels for each; none of a model of one part, where none can be foreign.
    fine: Option<Vec<u64>>,
    camera: Camera,
    size: (u32, u32),
}

impl Truth {
    pub fn of(ours: &Ours, camera: &Camera, size: (u32, u32)) -> Result<Self, Failure> {
        let exact = |outputs, size| -> Result<Frame, Failure> {
            let frame = pictures::frame_with(&ours.context, outputs, size)?;
            pictures::render(&frame, ours, camera, 0.0)?;
            Ok(frame)
        };
        let look = Look::of(&exact(Look::outputs(), size)?)?;
        let fine_size = (size.0 * FINE, size.1 * FINE);
        let has_several = ours.model.parts().len() > 1;
        let fine = has_several.then(|| parts(&exact(Outputs::of(Buffer::Part), fine_size)?)).transpose()?;
        Ok(Self { look, fine, camera: *camera, size })
    }

    /// How far a picture is off.
    pub fn errors(&self, look: &Look) -> Result<Accuracy, Failure> {
        let width = self.size.0 as usize;
        let foreign = self.fine.as_ref().map(|fine| {
            let picture = |parts, times, width| {
                let colours = Colours::Linear(&look.linear);
                foreign::Shown { width, times, parts, colours }
            };
            let times = FINE as usize;
            foreign_parts(&picture(&look.parts, 1, width), &picture(fine, times, width * times)).value()
        });
        let truth = &self.look.shown;
        let [seen, wanted] = [look, &self.look].map(|look| Colours::Linear(&look.linear));
        let brightness = Some(radiance_ratio(seen, wanted, |pixel| is_covered(truth.depths[pixel])));
        Ok(Accuracy { foreign, brightness, ..look.shown.errors(truth, &self.camera, self.size)? })
    }
}
