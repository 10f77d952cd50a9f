//! The marks of points, in four shapes.

use plotters::element::{Drawable, PointCollection};
use plotters::style::RGBColor;
use plotters_backend::{BackendCoord, DrawingBackend, DrawingErrorKind};

/// A mark around a point.
pub struct Mark<At> {
    pub at: At,
    pub colour: RGBColor,
    /// By number: dot, triangle, square, cross, and again.
    pub shape: usize,
}

impl<'a, At: 'a> PointCollection<'a, At> for &'a Mark<At> {
    type Point = &'a At;
    type IntoIter = std::iter::Once<&'a At>;

    fn point_iter(self) -> Self::IntoIter {
        std::iter::once(&self.at)
    }
}

impl<At, DB: DrawingBackend> Drawable<DB> for Mark<At> {
    fn draw<I: Iterator<Item = BackendCoord>>(
        &self,
        mut points: I,
        backend: &mut DB,
        _: (u32, u32),
    ) -> Result<(), DrawingErrorKind<DB::ErrorType>> {
        let Some((x, y)) = points.next() else { return Ok(()) };
        let colour = &self.colour;
        match self.shape % 4 {
            0 => backend.draw_circle((x, y), 4, colour, true),
            1 => backend.fill_polygon([(x - 5, y + 4), (x + 5, y + 4), (x, y - 6)], colour),
            2 => backend.draw_rect((x - 4, y - 4), (x + 4, y + 4), colour, true),
            _ => {
                let bold = plotters::style::ShapeStyle { stroke_width: 2, ..colour.into() };
                backend.draw_line((x - 4, y - 4), (x + 4, y + 4), &bold)?;
                backend.draw_line((x - 4, y + 4), (x + 4, y - 4), &bold)
            }
        }
    }
}
