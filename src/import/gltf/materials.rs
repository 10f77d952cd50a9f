//! Materials, which are declared at first use, and their textures, which are decoded at first use.

use super::buffers::Buffers;
use super::texture::{Mapping, Texture};
use crate::import::colour::unit;
use crate::import::input::Parsed;
use crate::import::{MaterialDesc, MaterialKey, Sink};
use ::gltf::json::Root;
use ::gltf::json::material::{AlphaMode, Material};
use ::gltf::json::texture::Info;
use ::gltf::json::validation::Checked;
use std::collections::HashMap;
use std::rc::Rc;

/// Number of decoded textures that are kept, with up to 40 MB each.
const KEPT: usize = 8;

/// A declared material.
#[derive(Clone)]
pub(crate) struct Looks {
    pub(crate) key: MaterialKey,
    /// Linear base colour.
    pub(crate) colour: [f32; 3],
    /// Index of the texture and the mapping of its coordinates.
    pub(crate) texture: Option<(usize, Mapping)>,
}

/// The document's materials and textures that were used so far.
#[derive(Default)]
pub(crate) struct Materials {
    known: HashMap<usize, Looks>,
    /// Cache by image index, most recently used last. `None` for images that failed to decode.
    images: Vec<(usize, Option<Rc<Texture>>)>,
    /// Images with a note.
    noted: HashMap<usize, ()>,
}

impl Materials {
    /// Returns material `index`, and declares it at first use.
    pub(crate) fn get(
        &mut self,
        index: usize,
        root: &Root,
        buffers: &mut Buffers<'_>,
        sink: &mut dyn Sink,
    ) -> Parsed<Looks> {
        if let Some(looks) = self.known.get(&index) {
            return Ok(looks.clone());
        }
        let Some(material) = root.materials.get(index) else {
            return Err(format!("materials[{index}] does not exist (there are {})", root.materials.len()).into());
        };
        let (desc, texture) = self.describe(material, root, buffers, sink)?;
        let texture = texture.map(|info| (info.index.value(), Mapping::of(info, root)));
        let looks = Looks { key: sink.material(desc)?, colour: desc.colour, texture };
        self.known.insert(index, looks.clone());
        Ok(looks)
    }

    fn describe<'r>(
        &mut self,
        material: &'r Material,
        root: &'r Root,
        buffers: &mut Buffers<'_>,
        sink: &mut dyn Sink,
    ) -> Parsed<(MaterialDesc, Option<&'r Info>)> {
        let metal_rough = &material.pbr_metallic_roughness;
        let older = material.extensions.as_ref().and_then(|e| e.pbr_specular_glossiness.as_ref());
        let (factor, texture, metalness, roughness) = match older {
            Some(g) => (g.diffuse_factor.0, &g.diffuse_texture, 0.0, 1.0 - g.glossiness_factor.0),
            None => {
                let mut values = [metal_rough.metallic_factor.0, metal_rough.roughness_factor.0];
                if let Some(info) = &metal_rough.metallic_roughness_texture
                    && let Some(texture) = self.texture(info.index.value(), root, buffers, sink)?
                {
                    // Roughness is in the green channel, metalness in blue; neither is sRGB-coded.
                    let [_, green, blue] = texture.mean_coded();
                    values = [values[0] * blue, values[1] * green];
                }
                (metal_rough.base_color_factor.0, &metal_rough.base_color_texture, values[0], values[1])
            }
        };
        let [r, g, b, alpha] = factor;
        let opacity = match material.alpha_mode {
            Checked::Valid(AlphaMode::Blend) => unit(alpha, 1.0),
            Checked::Valid(AlphaMode::Mask) => f32::from(alpha >= material.alpha_cutoff.unwrap_or_default().0),
            _ => 1.0,
        };
        let desc = MaterialDesc {
            colour: [r, g, b].map(|c| unit(c, 1.0)),
            opacity,
            metalness: unit(metalness, 0.0),
            roughness: unit(roughness, 1.0),
        };
        Ok((desc, texture.as_ref()))
    }

    /// Returns the decoded texture `index`. If the image cannot be decoded, adds a note and returns `None`.
    pub(crate) fn texture(
        &mut self,
        index: usize,
        root: &Root,
        buffers: &mut Buffers<'_>,
        sink: &mut dyn Sink,
    ) -> Parsed<Option<Rc<Texture>>> {
        let Some(texture) = root.textures.get(index) else {
            return Err(format!("textures[{index}] does not exist (there are {})", root.textures.len()).into());
        };
        let image = texture.source.value();
        if let Some(at) = self.images.iter().position(|(i, _)| *i == image) {
            let entry = self.images.remove(at);
            let decoded = entry.1.clone();
            self.images.push(entry);
            return Ok(decoded);
        }
        let decoded = match image_bytes(image, root, buffers).and_then(|bytes| Ok(Texture::decode(&bytes)?)) {
            Ok(texture) => Some(Rc::new(texture)),
            Err(fault) => {
                if self.noted.insert(image, ()).is_none() {
                    let why = fault.at(buffers.path(), crate::base::error::Place::File);
                    sink.note(format!("{why} (images[{image}]); its materials have only their base colour"));
                }
                None
            }
        };
        if self.images.len() >= KEPT {
            self.images.remove(0);
        }
        self.images.push((image, decoded.clone()));
        Ok(decoded)
    }
}

fn image_bytes(index: usize, root: &Root, buffers: &mut Buffers<'_>) -> Parsed<Vec<u8>> {
    let Some(image) = root.images.get(index) else {
        return Err("a texture has no picture of a supported type".into());
    };
    match (image.buffer_view, &image.uri) {
        (Some(view), _) => {
            let (range, _) = buffers.view(root, view.value())?;
            let mut bytes = vec![0; range.len() as usize];
            buffers.read(range, &mut bytes)?;
            Ok(bytes)
        }
        (None, Some(uri)) => buffers.uri(uri),
        (None, None) => Err("a picture has neither a buffer view nor a URI".into()),
    }
}
