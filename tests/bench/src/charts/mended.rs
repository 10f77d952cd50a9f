//! What was measured before something was mended, and after (`mended.toml`).

use super::axis::Axis;
use super::draw::{Curve, Look, Panel, Point, Sheet};
use crate::failure::Failure;
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Data {
    mended: Vec<Row>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    title: String,
    y: String,
    /// Pixels of error.
    poe: Vec<f64>,
    /// What is asked for at each; empty if nothing is.
    #[serde(default)]
    line: Vec<f64>,
    before: Measured,
    now: Measured,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Measured {
    version: String,
    /// At each.
    values: Vec<f64>,
}

pub fn sheet() -> Result<Sheet, Failure> {
    parse(include_str!("../../mended.toml"))
}

fn parse(text: &str) -> Result<Sheet, Failure> {
    let data: Data = toml::from_str(text).map_err(|e| Failure::new(format!("mended.toml: {e}")))?;
    let panels = data.mended.iter().map(panel).collect::<Result<Vec<_>, _>>()?;
    let title = "What was mended: errors over pixels of error, before and now".to_owned();
    let foot = "As the stability suite and benchmarks printed it; lines without marks: what is asked for.".to_owned();
    Ok(Sheet { title, foot, columns: 3, panels })
}

fn panel(row: &Row) -> Result<Panel, Failure> {
    let curve = |name: &str, look, values: &[f64]| {
        if values.len() != row.poe.len() {
            return Err(Failure::new(format!(
                "mended.toml: {:?} has {} values of {name}, not {}",
                row.title,
                values.len(),
                row.poe.len()
            )));
        }
        let points = row.poe.iter().zip(values).map(|(x, y)| Point::new(*x, *y)).collect();
        Ok(Curve { name: name.into(), look, points })
    };
    let mut curves = vec![curve("before", Look::Line, &row.before.values)?, curve("now", Look::Line, &row.now.values)?];
    if !row.line.is_empty() {
        curves.push(curve("at most", Look::Limit, &row.line)?);
    }
    let versions = format!("pixels of error (before: {}; now: {})", row.before.version, row.now.version);
    Ok(Panel { title: row.title.clone(), x: Axis::log(&versions), y: Axis::log(&row.y), curves })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_data_of_this_folder_is_drawn() {
        let sheet = sheet().expect("in order");
        assert!(sheet.panels.len() >= 5 && sheet.panels.iter().all(|panel| panel.curves.len() >= 2));
        assert!(super::super::draw::svg(&sheet).expect("a chart").contains("before"));
    }

    #[test]
    fn rows_have_a_value_for_each() {
        let row = "[[mended]]\ntitle = 'a'\ny = 'b'\npoe = [1, 3]\nbefore = { version = 'c', values = [1, 2] }\nnow = { version = 'd', values = [1] }\n";
        assert!(parse(row).err().expect("one is missing").to_string().contains("not 2"));
    }
}
