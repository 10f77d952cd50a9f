//! Materials, which are declared at first use, and their textures, which are decoded at first use.
//!
//! An error in a material or texture cannot make the geometry wrong. It is therefore noted, and the material has its
//! default or its base colour.

use super::buffers::Buffers;
use super::model::{AlphaMode, Image, Material, Model, TextureInfo};
use super::notes::Notes;
use super::texture::{Alpha, Mapping, Texture, Wrap};
use crate::base::error::Place;
use crate::base::progress::Cancel;
use crate::import::colour::unit;
use crate::import::input::{Fault, Parsed};
use crate::import::pictures::{Encoded, PictureId, Pictures};
use crate::import::{MaterialDesc, MaterialKey, ReadOptions, Sink};
use std::collections::HashMap;
use std::rc::Rc;
use xxhash_rust::xxh3::xxh3_128;

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

/// The source of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Source {
    /// Buffer, offset and length.
    Range(usize, u64, u64),
    /// Hash of the URI.
    Uri(u128),
}

/// The document's materials and textures that were used so far.
pub(crate) struct Materials {
    known: HashMap<usize, Looks>,
    pictures: Pictures,
    /// The picture of each image that was used; `None` if it cannot be decoded.
    images: HashMap<usize, Option<PictureId>>,
    /// The picture of each source: several images may have the same.
    sources: HashMap<Source, Option<PictureId>>,
}

impl Materials {
    /// No materials yet.
    pub(crate) fn new(options: &ReadOptions) -> Self {
        let (images, sources) = (HashMap::new(), HashMap::new());
        Self { known: HashMap::new(), pictures: Pictures::new(options, false), images, sources }
    }

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
        // Textures without an image share an entry.
        let key = image.as_ref().ok().copied().flatten().unwrap_or(usize::MAX);
        if !self.images.contains_key(&key) {
            let picture = match image.and_then(|image| self.picture(image, model, buffers, sink.cancel())) {
                Ok(picture) => picture,
                Err(Fault::Failed(error)) if error.ends_work() => return Err(error.into()),
                Err(fault) => {
                    let why = fault.at(buffers.path(), Place::File);
                    sink.note(format!("{why} (textures[{index}]); its materials have only their base colour"));
                    None
                }
            };
            self.images.insert(key, picture);
        }
        let picture = self.images.get(&key).copied().flatten();
        Ok(picture.map(|picture| self.pictures.texture(picture, alpha)).transpose()?)
    }

    /// Returns the picture of an image. Returns `None` if another image has the same and it cannot be decoded.
    fn picture(
        &mut self,
        image: Option<usize>,
        model: &Model,
        buffers: &mut Buffers<'_>,
        cancel: &Cancel,
    ) -> Parsed<Option<PictureId>> {
        let Some(index) = image else {
            return Err("a texture has no picture of a supported type".into());
        };
        let image = model.images.get(index)?;
        let source = source(image, model, buffers)?;
        if let Some(known) = self.sources.get(&source) {
            return Ok(*known);
        }
        self.sources.insert(source, None);
        let bytes = image_bytes(image, self.pictures.largest_file(), model, buffers)?;
        let place = match source {
            Source::Range(..) => Encoded::Within(buffers.progress().1),
            Source::Uri(_) => Encoded::File,
        };
        let picture = self.pictures.add(&bytes, place, cancel)?;
        self.sources.insert(source, Some(picture));
        Ok(Some(picture))
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
        AlphaMode::Mask(cutoff) => Alpha::cut((cutoff / material.factor[3].max(0.0)) as f32),
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

fn source(image: &Image, model: &Model, buffers: &mut Buffers<'_>) -> Parsed<Source> {
    match (image.view, &image.uri) {
        (Some(view), _) => {
            let (buffer, offset, len) = buffers.view(model, view)?.0.place();
            Ok(Source::Range(buffer, offset, len))
        }
        (None, Some(uri)) => Ok(Source::Uri(xxh3_128(uri.as_bytes()))),
        (None, None) => Err("a picture has neither a buffer view nor a URI".into()),
    }
}

/// Returns the encoded bytes of an image, if there are at most `most`.
fn image_bytes(image: &Image, most: u64, model: &Model, buffers: &mut Buffers<'_>) -> Parsed<Vec<u8>> {
    match (image.view, &image.uri) {
        (Some(view), _) => {
            let (range, _) = buffers.view(model, view)?;
            if range.len() > most {
                return Err(too_large(range.len(), most).into());
            }
            let mut bytes = vec![0; range.len() as usize];
            buffers.read(range, &mut bytes)?;
            Ok(bytes)
        }
        (None, uri) => buffers.uri(uri.as_deref().unwrap_or_default(), most),
    }
}

/// The reason why a picture file is not read.
pub(super) fn too_large(bytes: u64, most: u64) -> String {
    format!("a picture file of {bytes} bytes is larger than the {most} bytes that the memory budget leaves")
}
