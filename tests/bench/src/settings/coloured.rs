//! Colours of triangles by formula, for pictures of models that have none.

use glam::{DAffine3, DVec3};
use outcrop::Result;
use outcrop::base::progress::Cancel;
use outcrop::base::units::UpAxis;
use outcrop::import::{Attributes, MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, Sink};

/// Passes everything on, and gives each triangle one colour.
pub struct Coloured<'a> {
    pub to: &'a mut dyn Sink,
    /// Length of a wave of colours.
    pub wave: f64,
}

impl Coloured<'_> {
    fn colour(&self, [a, b, c]: &[DVec3; 3]) -> [f32; 3] {
        let middle = (a + b + c) * (std::f64::consts::TAU / (3.0 * self.wave));
        [middle.x, middle.y + 2.0, middle.z + 4.0].map(|x| 0.5 + 0.4 * x.sin() as f32)
    }
}

impl Sink for Coloured<'_> {
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis) {
        self.to.units(metres_per_unit, up);
    }

    fn material(&mut self, material: MaterialDesc) -> Result<MaterialKey> {
        self.to.material(material)
    }

    fn part(&mut self, part: PartDesc) -> Result<PartKey> {
        self.to.part(part)
    }

    fn shared_mesh(&mut self, local_parts: u32) -> Result<MeshKey> {
        self.to.shared_mesh(local_parts)
    }

    fn triangles(&mut self, mesh: MeshKey, part: u32, positions: &[[DVec3; 3]], own: Attributes<'_>) -> Result<()> {
        let colours: Vec<[[f32; 3]; 3]> = positions.iter().map(|t| [self.colour(t); 3]).collect();
        self.to.triangles(mesh, part, positions, Attributes { colours: Some(&colours), ..own })
    }

    fn instance(&mut self, mesh: MeshKey, world_from_mesh: DAffine3, first_part: PartKey) -> Result<()> {
        self.to.instance(mesh, world_from_mesh, first_part)
    }

    fn at(&mut self, bytes: u64, total: u64) {
        self.to.at(bytes, total);
    }

    fn note(&mut self, text: String) {
        self.to.note(text);
    }

    fn cancel(&self) -> &Cancel {
        self.to.cancel()
    }
}
