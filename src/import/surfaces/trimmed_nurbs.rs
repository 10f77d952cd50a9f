//! The `.trimmed_nurbs.json` format: NURBS faces of a CAD model with their trimming loops.
//!
//! `faces` is a list of objects with `degree_u`, `degree_v`, `knots_u`, `knots_v`, `cp` (rows along u of points along
//! v, each `[x, y, z]` or `[x, y, z, w]` and not multiplied by w), `reversed`, and `loops` of `curves` in parameter
//! space. A face whose only loop is a rectangle of parameters is a surface. Others are trimmed, and left out.
//!
//! Faces are parsed one after another, so that only one exists besides the results.

use super::json::{Items, List, Members, Numbers, Object};
use super::{SurfaceData, rectangle};
use crate::base::error::{self, Error, Place};
use crate::base::progress::Cancel;
use glam::DVec3;
use serde_core::de::{DeserializeSeed, Error as _, MapAccess, SeqAccess};
use std::path::Path;

/// The faces of a file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Faces {
    /// Faces that are not trimmed, but to a rectangle of parameters.
    pub surfaces: Vec<SurfaceData>,
    /// Numbers of the faces that are trimmed otherwise and left out.
    pub trimmed: Vec<u64>,
}

/// Reads all faces of a text. A face without loops is the whole surface.
///
/// Fails with [`Error::Parse`], naming line and face, if the text is not such JSON or a face is no valid surface. Fails
/// with `Cancelled`.
pub fn parse(bytes: &[u8], file: &Path, cancel: &Cancel) -> error::Result<Faces> {
    let mut root = Root { faces: Faces::default(), cancel, count: 0, has_faces: false, is_within: false };
    let mut parser = serde_json::Deserializer::from_slice(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes));
    let outcome = Object(&mut root).deserialize(&mut parser).and_then(|()| parser.end());
    cancel.check()?;
    let face = if root.is_within { format!("face {}: ", root.count) } else { String::new() };
    outcome.map_err(|e| Error::parse(file, Place::Line(e.line() as u64), format!("{face}{e}")))?;
    if !root.has_faces {
        return Err(Error::parse(file, Place::File, "has no \"faces\""));
    }
    Ok(root.faces)
}

/// The document, and as a list its faces.
struct Root<'a> {
    faces: Faces,
    cancel: &'a Cancel,
    /// Number of faces so far.
    count: u64,
    has_faces: bool,
    /// True while a face is parsed.
    is_within: bool,
}

impl Members for Root<'_> {
    fn read<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<bool, A::Error> {
        if key != "faces" || self.has_faces {
            return Ok(false);
        }
        self.has_faces = true;
        members.next_value_seed(List(self)).map(|()| true)
    }
}

impl Items for Root<'_> {
    fn read<'de, A: SeqAccess<'de>>(&mut self, items: &mut A) -> Result<bool, A::Error> {
        self.cancel.check().map_err(A::Error::custom)?;
        let mut face = Face::default();
        self.is_within = true;
        let is_one = items.next_element_seed(Object(&mut face))?.is_some();
        if is_one {
            match face.surface(self.count).map_err(A::Error::custom)? {
                Some(surface) => self.faces.surfaces.push(surface),
                None => self.faces.trimmed.push(self.count),
            }
            self.count += 1;
        }
        self.is_within = false;
        Ok(is_one)
    }
}

/// A face as it is in the file. As a list it consists of the rows of its control points.
#[derive(Default)]
struct Face {
    degree: [Option<u32>; 2],
    knots: [Vec<f64>; 2],
    rows: u32,
    columns: u32,
    points: Vec<DVec3>,
    /// Weights of the points; empty if the points have none.
    weights: Vec<f64>,
    is_reversed: bool,
    loops: Loops,
}

impl Members for Face {
    fn read<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<bool, A::Error> {
        match key {
            "degree_u" => self.degree[0] = Some(members.next_value()?),
            "degree_v" => self.degree[1] = Some(members.next_value()?),
            "knots_u" => self.knots[0] = members.next_value()?,
            "knots_v" => self.knots[1] = members.next_value()?,
            "cp" => members.next_value_seed(List(self))?,
            "reversed" => self.is_reversed = members.next_value()?,
            "loops" => members.next_value_seed(List(&mut self.loops))?,
            _ => return Ok(false),
        }
        Ok(true)
    }
}

impl Items for Face {
    fn read<'de, A: SeqAccess<'de>>(&mut self, items: &mut A) -> Result<bool, A::Error> {
        let before = self.points.len();
        if items.next_element_seed(List(&mut Row(self)))?.is_none() {
            return Ok(false);
        }
        let columns = u32::try_from(self.points.len() - before).map_err(A::Error::custom)?;
        if self.rows > 0 && columns != self.columns {
            let why = format!("row {} of \"cp\" has {columns} points, not {} as the first", self.rows, self.columns);
            return Err(A::Error::custom(why));
        }
        self.columns = columns;
        self.rows += 1;
        Ok(true)
    }
}

/// A row of control points.
struct Row<'a>(&'a mut Face);

impl Items for Row<'_> {
    fn read<'de, A: SeqAccess<'de>>(&mut self, items: &mut A) -> Result<bool, A::Error> {
        let mut point = Numbers::<4>::default();
        if items.next_element_seed(List(&mut point))?.is_none() {
            return Ok(false);
        }
        let [x, y, z, w] = point.values;
        let (at, is_weighted) = (self.0.points.len(), point.count == 4);
        if !(3..=4).contains(&point.count) || at > 0 && is_weighted == self.0.weights.is_empty() {
            return Err(A::Error::custom(format!("point {at} of \"cp\" has {} numbers", point.count)));
        }
        self.0.points.push(DVec3::new(x, y, z));
        if is_weighted {
            self.0.weights.push(w);
        }
        Ok(true)
    }
}

/// The loops of a face: the curves of the first, and their number.
#[derive(Default)]
struct Loops {
    count: usize,
    curves: Vec<Vec<[f64; 2]>>,
}

impl Items for Loops {
    fn read<'de, A: SeqAccess<'de>>(&mut self, items: &mut A) -> Result<bool, A::Error> {
        let mut curves = Curves(Vec::new());
        let is_one = items.next_element_seed(Object(&mut curves))?.is_some();
        if is_one {
            self.count += 1;
            self.curves = curves.0;
        }
        Ok(is_one)
    }
}

/// The curves of a loop, and their control points.
struct Curves(Vec<Vec<[f64; 2]>>);

impl Members for Curves {
    fn read<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<bool, A::Error> {
        if key == "curves" { members.next_value_seed(List(self)).map(|()| true) } else { Ok(false) }
    }
}

impl Items for Curves {
    fn read<'de, A: SeqAccess<'de>>(&mut self, items: &mut A) -> Result<bool, A::Error> {
        let mut curve = Curve(Vec::new());
        let is_one = items.next_element_seed(Object(&mut curve))?.is_some();
        if is_one {
            self.0.push(curve.0);
        }
        Ok(is_one)
    }
}

/// The control points of a curve; weights are left out, as they move no straight curve off its line.
struct Curve(Vec<[f64; 2]>);

impl Members for Curve {
    fn read<'de, A: MapAccess<'de>>(&mut self, key: &str, members: &mut A) -> Result<bool, A::Error> {
        if key == "cp" { members.next_value_seed(List(self)).map(|()| true) } else { Ok(false) }
    }
}

impl Items for Curve {
    fn read<'de, A: SeqAccess<'de>>(&mut self, items: &mut A) -> Result<bool, A::Error> {
        let mut point = Numbers::<2>::default();
        let is_one = items.next_element_seed(List(&mut point))?.is_some();
        if is_one && !(2..=3).contains(&point.count) {
            return Err(A::Error::custom(format!("a point of a loop has {} numbers", point.count)));
        }
        if is_one {
            self.0.push(point.values);
        }
        Ok(is_one)
    }
}

impl Face {
    /// The surface with the number `face`; `None` if it is trimmed.
    fn surface(self, face: u64) -> Result<Option<SurfaceData>, String> {
        let [Some(degree_u), Some(degree_v)] = self.degree else {
            return Err("has no \"degree_u\" or no \"degree_v\"".into());
        };
        let weights = (!self.weights.is_empty()).then_some(self.weights);
        let mut surface = SurfaceData {
            face,
            degree: [degree_u, degree_v],
            counts: [self.rows, self.columns],
            knots: self.knots,
            points: self.points,
            weights,
            domain: [[0.0; 2]; 2],
            is_reversed: self.is_reversed,
        };
        surface.domain = surface.desc().domain().map_err(|e| e.to_string())?;
        if self.loops.count == 0 {
            return Ok(Some(surface));
        }
        let knots = surface.knots.each_ref().map(Vec::as_slice);
        let rectangle = rectangle::of_loop(&self.loops.curves, knots, surface.domain);
        let Some(rectangle) = rectangle.filter(|_| self.loops.count == 1) else { return Ok(None) };
        surface.domain = rectangle;
        Ok(Some(surface))
    }
}
