//! Draws sheets of panels as SVG (plotters) and PNG (resvg), with the same font in both: none of the machine's is
//! needed.

use super::axis::{Axis, Place};
use super::mark::Mark;
use crate::failure::Failure;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use resvg::{tiny_skia, usvg};
use std::ops::Range;
use std::sync::{Arc, Once};

/// A page.
pub struct Sheet {
    /// The story, in one line.
    pub title: String,
    /// On what machine, which version, when.
    pub foot: String,
    pub columns: usize,
    pub panels: Vec<Panel>,
}

/// A pair of axes.
pub struct Panel {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub curves: Vec<Curve>,
}

/// Points of one kind. Equal names have equal looks on a sheet, and one line of its legend.
#[derive(Debug, Clone)]
pub struct Curve {
    pub name: String,
    pub look: Look,
    pub points: Vec<Point>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    pub x: f64,
    pub y: f64,
    /// Written beside it.
    pub label: String,
    /// From the least measured to the most; drawn as a thin line.
    pub range: Option<(f64, f64)>,
}

impl Point {
    pub fn new(x: f64, y: f64) -> Self {
        Self { x, y, label: String::new(), range: None }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// Dots, joined.
    Line,
    /// Marks alone.
    Marks,
    /// A broad pale line under all others, through rings.
    Front,
    /// A thin dark line: what must be kept to.
    Limit,
}

/// Told apart by those who see few colours, too (Okabe and Ito).
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(90, 90, 90),
    RGBColor(150, 120, 0),
];
const PALE: RGBColor = RGBColor(205, 205, 205);
const INK: RGBColor = RGBColor(40, 40, 40);

const PANEL: (u32, u32) = (460, 330);
const TITLE: u32 = 44;
const LEGEND: u32 = 34;
const FOOT: u32 = 26;
const FONT: &str = "sans-serif";

type Drawn<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// What plotters says went wrong.
fn wrong(e: impl std::fmt::Debug) -> Failure {
    Failure::new(format!("drawing: {e:?}"))
}

fn fonts() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let registered = register_font(FONT, FontStyle::Normal, notosans::REGULAR_TTF)
            .and_then(|()| register_font(FONT, FontStyle::Bold, notosans::BOLD_TTF));
        assert!(registered.is_ok(), "the crate's fonts are fonts");
    });
}

/// As SVG.
pub fn svg(sheet: &Sheet) -> Result<String, Failure> {
    fonts();
    let rows = sheet.panels.len().div_ceil(sheet.columns) as u32;
    let legend = legend(sheet);
    let legend_rows = legend_rows(&legend, PANEL.0 * sheet.columns as u32);
    // As wide as its title takes at the least, which is drawn as large as fits.
    let width = (PANEL.0 * sheet.columns as u32).max(title_width(&sheet.title, *TITLE_SIZES.start())?);
    let size = (width, TITLE + LEGEND * legend_rows + PANEL.1 * rows + FOOT);
    let mut title_size = *TITLE_SIZES.start();
    for larger in TITLE_SIZES {
        title_size = if title_width(&sheet.title, larger)? <= width { larger } else { title_size };
    }
    let mut text = String::new();
    {
        let all = SVGBackend::with_string(&mut text, size).into_drawing_area();
        all.fill(&WHITE).map_err(wrong)?;
        let (head, rest) = all.split_vertically(TITLE);
        let (keys, rest) = rest.split_vertically(LEGEND * legend_rows);
        let (body, foot) = rest.split_vertically(PANEL.1 * rows);
        write(&head, &sheet.title, (16, 14), title_size, true)?;
        write(&foot, &sheet.foot, (16, 4), 12, false)?;
        draw_legend(&keys, &legend)?;
        for (panel, area) in sheet.panels.iter().zip(body.split_evenly((rows as usize, sheet.columns))) {
            draw_panel(panel, &area, &legend)?;
        }
        all.present().map_err(wrong)?;
    }
    Ok(text)
}

/// An SVG of ours as PNG, with one and a half times as many pixels.
pub fn png(svg: &str) -> Result<Vec<u8>, Failure> {
    let mut options = usvg::Options::default();
    let fonts = Arc::make_mut(&mut options.fontdb);
    fonts.load_font_data(notosans::REGULAR_TTF.to_vec());
    fonts.load_font_data(notosans::BOLD_TTF.to_vec());
    fonts.set_sans_serif_family("Noto Sans");
    let tree = usvg::Tree::from_str(svg, &options).map_err(wrong)?;
    let scale = 1.5;
    let side = |length: f32| (length * scale).ceil() as u32;
    let mut pixels = tiny_skia::Pixmap::new(side(tree.size().width()), side(tree.size().height()))
        .ok_or_else(|| Failure::new("a picture without pixels"))?;
    resvg::render(&tree, tiny_skia::Transform::from_scale(scale, scale), &mut pixels.as_mut());
    pixels.encode_png().map_err(wrong)
}

fn write(area: &Drawn, text: &str, at: (i32, i32), size: u32, is_bold: bool) -> Result<(), Failure> {
    area.draw_text(text, &font(size, is_bold).color(&INK), at).map_err(wrong)
}

fn font(size: u32, is_bold: bool) -> FontDesc<'static> {
    let style = if is_bold { FontStyle::Bold } else { FontStyle::Normal };
    FontDesc::new(FontFamily::SansSerif, f64::from(size), style)
}

/// Sizes of titles, the least that can be read well first.
const TITLE_SIZES: std::ops::RangeInclusive<u32> = 12..=19;

/// Pixels that a title takes from one end of its sheet to the other. A tenth more than is estimated: letters are drawn
/// somewhat wider.
fn title_width(title: &str, size: u32) -> Result<u32, Failure> {
    let ((left, _), (right, _)) = font(size, true).layout_box(title).map_err(wrong)?;
    Ok(32 + right.abs_diff(left) * 10 / 9)
}

/// Names in the order of their first use, and their looks.
fn legend(sheet: &Sheet) -> Vec<(String, Look)> {
    let mut all: Vec<(String, Look)> = Vec::new();
    for curve in sheet.panels.iter().flat_map(|panel| &panel.curves) {
        if all.iter().all(|(name, _)| *name != curve.name) {
            all.push((curve.name.clone(), curve.look));
        }
    }
    all
}

/// How wide a name is drawn, about.
fn width_of(name: &str) -> u32 {
    52 + 8 * name.chars().count() as u32
}

fn legend_rows(legend: &[(String, Look)], width: u32) -> u32 {
    let mut places = places(legend, width);
    places.next_back().map_or(1, |(_, row)| row + 1)
}

/// Where each name is written: x and the row.
fn places(legend: &[(String, Look)], width: u32) -> impl DoubleEndedIterator<Item = (u32, u32)> {
    let (mut x, mut row) = (16, 0);
    let mut all = Vec::new();
    for (name, _) in legend {
        if x + width_of(name) > width && x > 16 {
            (x, row) = (16, row + 1);
        }
        all.push((x, row));
        x += width_of(name);
    }
    all.into_iter()
}

/// Names that look the same on all sheets, by their beginning: they have the first colours.
const KNOWN: [&str; 4] = ["outcrop, bvh", "Embree", "obvhs", "parry3d"];

/// Colour and mark of a name.
fn looks(legend: &[(String, Look)], name: &str) -> (RGBColor, usize) {
    let first = |known: &str| legend.iter().position(|(n, _)| n.starts_with(known));
    let has_known = KNOWN.iter().any(|known| first(known).is_some());
    let known = |i: usize| KNOWN.iter().position(|known| first(known) == Some(i));
    let is_coloured = |i: &usize| !matches!(legend[*i].1, Look::Front | Look::Limit);
    let here = legend.iter().position(|(n, _)| n == name).unwrap_or(0);
    let others = (0..here).filter(|i| is_coloured(i) && known(*i).is_none()).count();
    let at = known(here).unwrap_or(others + if has_known { KNOWN.len() } else { 0 });
    // With more names than colours the shapes shift: no two names look alike.
    (COLOURS[at % COLOURS.len()], at + at / COLOURS.len())
}

fn draw_legend(area: &Drawn, legend: &[(String, Look)]) -> Result<(), Failure> {
    let (width, _) = area.dim_in_pixel();
    for ((name, look), (x, row)) in legend.iter().zip(places(legend, width)) {
        let (x, y) = (x as i32, (row * LEGEND) as i32 + 12);
        let (colour, shape) = looks(legend, name);
        match look {
            Look::Front => {
                area.draw(&PathElement::new([(x, y), (x + 26, y)], PALE.stroke_width(6))).map_err(wrong)?;
                area.draw(&Circle::new((x + 13, y), 8, INK.stroke_width(1))).map_err(wrong)?;
            }
            Look::Limit => area.draw(&PathElement::new([(x, y), (x + 26, y)], INK.stroke_width(1))).map_err(wrong)?,
            Look::Line => {
                area.draw(&PathElement::new([(x, y), (x + 26, y)], colour.stroke_width(2))).map_err(wrong)?;
                area.draw(&Mark { at: (x + 13, y), colour, shape }).map_err(wrong)?;
            }
            Look::Marks => area.draw(&Mark { at: (x + 13, y), colour, shape }).map_err(wrong)?,
        }
        write(area, name, (x + 34, y - 8), 14, false)?;
    }
    Ok(())
}

fn draw_panel(panel: &Panel, area: &Drawn, legend: &[(String, Look)]) -> Result<(), Failure> {
    let (x, y) = (panel.x.place(panel.points().map(|p| p.x)), panel.y.place(panel.points().flat_map(heights)));
    let font = |size: u32| FontDesc::new(FontFamily::SansSerif, f64::from(size), FontStyle::Normal).color(&INK);
    let bold = FontDesc::new(FontFamily::SansSerif, 15.0, FontStyle::Bold).color(&INK);
    let mut chart = ChartBuilder::on(area)
        .caption(&panel.title, bold)
        .margin(10)
        .margin_right(22)
        .x_label_area_size(46)
        .y_label_area_size(62)
        .build_cartesian_2d(Ticked(x.clone()), Ticked(y.clone()))
        .map_err(wrong)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(230, 230, 230))
        .axis_style(INK)
        .label_style(font(12))
        .axis_desc_style(font(13))
        .x_desc(&panel.x.label)
        .y_desc(&panel.y.label)
        .x_label_formatter(&|at| x.label(*at))
        .y_label_formatter(&|at| y.label(*at))
        .draw()
        .map_err(wrong)?;
    // What lies under others comes first.
    let mut curves: Vec<&Curve> = panel.curves.iter().collect();
    curves.sort_by_key(|curve| curve.look != Look::Front);
    for curve in curves {
        let (colour, shape) = looks(legend, &curve.name);
        let at: Vec<(f64, f64)> = curve.points.iter().map(|p| (x.of(p.x), y.of(p.y))).collect();
        for point in &curve.points {
            if let Some((least, most)) = point.range {
                let ends = [least, most].map(|end| (x.of(point.x), y.of(end)));
                chart.draw_series(LineSeries::new(ends, colour.stroke_width(1))).map_err(wrong)?;
            }
        }
        match curve.look {
            Look::Limit => {
                chart.draw_series(LineSeries::new(at.iter().copied(), INK.stroke_width(1))).map_err(wrong)?;
            }
            Look::Front => {
                chart.draw_series(LineSeries::new(at.iter().copied(), PALE.stroke_width(6))).map_err(wrong)?;
                chart.draw_series(at.iter().map(|&at| Circle::new(at, 8, INK.stroke_width(1)))).map_err(wrong)?;
            }
            Look::Line => {
                chart.draw_series(LineSeries::new(at.iter().copied(), colour.stroke_width(2))).map_err(wrong)?;
                chart.draw_series(at.iter().map(|&at| Mark { at, colour, shape })).map_err(wrong)?;
            }
            Look::Marks => {
                chart.draw_series(at.iter().map(|&at| Mark { at, colour, shape })).map_err(wrong)?;
            }
        }
        // Beside a curve that rises there is room below it.
        let rises = |i: usize| at.get(i + 1).map_or(i > 0 && at[i].1 > at[i - 1].1, |next| next.1 > at[i].1);
        let beside = |i: usize| if rises(i) { (7, 3) } else { (7, -16) };
        let written = curve.points.iter().enumerate().filter(|(_, point)| !point.label.is_empty());
        let text =
            written.map(|(i, point)| EmptyElement::at(at[i]) + Text::new(point.label.clone(), beside(i), font(11)));
        chart.draw_series(text).map_err(wrong)?;
    }
    Ok(())
}

/// All heights that a point takes.
fn heights(point: &Point) -> impl Iterator<Item = f64> + use<> {
    let (least, most) = point.range.unwrap_or((point.y, point.y));
    [point.y, least, most].into_iter()
}

impl Panel {
    fn points(&self) -> impl Iterator<Item = &Point> {
        self.curves.iter().flat_map(|curve| &curve.points)
    }
}

/// An axis with just its ticks.
struct Ticked(Place);

impl Ranged for Ticked {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, at: &f64, (from, to): (i32, i32)) -> i32 {
        let (least, most) = self.0.ends;
        from + (f64::from(to - from) * (at - least) / (most - least)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        // Light lines go between ticks; there are none.
        let is_light = hint.weight().allow_light_points();
        if is_light { Vec::new() } else { self.0.ticks.iter().map(|(at, _)| *at).collect() }
    }

    fn range(&self) -> Range<f64> {
        self.0.ends.0..self.0.ends.1
    }
}
