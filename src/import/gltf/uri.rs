//! URIs of buffers and images: data in the URI itself, or a path relative to the document.

use crate::import::access::Candidates;
use base64::Engine as _;
use base64::alphabet::STANDARD;
use base64::engine::general_purpose::{GeneralPurpose, NO_PAD};
use std::path::{Path, PathBuf};

/// Decoder of base64 without padding, whose unused last bits may have any value.
const BASE64: GeneralPurpose = GeneralPurpose::new(&STANDARD, NO_PAD.with_decode_allow_trailing_bits(true));

/// Returns the bytes in a `data:` URI, or `None` for other kinds of URI.
///
/// The scheme may be written in capitals. Base64 may have line breaks, percent codes, the URL-safe alphabet, and no
/// padding.
pub(crate) fn data(uri: &str) -> Option<Result<Vec<u8>, String>> {
    let (scheme, rest) = uri.trim_start().split_once(':')?;
    if !scheme.eq_ignore_ascii_case("data") {
        return None;
    }
    let Some((kind, data)) = rest.split_once(',') else { return Some(Err("a data URI without a comma".into())) };
    let data = percent_decoded(data);
    if !kind.trim_end().to_ascii_lowercase().ends_with("base64") {
        return Some(Ok(data));
    }
    let standard = |byte: u8| match byte {
        b'-' => b'+',
        b'_' => b'/',
        other => other,
    };
    let digits = data.into_iter().filter(|b| !b.is_ascii_whitespace() && *b != b'=').map(standard);
    Some(BASE64.decode(digits.collect::<Vec<u8>>()).map_err(|e| format!("an invalid data URI: {e}")))
}

/// Returns the files that a URI in `document` may refer to; `None` for other schemes, and for absolute paths unless
/// `absolute` allows these.
///
/// Some exporters write names without percent codes. A file that has the name as it is written is therefore found too,
/// if there is none with the decoded name.
pub(crate) fn candidates(document: &Path, uri: &str, absolute: bool) -> Option<Candidates<'static>> {
    let folder = document.parent().unwrap_or(Path::new(""));
    let both = [path(percent_decoded(uri)), path(uri.as_bytes().to_vec())];
    if uri.is_empty() || !absolute && both.iter().any(|path| path.is_absolute()) {
        return None;
    }
    let both = both.map(|path| folder.join(path));
    // A colon in the first segment ends a scheme, unless it is coded, or there is such a file.
    let has_scheme = uri.split(['/', '\\']).next().is_some_and(|first| first.contains(':'));
    if has_scheme && !both.iter().any(|path| path.is_file()) {
        return None;
    }
    let expected = both[0].clone();
    Some(Candidates { paths: Box::new(both.into_iter()), expected })
}

/// Returns a path of bytes, in which `\` also separates folders.
fn path(mut bytes: Vec<u8>) -> PathBuf {
    bytes.iter_mut().filter(|b| **b == b'\\').for_each(|b| *b = b'/');
    #[cfg(unix)]
    return PathBuf::from(<std::ffi::OsString as std::os::unix::ffi::OsStringExt>::from_vec(bytes));
    #[cfg(not(unix))]
    PathBuf::from(String::from_utf8_lossy(&bytes).into_owned())
}

fn percent_decoded(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        let hex = bytes.get(at + 1..at + 3).filter(|_| byte == b'%').and_then(|h| {
            let digit = |i: usize| char::from(*h.get(i)?).to_digit(16);
            Some((digit(0)? * 16 + digit(1)?) as u8)
        });
        out.push(hex.unwrap_or(byte));
        at += if hex.is_some() { 3 } else { 1 };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_is_read_in_every_form() {
        for uri in [
            "data:application/octet-stream;base64,+/8Ab2s=",
            "DATA:;BASE64,+/8Ab2s",
            " data:application/gltf-buffer; base64,+/8A\r\n b2s=\n",
            "data:;base64,%2B%2f8Ab2s%3D",
            "data:;base64,-_8Ab2t",
            "data:,%FB%ff%00ok",
        ] {
            assert_eq!(data(uri), Some(Ok(b"\xfb\xff\0ok".to_vec())), "{uri}");
        }
        assert!(data("data:;base64,AA!A").unwrap().unwrap_err().contains("invalid data URI"));
        assert_eq!((data("a.bin"), data("database:a.bin"), data("data")), (None, None, None));
    }

    /// The first of the files that exists, or the one that is expected.
    fn file(document: &Path, uri: &str) -> Option<PathBuf> {
        let Candidates { mut paths, expected } = candidates(document, uri, false)?;
        Some(paths.find(|path| path.is_file()).unwrap_or(expected))
    }

    #[test]
    fn files_are_found_by_decoded_and_by_written_names() {
        let folder = tempfile::tempdir().unwrap();
        let document = folder.path().join("a.gltf");
        for name in ["plan:3.bin", "my data.bin", "100%25.bin"] {
            std::fs::write(folder.path().join(name), b"").unwrap();
        }
        for (uri, name) in [
            ("plan%3A3.bin", "plan:3.bin"),
            ("plan:3.bin", "plan:3.bin"),
            ("my%20data.bin", "my data.bin"),
            ("my data.bin", "my data.bin"),
            ("100%25.bin", "100%25.bin"),
            ("100%2525.bin", "100%25.bin"),
            ("missing%3a.bin", "missing:.bin"),
            ("sub\\a%2.bin", "sub/a%2.bin"),
        ] {
            assert_eq!(file(&document, uri), Some(folder.path().join(name)), "{uri}");
        }
        for uri in ["", "/etc/passwd", "%2Fetc/passwd", "https://example.org/a.bin", "C:\\a.bin", "file:a.bin"] {
            assert_eq!(file(&document, uri), None, "{uri}");
        }
        #[cfg(unix)]
        assert!(!file(&document, "%E9.bin").unwrap().to_string_lossy().ends_with("é.bin"));
    }
}
