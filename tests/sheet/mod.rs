//! One picture out of many, each with a line of text under it.

use std::path::Path;

/// A small picture of a sheet: RGBA bytes, rows from the top.
pub struct Tile {
    pub pixels: Vec<u8>,
    pub label: String,
}

const LETTERS: &str = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-/ ";
/// 3 x 5 dots a letter, row by row from the top.
#[rustfmt::skip]
const DOTS: [&str; 41] = [
    "010101111101101", "110101110101110", "011100100100011", "110101101101110", "111100110100111", "111100110100100",
    "011100101101011", "101101111101101", "111010010010111", "001001001101010", "101101110101101", "100100100100111",
    "101111111101101", "110101101101101", "010101101101010", "110101110100100", "010101101111011", "110101110101101",
    "011100010001110", "111010010010010", "101101101101111", "101101101101010", "101101111111101", "101101010101101",
    "101101010010010", "111001010100111",
    "111101101101111", "010110010010111", "110001010100111", "110001010001110", "101101111001001", "111100110001110",
    "011100110101010", "111001010010010", "010101010101010", "010101011001110",
    "000000000000010", "000000000000111", "000000111000000", "001001010100100", "000000000000000",
];
/// Pixels a dot, and height of the line under a picture.
const DOT: usize = 2;
const LINE: usize = 16;

fn write(sheet: &mut [u8], width: usize, (left, top): (usize, usize), text: &str) {
    for (i, letter) in text.to_uppercase().chars().enumerate() {
        let Some(dots) = LETTERS.find(letter).map(|l| DOTS[l]) else { continue };
        for (d, _) in dots.bytes().enumerate().filter(|(_, b)| *b == b'1') {
            let (x, y) = (left + (i * 4 + d % 3) * DOT, top + d / 3 * DOT);
            for (dx, dy) in (0..DOT * DOT).map(|k| (k % DOT, k / DOT)) {
                let at = ((y + dy) * width + x + dx) * 4;
                sheet[at..at + 4].copy_from_slice(&[255; 4]);
            }
        }
    }
}

/// Writes the tiles, each of `size` pixels, `across` in a row, as a PNG.
pub fn save(path: &Path, tiles: &[Tile], size: (usize, usize), across: usize) {
    let (width, height) = (across * size.0, tiles.len().div_ceil(across) * (size.1 + LINE));
    let mut sheet = [16, 16, 16, 255].repeat(width * height);
    for (i, tile) in tiles.iter().enumerate() {
        let (left, top) = (i % across * size.0, i / across * (size.1 + LINE));
        for (y, row) in tile.pixels.chunks_exact(size.0 * 4).enumerate() {
            let at = ((top + y) * width + left) * 4;
            sheet[at..at + row.len()].copy_from_slice(row);
        }
        // As many letters as the width takes.
        let most = (size.0 - 4) / (4 * DOT);
        let label: String = tile.label.chars().take(most).collect();
        write(&mut sheet, width, (left + 4, top + size.1 + 3), &label);
    }
    image::save_buffer(path, &sheet, width as u32, height as u32, image::ExtendedColorType::Rgba8).expect("a sheet");
}
