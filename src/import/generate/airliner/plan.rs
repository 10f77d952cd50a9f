//! The plan of the model: parts, and families of similar elements in each of them.

use super::soup::Soup;
use crate::import::{MaterialDesc, PartDesc};
use glam::DVec2;

/// Function that makes element `i` of a family.
pub type Make = Box<dyn Fn(u64, &mut Soup) + Send + Sync>;

/// Elements of one part with the same number of triangles.
pub struct Family {
    /// Index of the part.
    pub part: u32,
    /// Number of elements.
    pub count: u64,
    /// Number of triangles of each element.
    pub triangles: u64,
    /// Index of the first element's stream of random numbers.
    pub stream: u64,
    /// Every `twins`-th element is an exact copy of the one before it; 0 for none.
    pub twins: u64,
    /// True if elements may be added to reach the target number of triangles.
    pub fills: bool,
    /// Function that makes an element.
    pub make: Make,
}

/// Surface of a part; an index into [`MATERIALS`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
#[allow(missing_docs)]
pub enum Look {
    White,
    Blue,
    Primer,
    Stringer,
    Clip,
    Steel,
    CableOrange,
    CableYellow,
    CableBlack,
    PipeBlue,
    PipeRed,
    Aluminium,
    Seat,
    Cream,
    Floor,
    Rubber,
    Titanium,
    Glass,
    Wool,
}

/// Materials by [`Look`], as (linear colour, opacity, metalness, roughness, name).
pub const MATERIALS: [([f32; 3], f32, f32, f32, &str); 19] = [
    ([0.80, 0.81, 0.83], 1.0, 0.0, 0.35, "white paint"),
    ([0.03, 0.10, 0.33], 1.0, 0.0, 0.35, "blue paint"),
    ([0.22, 0.34, 0.09], 1.0, 0.0, 0.60, "green primer"),
    ([0.38, 0.44, 0.10], 1.0, 0.0, 0.60, "yellow primer"),
    ([0.30, 0.36, 0.28], 1.0, 0.2, 0.50, "bracket"),
    ([0.46, 0.46, 0.48], 1.0, 1.0, 0.35, "steel"),
    ([0.80, 0.25, 0.03], 1.0, 0.0, 0.50, "orange cable"),
    ([0.75, 0.55, 0.05], 1.0, 0.0, 0.50, "yellow cable"),
    ([0.04, 0.04, 0.05], 1.0, 0.0, 0.50, "black cable"),
    ([0.05, 0.22, 0.55], 1.0, 0.1, 0.40, "blue pipe"),
    ([0.55, 0.04, 0.03], 1.0, 0.1, 0.40, "red pipe"),
    ([0.62, 0.63, 0.65], 1.0, 1.0, 0.30, "aluminium"),
    ([0.04, 0.08, 0.22], 1.0, 0.0, 0.90, "seat cloth"),
    ([0.72, 0.66, 0.55], 1.0, 0.0, 0.60, "cabin lining"),
    ([0.20, 0.20, 0.21], 1.0, 0.0, 0.80, "floor"),
    ([0.02, 0.02, 0.02], 1.0, 0.0, 0.90, "rubber"),
    ([0.32, 0.29, 0.26], 1.0, 1.0, 0.40, "titanium"),
    ([0.10, 0.16, 0.20], 0.4, 0.0, 0.05, "glass"),
    ([0.62, 0.45, 0.47], 1.0, 0.0, 0.95, "insulation"),
];

impl Look {
    /// Returns the material of a row of [`MATERIALS`].
    pub fn desc(row: &([f32; 3], f32, f32, f32, &str)) -> MaterialDesc {
        MaterialDesc { colour: row.0, opacity: row.1, metalness: row.2, roughness: row.3 }
    }
}

/// The whole model at one level of detail.
pub struct Plan {
    /// Level of detail; 1 gives about five million triangles.
    pub detail: f64,
    /// Parts, parents before children.
    pub parts: Vec<PartDesc>,
    /// Families in the order in which they are written.
    pub families: Vec<Family>,
    streams: u64,
}

impl Plan {
    /// Creates an empty plan.
    pub fn new(detail: f64) -> Self {
        Self { detail, parts: Vec::new(), families: Vec::new(), streams: 0 }
    }

    /// Returns `base` times the given power of the detail, but at least `least`.
    pub fn scaled(&self, base: f64, power: f64, least: u64) -> u64 {
        ((base * self.detail.powf(power)).round() as u64).max(least)
    }

    /// True if the detail is so low that even simple elements are simplified.
    pub fn is_coarse(&self) -> bool {
        self.detail < 0.05
    }

    /// Returns a closed profile of sheet metal. At low detail returns only its first `face` points, open.
    pub fn profile(&self, whole: &'static [DVec2], face: usize) -> (&'static [DVec2], bool) {
        if self.is_coarse() { (&whole[..face], false) } else { (whole, true) }
    }

    /// Adds a group without triangles of its own.
    pub fn group(&mut self, name: impl Into<String>, parent: Option<u32>) -> u32 {
        self.add(name.into(), parent, None)
    }

    /// Adds a part.
    pub fn part(&mut self, name: impl Into<String>, parent: u32, look: Look) -> u32 {
        self.add(name.into(), Some(parent), Some(look as u32))
    }

    fn add(&mut self, name: String, parent: Option<u32>, material: Option<u32>) -> u32 {
        let index = self.parts.len() as u32;
        self.parts.push(PartDesc { id: Some(1000 + u64::from(index)), name, parent, material });
        index
    }

    /// Adds a family.
    pub fn family(
        &mut self,
        part: u32,
        count: u64,
        triangles: u64,
        make: impl Fn(u64, &mut Soup) + Send + Sync + 'static,
    ) {
        let stream = self.streams;
        self.streams += 1 << 32;
        self.families.push(Family { part, count, triangles, stream, twins: 0, fills: false, make: Box::new(make) });
    }

    /// Makes every `every`-th element of the last family a copy.
    pub fn with_twins(&mut self, every: u64) {
        if let Some(f) = self.families.last_mut() {
            f.twins = every;
        }
    }

    /// Allows [`Plan::fill`] to add elements to the last family.
    pub fn fills(&mut self) {
        if let Some(f) = self.families.last_mut() {
            f.fills = true;
        }
    }

    /// Adds elements to the families that allow it, up to `wanted` triangles.
    pub fn fill(&mut self, wanted: u64) {
        let mut left = wanted.saturating_sub(self.triangles());
        let mut families = self.families.iter().filter(|f| f.fills).count() as u64;
        for f in self.families.iter_mut().filter(|f| f.fills) {
            let more = left / families / f.triangles;
            f.count += more;
            left -= more * f.triangles;
            families -= 1;
        }
    }

    /// Adds a doubler: the triangles of the last family, bit for bit, in another part.
    pub fn double(&mut self, part: u32, make: impl Fn(u64, &mut Soup) + Send + Sync + 'static) {
        if let Some(last) = self.families.last() {
            let (count, triangles, stream) = (last.count, last.triangles, last.stream);
            self.families.push(Family { part, count, triangles, stream, twins: 0, fills: false, make: Box::new(make) });
        }
    }

    /// Returns the total number of triangles.
    pub fn triangles(&self) -> u64 {
        self.families.iter().map(|f| f.count * f.triangles).sum()
    }
}
