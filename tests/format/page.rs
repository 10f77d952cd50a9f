//! Parts of FORMAT.md: sections, tables, types and sizes.

use std::collections::BTreeMap;

/// The text of the page.
pub const FORMAT: &str = include_str!("../../src/store/FORMAT.md");

/// The first heading that begins with `begin`, and the text below it, up to the next heading.
pub fn section(begin: &str) -> (&'static str, &'static str) {
    let at = FORMAT.find(&format!("\n{begin}")).unwrap_or_else(|| panic!("no heading {begin}"));
    let (heading, rest) = FORMAT[at + 1..].split_once('\n').expect("a line");
    (heading, rest.split("\n#").next().expect("a text"))
}

/// The cells of the table with these columns in a section, row by row.
pub fn table(begin: &str, columns: &str) -> Vec<Vec<&'static str>> {
    let mut lines = section(begin).1.lines().skip_while(|line| *line != format!("| {columns} |"));
    assert!(lines.next().is_some(), "{begin}: no table of {columns}");
    let rows = lines.skip(1).take_while(|line| line.starts_with('|'));
    let rows: Vec<Vec<_>> = rows.map(|row| row.trim_matches('|').split('|').map(str::trim).collect()).collect();
    let count = columns.split(" | ").count();
    assert!(!rows.is_empty() && rows.iter().all(|row| row.len() == count), "{begin}: {columns}");
    rows
}

/// All numbers in a text.
pub fn numbers(text: &str) -> Vec<u64> {
    text.split(|c: char| !c.is_ascii_digit()).filter_map(|digits| digits.parse().ok()).collect()
}

/// Number of bytes of a type.
pub fn size_of_type(name: &str) -> usize {
    let (base, count) = match name.split_once('[') {
        Some((base, count)) => (base, count.trim_end_matches(']').parse::<usize>().expect("a count")),
        None => (name, 1),
    };
    let bits: usize = base.trim_start_matches(['u', 'f']).parse().unwrap_or_else(|_| panic!("{name} is no type"));
    assert!([8, 16, 32, 64].contains(&bits), "{name} is no type");
    bits / 8 * count
}

/// A row of a table of offsets.
pub struct Field {
    pub offset: usize,
    pub size: usize,
    pub name: &'static str,
    pub range: &'static str,
}

/// The rows of the table of offsets in a section. Each row begins where the row before it ends.
pub fn fields(begin: &str) -> Vec<Field> {
    let mut end = 0;
    let mut all = Vec::new();
    for row in table(begin, "offset | type | field | range") {
        let [offset, kind, name, range] = row[..] else { unreachable!() };
        let size = size_of_type(kind);
        assert_eq!(offset.parse::<usize>(), Ok(end), "{begin}: offset of {name}");
        all.push(Field { offset: end, size, name, range });
        end += size;
    }
    all
}

/// The range of a field.
pub fn range_of(begin: &str, name: &str) -> &'static str {
    let all = fields(begin);
    let found = all.iter().find(|field| field.name.starts_with(name));
    found.unwrap_or_else(|| panic!("{begin}: no field {name}")).range
}

/// A little-endian number.
pub fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte))
}

/// Checks the bytes of a field whose range is a number or "zero".
pub fn check_constant(place: &str, range: &str, bytes: &[u8]) {
    if range == "zero" {
        assert!(bytes.iter().all(|byte| *byte == 0), "{place} is not zero");
    } else if let Ok(only) = range.parse::<u64>() {
        assert_eq!(number(bytes), only, "{place}");
    }
}

/// Checks that the table of a section describes `bytes`. `expected`: the beginning of each field's name, and its bytes.
pub fn check_row(begin: &str, bytes: &[u8], expected: &[(&str, Vec<u8>)]) {
    let all = fields(begin);
    assert_eq!(all.iter().map(|field| field.size).sum::<usize>(), bytes.len(), "{begin}: size of the table");
    assert_eq!(numbers(section(begin).0).last(), Some(&(bytes.len() as u64)), "{begin}: size in the heading");
    assert_eq!(all.len(), expected.len(), "{begin}: number of fields");
    for (field, (name, value)) in all.iter().zip(expected) {
        let place = format!("{begin}: {}", field.name);
        assert!(field.name.starts_with(*name), "{place} in place of {name}");
        let found = &bytes[field.offset..field.offset + field.size];
        assert_eq!(found, &value[..], "{place}");
        assert_eq!(field.name == "reserved", field.range == "zero", "{place}");
        check_constant(&place, field.range, found);
    }
}

/// Evaluates a sum of products of counts and numbers: `a x n / b, rounded up + c x (v - 1)`.
pub fn evaluate(sum: &str, counts: &BTreeMap<&str, usize>) -> usize {
    let factor = |text: &str| -> usize {
        let inner = text.trim_start_matches('(').trim_end_matches(')');
        let (text, less) = inner.split_once(" - ").unwrap_or((inner, "0"));
        let value = text.parse::<usize>().ok().or_else(|| counts.get(text).copied());
        value.unwrap_or_else(|| panic!("{sum}: {text} is not known")) - less.parse::<usize>().expect("a number")
    };
    let term = |text: &str| {
        let (text, is_up) = text.strip_suffix(", rounded up").map_or((text, false), |text| (text, true));
        let (product, divisor) = text.split_once(" / ").unwrap_or((text, "1"));
        let product: usize = product.split(" x ").map(&factor).product();
        let divisor = divisor.parse::<usize>().expect("a number");
        assert!(is_up || product.is_multiple_of(divisor), "{sum}");
        product.div_ceil(divisor)
    };
    sum.split(" + ").map(term).sum()
}
