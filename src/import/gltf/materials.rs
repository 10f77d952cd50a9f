//! Materials, which are declared at first use, and their textures, which are decoded at first use.
//!
//! An error in a material or texture cannot make the geometry wrong. It is therefore noted, and the material has its
//! default or its base colour.

use super::buffers::Buffers;
use super::model::{AlphaMode, Material, Model, TextureInfo};
use super::notes::Notes;
use super::texture::{Alpha, Mapping, Texture, Wrap};
use crate::base::error::{Error, Place};
use crate::import::colour::unit;
use crate::import::input::{Fault, Parsed};
use crate::import::{MaterialDesc, MaterialKey, Sink};
use std::collections::{HashMap, HashSet};
use std::rc::Rc;

/// Number of decoded textures that are kept, with up to 40 MB each.
const KEPT: usize = 8;

/// A declared material.
#[derive(Clone)]
pub(crate) struct Looks {
    pub(crate) key: MaterialKey,
    /// Linear base colour.
    pub(crate) colour: [f32; 3],
    pub(crate) texture: Option<Painted>,
}

/// The texture of a material's base colour.
#[derive(Clone, Copy)]
pub(crate) struct Painted {
    pub(crate) texture: usize,
    pub(crate) alpha: Alpha,
    /// Set of texture coordinates.
    pub(crate) set: u64,
    pub(crate) mapping: Mapping,
}

/// A decoded image, or `None` if it failed to decode.
struct Decoded {
    image: usize,
    alpha: Alpha,
    texture: Option<Rc<Texture>>,
}

/// The document's materials and textures that were used so far.
#[derive(Default)]
pub(crate) struct Materials {
    known: HashMap<usize, Looks>,
    /// Cache of images, most recently used last.
    images: Vec<Decoded>,
    /// Images with a note.
    noted: HashSet<usize>,
}

impl Materials {
    /// Returns material `index`, and declares it at first use. A material that does not exist is noted.
    pub(crate) fn get(
        &mut self,
        index: usize,
        model: &Model,
        buffers: &mut Buffers<'_>,
        notes: &mut Notes,
        sink: &mut dyn Sink,
    ) -> Parsed<Option<Looks>> {
        if let Some(looks) = self.known.get(&index) {
            return Ok(Some(looks.clone()));
        }
        let Some(material) = model.materials.find(index) else {
            notes.add("materials do not exist; the default material is used", || format!("materials[{index}]"));
            return Ok(None);
        };
        let painted = material.texture.as_ref().map(|info| painted(info, material, model));
        let desc = self.describe(material, painted.as_ref(), model, buffers, sink)?;
        if material.alpha != AlphaMode::Opaque && painted.is_some() {
            notes.add(TRANSPARENT_TEXTURES, || match &material.name {
                Some(name) => name.to_string(),
                None => format!("materials[{index}]"),
            });
        }
        let looks = Looks { key: sink.material(desc)?, colour: desc.colour, texture: painted };
        self.known.insert(index, looks.clone());
        Ok(Some(looks))
    }

    fn describe(
        &mut self,
        material: &Material,
        painted: Option<&Painted>,
        model: &Model,
        buffers: &mut Buffers<'_>,
        sink: &mut dyn Sink,
    ) -> Parsed<MaterialDesc> {
        let (mut metalness, mut roughness) = (material.metalness as f32, material.roughness as f32);
        if let Some(index) = material.metal_rough
            && let Some(texture) = self.texture(index, Alpha::Ignored, model, buffers, sink)?
        {
            // Roughness is in the green channel, metalness in blue; neither is sRGB-coded.
            let [_, green, blue] = texture.mean_coded();
            (metalness, roughness) = (metalness * blue, roughness * green);
        }
        let [r, g, b, alpha] = material.factor.map(|c| unit(c as f32, 1.0));
        let texture = match painted.filter(|painted| painted.alpha != Alpha::Ignored) {
            Some(painted) => self.texture(painted.texture, painted.alpha, model, buffers, sink)?,
            None => None,
        };
        let opacity = match (material.alpha, texture) {
            (AlphaMode::Opaque, _) => 1.0,
            (AlphaMode::Mask(_), Some(texture)) => texture.opacity(),
            (AlphaMode::Mask(cutoff), None) => f32::from(alpha >= cutoff as f32),
            (AlphaMode::Blend, texture) => alpha * texture.map_or(1.0, |t| t.opacity()),
        };
        let (metalness, roughness) = (unit(metalness, 0.0), unit(roughness, 1.0));
        Ok(MaterialDesc { colour: [r, g, b], opacity, metalness, roughness })
    }

    /// Returns the decoded texture `index`. If there is none, adds a note and returns `None`.
    pub(crate) fn texture(
        &mut self,
        index: usize,
        alpha: Alpha,
        model: &Model,
        buffers: &mut Buffers<'_>,
        sink: &mut dyn Sink,
    ) -> Parsed<Option<Rc<Texture>>> {
        let image = model.textures.get(index).map(|texture| texture.image);
        // Textures without an image share an entry of the cache.
        let key = image.as_ref().ok().copied().flatten().unwrap_or(usize::MAX);
        if let Some(at) = self.images.iter().position(|known| (known.image, known.alpha) == (key, alpha)) {
            let entry = self.images.remove(at);
            let texture = entry.texture.clone();
            self.images.push(entry);
            return Ok(texture);
        }
        let bytes = image.and_then(|image| image_bytes(image, model, buffers));
        let texture = match bytes.and_then(|bytes| Ok(Texture::decode(&bytes, alpha)?)) {
            Ok(texture) => Some(Rc::new(texture)),
            Err(Fault::Failed(Error::Cancelled)) => return Err(Error::Cancelled.into()),
            Err(fault) => {
                if self.noted.insert(key) {
                    let why = fault.at(buffers.path(), Place::File);
                    sink.note(format!("{why} (textures[{index}]); its materials have only their base colour"));
                }
                None
            }
        };
        if self.images.len() >= KEPT {
            self.images.remove(0);
        }
        self.images.push(Decoded { image: key, alpha, texture: texture.clone() });
        Ok(texture)
    }
}

const TRANSPARENT_TEXTURES: &str =
    "materials with transparent textures have one opacity; holes in the textures are not cut out";

fn painted(info: &TextureInfo, material: &Material, model: &Model) -> Painted {
    let sampler = model.textures.find(info.texture).and_then(|texture| texture.sampler);
    let wrap = sampler.and_then(|index| model.samplers.find(index)).copied();
    let alpha = match material.alpha {
        AlphaMode::Opaque => Alpha::Ignored,
        // The product of the texture's alpha and the factor's is compared with the cutoff.
        AlphaMode::Mask(cutoff) if cutoff <= 0.0 => Alpha::Ignored,
        AlphaMode::Mask(cutoff) => Alpha::Cut((cutoff / material.factor[3].max(0.0)) as f32),
        AlphaMode::Blend => Alpha::Opacity,
    };
    let mapping = Mapping {
        offset: info.offset,
        rotation: info.rotation,
        scale: info.scale,
        wrap: wrap.unwrap_or([Wrap::Repeat; 2]),
    };
    Painted { texture: info.texture, alpha, set: info.set, mapping }
}

fn image_bytes(image: Option<usize>, model: &Model, buffers: &mut Buffers<'_>) -> Parsed<Vec<u8>> {
    let Some(index) = image else {
        return Err("a texture has no picture of a supported type".into());
    };
    let image = model.images.get(index)?;
    match (image.view, &image.uri) {
        (Some(view), _) => {
            let (range, _) = buffers.view(model, view)?;
            let mut bytes = vec![0; range.len() as usize];
            buffers.read(range, &mut bytes)?;
            Ok(bytes)
        }
        (None, Some(uri)) => buffers.uri(uri),
        (None, None) => Err("a picture has neither a buffer view nor a URI".into()),
    }
}
