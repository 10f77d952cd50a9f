//! Detection of the file format: by the first bytes, and by the file extension only if these are ambiguous.

use super::input::{Input, MARK, Parsed};
use super::surfaces::Kind;
use super::text;
use crate::base::error::{Error, Place, Result};

/// Formats that have a reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    Ply,
    /// GLB, or JSON that may be glTF.
    Gltf,
    Obj,
    Raw,
    StlText,
    StlBinary,
    Surfaces(Kind),
}

/// Number of bytes that are examined.
const HEAD: usize = 64 << 10;

/// First bytes of common files that are not supported, and the description of each for the error message.
const STRANGERS: [(&[u8], &str); 30] = [
    (b"\xff\xfe", "text in UTF-16; save it as UTF-8"),
    (b"\xfe\xff", "text in UTF-16; save it as UTF-8"),
    (b"b3dm", "a 3D Tiles payload (b3dm), not a mesh file; the GLB inside it is one"),
    (b"i3dm", "a 3D Tiles payload (i3dm), not a mesh file"),
    (b"pnts", "a 3D Tiles point cloud (pnts), not a mesh file"),
    (b"cmpt", "a 3D Tiles payload (cmpt), not a mesh file"),
    (b"OFF", "an OFF file, a format that is not supported"),
    (b"COFF", "an OFF file, a format that is not supported"),
    (b"NOFF", "an OFF file, a format that is not supported"),
    (b"STOFF", "an OFF file, a format that is not supported"),
    (b"ISO-10303-21", "a STEP file with exact surfaces, not a mesh"),
    (b"3D Geometry File Format", "a 3DM file with exact surfaces, not a mesh"),
    (b"Kaydara FBX", "an FBX file, a format that is not supported"),
    (b"; FBX", "an FBX file, a format that is not supported"),
    (b"#VRML", "a VRML file, a format that is not supported"),
    (b"#X3D", "an X3D file, a format that is not supported"),
    (b"# vtk", "a VTK file, a format that is not supported"),
    (b"xof ", "a DirectX file, a format that is not supported"),
    (b"<?xml", "an XML file (COLLADA, 3MF, X3D?), a format that is not supported"),
    (b"<", "an XML or HTML file, not a mesh"),
    (b"PK\x03\x04", "a ZIP archive (3MF?), not a mesh"),
    (b"\x1f\x8b", "compressed with gzip; unpack it first"),
    (b"BZh", "compressed with bzip2; unpack it first"),
    (b"\xfd7zXZ", "compressed with xz; unpack it first"),
    (b"\x28\xb5\x2f\xfd", "compressed with zstd; unpack it first"),
    (b"\x89PNG", "a PNG picture, not a mesh"),
    (b"\xff\xd8\xff", "a JPEG picture, not a mesh"),
    (b"%PDF", "a PDF document, not a mesh"),
    (b"\x7fELF", "an executable program, not a mesh"),
    (b"version https://git-lfs", "a Git LFS pointer, not the file itself"),
];

/// Returns the format, or an error that describes the file. Leaves `input` at its beginning.
pub(crate) fn format(input: &mut Input) -> Result<Format> {
    let total = input.total();
    let path = input.path().to_path_buf();
    let ending = path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_ascii_lowercase());
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().to_ascii_lowercase());
    let head = input.peek(HEAD)?;
    if name.ends_with(".trimmed_nurbs.json") {
        return Ok(Format::Surfaces(Kind::TrimmedNurbs));
    }
    tell(head, total, &ending).map_err(|why| Error::parse(&path, Place::File, why))
}

fn tell(head: &[u8], total: u64, ending: &str) -> Parsed<Format, String> {
    if total == 0 {
        return Err("is empty, not a mesh file".into());
    }
    let whole = head;
    let head = text::unpadded(head.strip_prefix(MARK).unwrap_or(head));
    let first = head.split(|&b| b == b'\n' || b == b'\r').next().unwrap_or(b"");
    if first.trim_ascii() == b"ply" {
        return Ok(Format::Ply);
    }
    if head.starts_with(b"glTF") {
        return Ok(Format::Gltf);
    }
    if head.starts_with(&super::raw::MAGIC) {
        return Ok(Format::Raw);
    }
    if is_binary_stl(whole, total) {
        return Ok(Format::StlBinary);
    }
    if let Some(format) = text_format(head, ending)? {
        return Ok(format);
    }
    let start = head.trim_ascii_start();
    if start.starts_with(b"{") || (start.is_empty() && ending == "gltf") {
        return Ok(Format::Gltf);
    }
    if let Some((_, what)) = STRANGERS.iter().find(|(magic, _)| start.starts_with(magic)) {
        return Err(format!("is {what}"));
    }
    match ending {
        "stl" => Ok(Format::StlBinary),
        "obj" if !head.contains(&0) => Ok(Format::Obj),
        "obj" => Err("has the extension .obj, but contains binary data (a compiler's object file?)".into()),
        "ply" => Err("has the extension .ply, but does not begin with \"ply\"".into()),
        "bpt" => Ok(Format::Surfaces(Kind::Bpt)),
        "off" => Err("is an OFF file, a format that is not supported".into()),
        "oc" => Err("is a built model, not a mesh file".into()),
        _ => Err("is not a mesh file of a known format (PLY, OBJ, STL, glTF, GLB, BPT or raw soup)".into()),
    }
}

/// True if the length is 84 bytes plus 50 for each triangle of the header's count. This also holds for binary files
/// that begin with "solid".
fn is_binary_stl(head: &[u8], total: u64) -> bool {
    let count = head.get(80..84).and_then(|b| b.first_chunk()).map(|b| u32::from_le_bytes(*b));
    count.is_some_and(|n| total == 84 + 50 * u64::from(n))
}

/// True if a line that begins with `keyword` begins a solid. `text` is the text from this line on.
fn is_text_stl(keyword: &[u8], text: &[u8], ending: &str) -> bool {
    let is = |word: &[u8], other: &str| word.eq_ignore_ascii_case(other.as_bytes());
    let (mut rest, stl) = (text, ending == "stl");
    let mut words = std::iter::from_fn(|| text::word(&mut rest));
    (is(keyword, "solid") && (stl || words.any(|w| is(w, "facet") || is(w, "endsolid"))))
        || (stl && is(keyword, "facet"))
}

/// True for text STL with zeros between its facets.
fn is_padded_stl(head: &[u8]) -> bool {
    let start = &head[..head.len().min(4096)];
    let mut words = start.split(|b| *b == 0 || b.is_ascii_whitespace()).filter(|word| !word.is_empty());
    let begins = words.next().is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    let has = |word: &[u8]| words.clone().any(|w| w.eq_ignore_ascii_case(word));
    begins && has(b"facet") && has(b"outer") && has(b"vertex")
}

/// Detects text STL, OBJ and material libraries by the first words of lines.
fn text_format(head: &[u8], ending: &str) -> Parsed<Option<Format>, String> {
    if head.iter().take(4096).any(|&b| b == 0) {
        return Ok(is_padded_stl(head).then_some(Format::StlText));
    }
    let mut obj = false;
    let mut at = 0;
    for line in head.split(|&b| b == b'\n' || b == b'\r') {
        let behind = &head[at..];
        at += line.len() + 1;
        let mut rest = line;
        let keyword = text::word(&mut rest).unwrap_or(b"");
        if is_text_stl(keyword, behind, ending) {
            return Ok(Some(Format::StlText));
        }
        let numbers = std::iter::from_fn(|| text::word(&mut rest)).take_while(|w| text::double(w).is_some()).count();
        match keyword {
            b"newmtl" => return Err("is a material library (.mtl), not a mesh".into()),
            b"v" if numbers >= 3 => obj = true,
            b"mtllib" | b"usemtl" => obj = true,
            b"f" | b"vt" | b"vn" | b"g" | b"o" if ending == "obj" => obj = true,
            _ => {}
        }
        if obj {
            return Ok(Some(Format::Obj));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use crate::import::testing::{read_bytes, refused, temporary};
    use crate::import::{ReadOptions, collect::Collector, read_file};

    #[test]
    fn content_takes_precedence_over_the_extension() {
        let stl =
            "solid a\nfacet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet endsolid\n";
        let obj = "# first\n\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty char x\nproperty char y\nproperty char z\n\
                   element face 1\nproperty list char char vertex_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        for bytes in [stl, obj, ply] {
            for name in ["a", "a.ply", "a.obj", "a.stl", "a.glb", "a.txt"] {
                assert_eq!(read_bytes(name, bytes).unwrap_or_else(|e| panic!("{name} {e}")).received, 1, "{name}");
            }
        }
    }

    #[test]
    fn other_files_are_named_in_the_error() {
        for (name, bytes, words) in [
            ("a.ply", &b""[..], "is empty"),
            ("a.obj", b"", "is empty"),
            ("a.gltf", b" \n ", "not valid JSON"),
            ("a.ply", b"plywood\n", "does not begin with \"ply\""),
            ("a.obj", b"\x00\x01\x02", "binary data"),
            ("a.stl", b"\x00\x01\x02", "ends inside the header"),
            ("a.obj", b"newmtl a\nKd 1 1 1\n", "material library"),
            ("a.mtl", b"# colours\nnewmtl a\n", "material library"),
            ("a.off", b"# a comment\nOFF\n", "OFF"),
            ("a.bin", b"OFF\n0 0 0\n", "OFF"),
            ("a.glb", b"b3dm....", "3D Tiles"),
            ("a.dae", b"<?xml version=\"1.0\"?>", "XML"),
            ("a.obj.gz", b"\x1f\x8b\x08", "gzip"),
            ("a.3mf", b"PK\x03\x04", "ZIP"),
            ("a.oc", b"whatever", "built model"),
            ("a", b"hello", "not a mesh file of a known format"),
            ("a.json", b"[1, 2]", "not a mesh file of a known format"),
        ] {
            let error = refused(name, bytes);
            assert!(error.contains(name) && error.contains(words), "{name}: {error}");
        }
    }

    #[test]
    fn non_files_are_refused() {
        let folder = temporary();
        let read = |path: &std::path::Path| {
            read_file(path, &ReadOptions::default(), &mut Collector::new()).expect_err("refused").to_string()
        };
        assert!(read(folder.path()).contains("is a directory"));
        let missing = folder.path().join("missing.ply");
        let error = read(&missing);
        assert!(error.contains("missing.ply: open failed"), "{error}");
        let device = std::path::Path::new("/dev/zero");
        if device.exists() {
            assert!(read(device).contains("not a regular file"));
        }
    }
}
