//! Inputs to begin with: small files of each kind that the readers know, and bytes for the targets that make their
//! cases of any.

use super::files;
use super::rng::Rng;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// Strings of `len` random bytes, of several lengths up to it.
pub fn noise(len: usize) -> Vec<Vec<u8>> {
    let mut rng = Rng::new(len as u64);
    (1..=24).map(|i| (0..len * i / 24).map(|_| rng.bits() as u8).collect()).collect()
}

/// PLY in each coding, with lists of several types, colours, and elements that no reader knows.
pub fn ply() -> Vec<Vec<u8>> {
    let header = |coding: &str, vertices: u32, faces: u32, more: &str| {
        format!(
            "ply\nformat {coding} 1.0\ncomment made for tests\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
             property float z\n{more}element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let colours = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let mut all = vec![
        (header("ascii", 4, 2, "") + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n4 0 1 2 3\n").into_bytes(),
        (header("ascii", 3, 1, colours) + "0 0 0 255 0 0\n1e3 0 0 0 255 0\n0 -1.5 nan 0 0 255\n3 0 1 2\n").into_bytes(),
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
          property list uint8 float32 extra\nelement face 1\nproperty list uint16 uint32 vertex_index\n\
          property int quality\nelement edge 1\nproperty int a\nproperty int b\nend_header\n\
          0 0 0 0\n1 0 0 2 1 2\n0 1 0 1 7\n3 0 1 2 5\n0 1\n"
            .to_vec(),
        b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
          element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n4 0 1 2 3\n"
            .to_vec(),
    ];
    for (coding, bytes) in [
        ("binary_little_endian", [f32::to_le_bytes as fn(f32) -> [u8; 4], |x| (x as i32).to_le_bytes()]),
        ("binary_big_endian", [f32::to_be_bytes, |x| (x as i32).to_be_bytes()]),
    ] {
        let mut file = header(coding, 4, 2, "").into_bytes();
        for number in [0.0, 0.0, 0.0, 1.0, 0.0, 0.5, 1.0, 1.0, 0.0, 0.0, 1.0, 0.25] {
            file.extend(bytes[0](number));
        }
        for face in [[0.0, 1.0, 2.0], [2.0, 3.0, 0.0]] {
            file.push(3);
            file.extend(face.into_iter().flat_map(bytes[1]));
        }
        all.push(file);
    }
    all
}

/// OBJ with groups, negative indices, materials, a texture.
pub fn obj() -> Vec<Vec<u8>> {
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
    let material = "newmtl red\nKd 1 0 0\nKs 0.5 0.5 0.5\nNs 20\nd 0.5\nillum 2\nnewmtl pic\nKd 1 1 1\n\
                    map_Kd -s 2 2 1 -o 0.5 0 0 a.png\nTr 0.25\nPm 1\nPr 0.3\n";
    let textured = format!(
        "mtllib a.mtl b.mtl\n{square}vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\no one\nusemtl red\nf 1 2 3\ng two three\n\
         usemtl pic\nf 1/1/1 2/2/1 3/3/1 4/1/1\nf -4//-1 -3//-1 -2//-1\n"
    );
    vec![
        format!("{square}f 1 2 3 4\n").into_bytes(),
        format!("# text\n{square}l 1 2\np 1\ns off\nf 1 2 \\\n3\nv 5 5 5 1 0 0\nf 1 2 5\n").into_bytes(),
        files::join(&[textured.as_bytes(), material.as_bytes(), b"newmtl other\nKd 0 1 0\n", &png(3, 2)]),
        files::join(&[b"mtllib a.mtl\r\nv 0 0 0\r\nv 1e9 0 0\r\nv 0 1 0\r\nf 1 2 3\r\n", b"newmtl \xff\nmap_Kd a.png"]),
    ]
}

/// STL, text and binary.
pub fn stl() -> Vec<Vec<u8>> {
    let text = "solid name\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 0 1e-3 0\n\
                \x20 endloop\n endfacet\nendsolid name\n";
    let binary = |triangles: u32, attribute: u16| {
        let mut out = vec![b' '; 80];
        out.extend(triangles.to_le_bytes());
        for i in 0..triangles {
            let numbers = [0.0, 0.0, 1.0, 0.0, 0.0, i as f32, 1.0, 0.0, 0.0, 0.0, 1.0, f32::from_bits(0x7f80_0000 - i)];
            out.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
            out.extend(attribute.to_le_bytes());
        }
        out
    };
    vec![text.into(), text.repeat(2).to_uppercase().into(), binary(1, 0), binary(4, 0x8000 | 31), binary(0, 0)]
}

/// The raw soup in its four layouts.
pub fn raw() -> Vec<Vec<u8>> {
    let soup = |flags: u32| {
        let mut out = b"OCSOUP\r\n\x01\0\0\0".to_vec();
        out.extend(flags.to_le_bytes());
        out.extend(3u64.to_le_bytes());
        out.extend([0; 8]);
        for triangle in 0..3 {
            for i in 0..9 {
                let x = f64::from(i * i % 7 + triangle);
                if flags & 1 == 1 { out.extend(x.to_le_bytes()) } else { out.extend((x as f32).to_le_bytes()) }
            }
            if flags & 2 == 2 {
                out.extend((triangle as u32 / 2 * 77).to_le_bytes());
            }
        }
        out
    };
    (0..4).map(soup).collect()
}

/// Floats of a triangle: positions, normals, texture coordinates; then indices, a matrix, colours.
fn gltf_buffer() -> Vec<u8> {
    let floats = [
        0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0,
        0.0, 0.0, 1.0,
    ];
    let mut out: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    out.extend([0u8, 0, 1, 0, 2, 0, 0, 0, 255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255]);
    out
}

/// A document over [`gltf_buffer`], which has most of what the reader knows.
fn document(buffer: &str, image: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,2]}}],
"extensionsUsed":["KHR_texture_transform","EXT_mesh_gpu_instancing","KHR_materials_unlit"],
"nodes":[{{"mesh":0,"children":[1],"rotation":[0,0,0.7071068,0.7071068],"name":"a"}},
{{"mesh":1,"scale":[1,-2,1],"translation":[1,2,3]}},
{{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,5,0,0,1],"extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":{{"TRANSLATION":0}}}}}}}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2}},"indices":3,"material":0}}]}},
{{"name":"m","primitives":[{{"attributes":{{"POSITION":0,"COLOR_0":4}},"mode":5}},{{"attributes":{{"POSITION":5}},"mode":4}}]}}],
"materials":[{{"alphaMode":"MASK","alphaCutoff":0.5,"pbrMetallicRoughness":{{"baseColorFactor":[1,0.5,1,0.5],"metallicFactor":0.1,
"baseColorTexture":{{"index":0,"extensions":{{"KHR_texture_transform":{{"offset":[0.5,0],"scale":[2,2],"rotation":1}}}}}}}}}}],
"textures":[{{"source":0,"sampler":0}}],"samplers":[{{"wrapS":33071,"wrapT":33648}}],"images":[{image}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
{{"bufferView":0,"byteOffset":36,"componentType":5126,"count":3,"type":"VEC3"}},
{{"bufferView":0,"byteOffset":72,"componentType":5126,"count":3,"type":"VEC2"}},
{{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}},
{{"bufferView":1,"byteOffset":8,"componentType":5121,"normalized":true,"count":3,"type":"VEC4"}},
{{"componentType":5126,"count":3,"type":"VEC3","sparse":{{"count":2,"indices":{{"bufferView":1,"componentType":5123}},
"values":{{"bufferView":0}}}}}}],
"bufferViews":[{{"buffer":0,"byteLength":96}},{{"buffer":0,"byteOffset":96,"byteLength":20}}],
"buffers":[{{{buffer}"byteLength":116}}]}}"#
    )
}

/// Joins the chunks of a GLB.
fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + json.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

/// glTF with its buffer in itself or in a file, and GLB.
pub fn gltf() -> Vec<Vec<u8>> {
    let (buffer, picture) = (gltf_buffer(), png(2, 2));
    let uri = |kind: &str, bytes: &[u8]| format!("\"uri\":\"data:{kind};base64,{}\"", STANDARD.encode(bytes));
    let inside =
        document(&(uri("application/octet-stream", &buffer) + ","), &format!("{{{}}}", uri("image/png", &picture)));
    let beside = document("\"uri\":\"a.bin\",", "{\"uri\":\"./a%2Epng\"}");
    vec![
        inside.into_bytes(),
        files::join(&[beside.as_bytes(), &buffer, &picture]),
        glb(&document("", "{\"uri\":\"none.png\"}"), &buffer),
        br#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[]}]}"#.to_vec(),
    ]
}

/// A GLB of one triangle with this picture as its texture.
pub fn textured(picture: &[u8]) -> Vec<u8> {
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":0}}]}}],
"materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],"textures":[{{"source":0}}],
"images":[{{"bufferView":1,"mimeType":"image/png"}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
{{"bufferView":0,"byteOffset":72,"componentType":5126,"count":3,"type":"VEC2"}}],
"bufferViews":[{{"buffer":0,"byteLength":116}},{{"buffer":0,"byteOffset":116,"byteLength":{}}}],
"buffers":[{{"byteLength":{}}}]}}"#,
        picture.len(),
        116 + picture.len()
    );
    glb(&json, &[&gltf_buffer(), picture].concat())
}

fn coded(format: image::ImageFormat, colour: image::ExtendedColorType, width: u32, height: u32) -> Vec<u8> {
    let bytes = usize::from(colour.bits_per_pixel()) / 8;
    let pixels: Vec<u8> = (0..width as usize * height as usize * bytes).map(|i| (i * 37 % 251) as u8).collect();
    let mut out = std::io::Cursor::new(Vec::new());
    image::write_buffer_with_format(&mut out, &pixels, width, height, colour, format).expect("a picture");
    out.into_inner()
}

fn png(width: u32, height: u32) -> Vec<u8> {
    coded(image::ImageFormat::Png, image::ExtendedColorType::Rgba8, width, height)
}

/// PNG of several depths, and JPEG.
pub fn images() -> Vec<Vec<u8>> {
    use image::ExtendedColorType::{L8, La8, Rgb8, Rgba8, Rgba16};
    use image::ImageFormat::{Jpeg, Png};
    let mut all: Vec<Vec<u8>> = [L8, La8, Rgb8, Rgba8, Rgba16].map(|colour| coded(Png, colour, 5, 3)).into();
    all.extend([L8, Rgb8].map(|colour| coded(Jpeg, colour, 17, 9)));
    all.push(b"GIF89a\x01\0\x01\0\0\0\0;".to_vec());
    all
}
