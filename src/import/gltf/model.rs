//! The objects of a document that this crate uses, in a compact form.
//!
//! Objects are read leniently, and one at a time: an error in an object is kept with it and reported at its use, so
//! that an unused one does not matter. Values that cannot make the geometry wrong (names, colours, factors) get their
//! default if they are malformed. Everything else, such as animations, cameras and custom properties, is not read at
//! all.

use super::json::{self, Read};
use super::texture::Wrap;
use crate::import::input::Parsed;
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec2};
use serde_json::Value;

/// All used objects of a document.
pub(crate) struct Model {
    /// Index of the default scene.
    pub(crate) scene: Option<usize>,
    /// Root nodes of each scene.
    pub(crate) scenes: List<Vec<usize>>,
    pub(crate) nodes: List<Node>,
    pub(crate) meshes: List<Mesh>,
    pub(crate) skins: List<Skin>,
    pub(crate) accessors: List<Accessor>,
    pub(crate) views: List<View>,
    pub(crate) buffers: List<Buffer>,
    pub(crate) materials: List<Material>,
    pub(crate) textures: List<Texture>,
    pub(crate) samplers: List<[Wrap; 2]>,
    pub(crate) images: List<Image>,
    /// Animations, which are only counted.
    pub(crate) animations: List<()>,
    pub(crate) extensions_required: Vec<Box<str>>,
    /// The point that all positions are relative to, of `CESIUM_RTC`.
    pub(crate) center: Option<DVec3>,
}

/// The objects of one of the document's lists. A malformed one is kept as the reason.
pub(crate) struct List<T> {
    name: &'static str,
    read: fn(&Value) -> Read<T>,
    items: Vec<Result<T, Box<str>>>,
}

/// A list that is being read.
pub(crate) trait Items {
    /// Its name in the document.
    fn name(&self) -> &'static str;
    /// Removes all objects: if the document has a list twice, the second one counts.
    fn clear(&mut self);
    /// Adds an object.
    fn push(&mut self, value: &Value);
}

impl<T> Items for List<T> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn clear(&mut self) {
        self.items.clear();
    }

    fn push(&mut self, value: &Value) {
        if self.items.len() == self.items.capacity() {
            // Little of the memory of a long list is unused.
            self.items.reserve_exact((self.items.len() / 8).max(8));
        }
        self.items.push((self.read)(value).map_err(String::into_boxed_str));
    }
}

impl<T> List<T> {
    fn new(name: &'static str, read: fn(&Value) -> Read<T>) -> Self {
        Self { name, read, items: Vec::new() }
    }

    pub(crate) fn len(&self) -> usize {
        self.items.len()
    }

    /// Returns object `index`, or an error that names it.
    pub(crate) fn get(&self, index: usize) -> Parsed<&T> {
        let Self { name, items, .. } = self;
        match items.get(index) {
            Some(Ok(item)) => Ok(item),
            Some(Err(why)) => Err(format!("{name}[{index}]: {why}").into()),
            None => Err(format!("{name}[{index}] does not exist (there are {})", items.len()).into()),
        }
    }

    /// Returns object `index` if it exists and is well formed.
    pub(crate) fn find(&self, index: usize) -> Option<&T> {
        self.items.get(index)?.as_ref().ok()
    }

    /// Returns the well-formed objects with their index.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, &T)> {
        self.items.iter().enumerate().filter_map(|(i, item)| Some((i, item.as_ref().ok()?)))
    }
}

pub(crate) struct Node {
    pub(crate) name: Option<Box<str>>,
    pub(crate) children: Vec<usize>,
    pub(crate) mesh: Option<usize>,
    pub(crate) skin: Option<usize>,
    /// Transform to the parent, or the reason why there is none.
    pub(crate) local: Result<DAffine3, Box<str>>,
    /// Weights of the mesh's morph targets.
    pub(crate) weights: Option<Box<[f64]>>,
    /// Accessors of `EXT_mesh_gpu_instancing`, by name of the attribute, or the reason why there are none. Without
    /// attributes the mesh is placed once.
    pub(crate) instancing: Result<Attributes, Box<str>>,
    /// True if the mesh or the skin is -1, which some programs write for none.
    pub(crate) has_negative: bool,
    /// False for nodes that `KHR_node_visibility` hides, with all below them.
    pub(crate) is_visible: bool,
}

/// Names and accessors of attributes.
pub(crate) type Attributes = Box<[(Box<str>, usize)]>;

pub(crate) struct Mesh {
    pub(crate) name: Option<Box<str>>,
    /// Primitives, or the reason why one is malformed.
    pub(crate) primitives: Vec<Result<Primitive, Box<str>>>,
    /// Default weights of the morph targets.
    pub(crate) weights: Box<[f64]>,
}

pub(crate) struct Primitive {
    /// Accessors by name of the attribute. An attribute that is not an index is missing.
    attributes: Attributes,
    pub(crate) indices: Option<usize>,
    pub(crate) material: Option<usize>,
    pub(crate) mode: Mode,
    /// For each morph target, the accessor of the displacements of the positions.
    pub(crate) targets: Vec<Option<usize>>,
    /// True if the primitive also has compressed data (`KHR_draco_mesh_compression`).
    pub(crate) is_draco: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Points or lines.
    WithoutArea,
    Triangles,
    TriangleStrip,
    TriangleFan,
}

pub(crate) struct Skin {
    pub(crate) joints: Vec<usize>,
    pub(crate) inverse_bind: Option<usize>,
}

pub(crate) struct Accessor {
    pub(crate) view: Option<usize>,
    pub(crate) offset: u64,
    pub(crate) component: Component,
    /// Number of components.
    pub(crate) width: usize,
    pub(crate) count: u64,
    pub(crate) normalized: bool,
    pub(crate) sparse: Option<Box<Sparse>>,
}

pub(crate) struct Sparse {
    pub(crate) count: u64,
    pub(crate) index_type: Component,
    /// Buffer view and byte offset of the indices, and of the values.
    pub(crate) indices: (usize, u64),
    pub(crate) values: (usize, u64),
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

pub(crate) struct View {
    pub(crate) buffer: usize,
    pub(crate) offset: u64,
    pub(crate) len: u64,
    pub(crate) stride: Option<u64>,
    /// Name of the extension with which the view is also stored compressed.
    pub(crate) compressed: Option<&'static str>,
}

pub(crate) struct Buffer {
    pub(crate) uri: Option<Box<str>>,
    /// The announced size in bytes.
    pub(crate) len: Option<u64>,
}

pub(crate) struct Material {
    pub(crate) name: Option<Box<str>>,
    /// Linear base colour and alpha.
    pub(crate) factor: [f64; 4],
    pub(crate) texture: Option<TextureInfo>,
    pub(crate) metalness: f64,
    pub(crate) roughness: f64,
    /// Texture of metalness and roughness.
    pub(crate) metal_rough: Option<usize>,
    pub(crate) alpha: AlphaMode,
}

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum AlphaMode {
    Opaque,
    /// Parts with an alpha below the cutoff are invisible.
    Mask(f64),
    Blend,
}

/// Use of a texture by a material, with `KHR_texture_transform`.
pub(crate) struct TextureInfo {
    pub(crate) texture: usize,
    /// Set of texture coordinates.
    pub(crate) set: u64,
    pub(crate) offset: Vec2,
    pub(crate) rotation: f32,
    pub(crate) scale: Vec2,
}

pub(crate) struct Texture {
    pub(crate) sampler: Option<usize>,
    pub(crate) image: Option<usize>,
}

pub(crate) struct Image {
    pub(crate) view: Option<usize>,
    pub(crate) uri: Option<Box<str>>,
}

impl Model {
    /// A model of a document without objects.
    pub(crate) fn new() -> Self {
        Self {
            scene: None,
            scenes: List::new("scenes", |v| json::indices(v, "nodes")),
            nodes: List::new("nodes", node),
            meshes: List::new("meshes", |v| Ok(mesh(v))),
            skins: List::new("skins", skin),
            accessors: List::new("accessors", accessor),
            views: List::new("bufferViews", view),
            buffers: List::new("buffers", buffer),
            materials: List::new("materials", |v| Ok(material(v))),
            textures: List::new("textures", |v| Ok(texture(v))),
            samplers: List::new("samplers", |v| Ok([wrap(v, "wrapS"), wrap(v, "wrapT")])),
            images: List::new("images", image),
            animations: List::new("animations", |_| Ok(())),
            extensions_required: Vec::new(),
            center: None,
        }
    }

    /// Returns the list with this name in the document, if it is used.
    pub(crate) fn list(&mut self, name: &str) -> Option<&mut dyn Items> {
        let lists: [&mut dyn Items; 12] = [
            &mut self.scenes,
            &mut self.nodes,
            &mut self.meshes,
            &mut self.skins,
            &mut self.accessors,
            &mut self.views,
            &mut self.buffers,
            &mut self.materials,
            &mut self.textures,
            &mut self.samplers,
            &mut self.images,
            &mut self.animations,
        ];
        lists.into_iter().find(|list| list.name() == name)
    }

    /// Reads the members of the document that are no lists of objects.
    pub(crate) fn read_rest(&mut self, root: &Value) {
        let texts = json::items(root, "extensionsRequired").iter().filter_map(Value::as_str);
        self.extensions_required = texts.map(Box::from).collect();
        self.scene = json::index(root, "scene").unwrap_or(None);
        let center =
            json::extension(root, "CESIUM_RTC").and_then(|rtc| json::numbers::<3>(rtc, "center").ok().flatten());
        self.center = center.map(DVec3::from);
    }
}

impl Model {
    /// The transform of root nodes to the world.
    pub(crate) fn world(&self) -> DAffine3 {
        DAffine3::from_translation(self.center.unwrap_or(DVec3::ZERO))
    }
}

impl Primitive {
    /// Returns the accessor of an attribute.
    pub(crate) fn attribute(&self, name: &str) -> Option<usize> {
        self.attributes.iter().find(|(known, _)| **known == *name).map(|(_, index)| *index)
    }

    /// True if the primitive draws triangles.
    pub(crate) fn has_area(&self) -> bool {
        self.mode != Mode::WithoutArea && self.attribute("POSITION").is_some()
    }
}

impl Component {
    fn of(object: &Value) -> Read<Self> {
        match json::required(object, "componentType")? {
            5120 => Ok(Self::I8),
            5121 => Ok(Self::U8),
            5122 => Ok(Self::I16),
            5123 => Ok(Self::U16),
            5125 => Ok(Self::U32),
            5126 => Ok(Self::F32),
            other => Err(format!("has an unknown type of components, {other}")),
        }
    }

    /// Name in the plural, for messages.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::I8 => "signed bytes",
            Self::U8 => "unsigned bytes",
            Self::I16 => "signed 16-bit integers",
            Self::U16 => "unsigned 16-bit integers",
            Self::U32 => "unsigned 32-bit integers",
            Self::F32 => "floats",
        }
    }

    /// Size in bytes.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

fn node(value: &Value) -> Read<Node> {
    let visibility = json::extension(value, "KHR_node_visibility");
    Ok(Node {
        name: json::text(value, "name"),
        children: json::indices(value, "children")?,
        mesh: json::index_or_none(value, "mesh")?,
        skin: json::index_or_none(value, "skin")?,
        has_negative: json::is_none(value, "mesh") || json::is_none(value, "skin"),
        local: local_transform(value).map_err(String::into_boxed_str),
        weights: weights(value).filter(|w| !w.is_empty()),
        instancing: instancing(value).map_err(String::into_boxed_str),
        is_visible: visibility.and_then(|v| v.get("visible")).and_then(Value::as_bool).unwrap_or(true),
    })
}

fn instancing(node: &Value) -> Read<Attributes> {
    const NAME: &str = "EXT_mesh_gpu_instancing";
    let Some(extension) = json::extension(node, NAME) else { return Ok(Box::default()) };
    if !extension.is_object() {
        return Err(format!("{NAME} is {}, not an object", json::shown(extension)));
    }
    let Some(attributes) = json::member(extension, "attributes") else { return Ok(Box::default()) };
    let Some(all) = attributes.as_object() else {
        return Err(format!("{NAME}: \"attributes\" is {}, not an object", json::shown(attributes)));
    };
    let read =
        |name: &String| Some(json::index(attributes, name).transpose()?.map(|index| (name.as_str().into(), index)));
    all.keys().filter_map(read).collect::<Read<_>>().map_err(|why| format!("{NAME}: {why}"))
}

fn weights(value: &Value) -> Option<Box<[f64]>> {
    let list = json::member(value, "weights")?.as_array()?;
    Some(list.iter().map(|w| w.as_f64().unwrap_or(0.0)).collect())
}

fn local_transform(node: &Value) -> Read<DAffine3> {
    if let Some(m) = json::numbers::<16>(node, "matrix")? {
        let column = |i: usize| DVec3::new(m[4 * i], m[4 * i + 1], m[4 * i + 2]);
        return Ok(DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(1), column(2)), column(3)));
    }
    let vector = |name, or| Ok::<_, String>(json::numbers::<3>(node, name)?.map_or(DVec3::splat(or), DVec3::from));
    let rotation = unit_quaternion(json::numbers::<4>(node, "rotation")?.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    Ok(DAffine3::from_scale_rotation_translation(vector("scale", 1.0)?, rotation, vector("translation", 0.0)?))
}

/// Returns the rotation of a quaternion, which is only approximately of length 1 if it was written in single precision.
pub(crate) fn unit_quaternion(xyzw: [f64; 4]) -> DQuat {
    let quaternion = DQuat::from_array(xyzw);
    let length = quaternion.length();
    if length > 0.0 { quaternion / length } else { DQuat::IDENTITY }
}

fn mesh(value: &Value) -> Mesh {
    let primitives = json::items(value, "primitives");
    Mesh {
        name: json::text(value, "name"),
        primitives: primitives.iter().map(|p| primitive(p).map_err(String::into_boxed_str)).collect(),
        weights: weights(value).unwrap_or_default(),
    }
}

fn primitive(value: &Value) -> Read<Primitive> {
    let target = |target: &Value| json::index(target, "POSITION");
    Ok(Primitive {
        attributes: attributes(value),
        indices: json::index(value, "indices")?,
        material: json::index(value, "material").unwrap_or(None),
        mode: match json::integer(value, "mode")?.unwrap_or(4) {
            0..=3 => Mode::WithoutArea,
            4 => Mode::Triangles,
            5 => Mode::TriangleStrip,
            6 => Mode::TriangleFan,
            other => return Err(format!("has an unknown mode, {other}")),
        },
        targets: json::items(value, "targets").iter().map(target).collect::<Read<_>>()?,
        is_draco: json::extension(value, "KHR_draco_mesh_compression").is_some(),
    })
}

/// Returns the attributes of a primitive.
fn attributes(value: &Value) -> Attributes {
    let all = value.get("attributes").and_then(Value::as_object).into_iter().flatten();
    all.filter_map(|(name, index)| Some((name.as_str().into(), usize::try_from(json::whole(index)?).ok()?))).collect()
}

fn skin(value: &Value) -> Read<Skin> {
    let inverse_bind = json::index(value, "inverseBindMatrices")?;
    Ok(Skin { joints: json::indices(value, "joints")?, inverse_bind })
}

fn accessor(value: &Value) -> Read<Accessor> {
    let width = match value.get("type").and_then(Value::as_str) {
        Some("SCALAR") => 1,
        Some("VEC2") => 2,
        Some("VEC3") => 3,
        Some("VEC4" | "MAT2") => 4,
        Some("MAT3") => 9,
        Some("MAT4") => 16,
        _ => return Err("has an unknown type".into()),
    };
    Ok(Accessor {
        view: json::index(value, "bufferView")?,
        offset: json::integer(value, "byteOffset")?.unwrap_or(0),
        component: Component::of(value)?,
        width,
        count: json::required(value, "count")?,
        normalized: value.get("normalized").and_then(Value::as_bool).unwrap_or(false),
        sparse: json::member(value, "sparse").map(sparse).transpose().map_err(|why| format!("sparse: {why}"))?,
    })
}

fn sparse(value: &Value) -> Read<Box<Sparse>> {
    let (indices, values) = (&value["indices"], &value["values"]);
    let place = |value: &Value| {
        let view = json::index(value, "bufferView")?.ok_or("has no \"bufferView\"")?;
        Ok::<_, String>((view, json::integer(value, "byteOffset")?.unwrap_or(0)))
    };
    Ok(Box::new(Sparse {
        count: json::required(value, "count")?,
        index_type: Component::of(indices)?,
        indices: place(indices)?,
        values: place(values)?,
    }))
}

fn view(value: &Value) -> Read<View> {
    const COMPRESSIONS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
    Ok(View {
        buffer: json::index(value, "buffer")?.ok_or("has no \"buffer\"")?,
        offset: json::integer(value, "byteOffset")?.unwrap_or(0),
        len: json::required(value, "byteLength")?,
        stride: json::integer(value, "byteStride")?,
        compressed: COMPRESSIONS.into_iter().find(|name| json::extension(value, name).is_some()),
    })
}

fn buffer(value: &Value) -> Read<Buffer> {
    Ok(Buffer { uri: json::text(value, "uri"), len: json::integer(value, "byteLength").unwrap_or(None) })
}

fn material(value: &Value) -> Material {
    let nothing = Value::Null;
    let metal_rough = value.get("pbrMetallicRoughness").unwrap_or(&nothing);
    let older = json::extension(value, "KHR_materials_pbrSpecularGlossiness");
    let base = |object, factor, texture| {
        let factor = json::numbers::<4>(object, factor).ok().flatten().unwrap_or([1.0; 4]);
        (factor, json::member(object, texture).and_then(texture_info))
    };
    let (factor, texture) = match older {
        Some(older) => base(older, "diffuseFactor", "diffuseTexture"),
        None => base(metal_rough, "baseColorFactor", "baseColorTexture"),
    };
    Material {
        name: json::text(value, "name"),
        factor,
        texture,
        metalness: older.map_or_else(|| json::number(metal_rough, "metallicFactor", 1.0), |_| 0.0),
        roughness: match older {
            Some(older) => 1.0 - json::number(older, "glossinessFactor", 1.0),
            None => json::number(metal_rough, "roughnessFactor", 1.0),
        },
        metal_rough: match older {
            Some(_) => None,
            None => json::member(metal_rough, "metallicRoughnessTexture").and_then(texture_info).map(|i| i.texture),
        },
        alpha: match value.get("alphaMode").and_then(Value::as_str) {
            Some("MASK") => AlphaMode::Mask(json::number(value, "alphaCutoff", 0.5)),
            Some("BLEND") => AlphaMode::Blend,
            _ => AlphaMode::Opaque,
        },
    }
}

fn texture_info(value: &Value) -> Option<TextureInfo> {
    let nothing = Value::Null;
    let transform = json::extension(value, "KHR_texture_transform").unwrap_or(&nothing);
    let set = |object| json::integer(object, "texCoord").ok().flatten();
    let pair = |key, or| {
        json::numbers::<2>(transform, key).ok().flatten().map_or(Vec2::splat(or), |xy| Vec2::from(xy.map(|x| x as f32)))
    };
    Some(TextureInfo {
        texture: json::index(value, "index").ok()??,
        set: set(transform).or(set(value)).unwrap_or(0),
        offset: pair("offset", 0.0),
        rotation: json::number(transform, "rotation", 0.0) as f32,
        scale: pair("scale", 1.0),
    })
}

fn texture(value: &Value) -> Texture {
    let index = |key| json::index(value, key).unwrap_or(None);
    Texture { sampler: index("sampler"), image: index("source") }
}

fn wrap(value: &Value, key: &str) -> Wrap {
    match json::integer(value, key) {
        Ok(Some(33071)) => Wrap::ClampToEdge,
        Ok(Some(33648)) => Wrap::MirroredRepeat,
        _ => Wrap::Repeat,
    }
}

fn image(value: &Value) -> Read<Image> {
    Ok(Image { view: json::index(value, "bufferView")?, uri: json::text(value, "uri") })
}
