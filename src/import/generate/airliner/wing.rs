//! Wings, tailplane and fin: skins, ribs, spars, stringers, and the pipes and cables inside.

use super::plan::{Look, Plan};
use super::routes::{self, Bundle};
use super::shape::Foil;
use super::soup::{Soup, Station, bolt_triangles};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Adds the sections of wings, tailplanes and fin.
pub fn plan(plan: &mut Plan, root: u32) {
    for (name, side) in [("left wing", -1.0), ("right wing", 1.0)] {
        let section = plan.group(name, Some(root));
        foil(plan, section, Foil::wing(side), 38, side < 0.0, Look::White);
        fairings(plan, section, Foil::wing(side));
    }
    for (name, side) in [("left tailplane", -1.0), ("right tailplane", 1.0)] {
        let section = plan.group(name, Some(root));
        foil(plan, section, Foil::tailplane(side), 16, false, Look::White);
    }
    let section = plan.group("fin", Some(root));
    foil(plan, section, Foil::fin(), 16, false, Look::Blue);
}

/// Chord fractions at which the skin is divided into strips; the two inner ones have spars.
const SPARS: [f64; 4] = [0.0, 0.14, 0.62, 1.0];

fn foil(plan: &mut Plan, section: u32, foil: Foil, ribs: u64, open: bool, look: Look) {
    for k in 0..ribs {
        let bay = plan.group(format!("rib {k:02}"), Some(section));
        let (from, to) = (k as f64 / ribs as f64, (k + 1) as f64 / ribs as f64);
        skins(plan, bay, &foil, (from, to), open, look);
        rib(plan, bay, &foil, from);
        fasteners(plan, bay, &foil, from);
    }
    spars(plan, section, &foil, ribs);
    stringers(plan, section, &foil, ribs);
    inside(plan, section, &foil);
}

fn skins(plan: &mut Plan, bay: u32, foil: &Foil, (from, to): (f64, f64), open: bool, look: Look) {
    let (nu, nv) = (plan.scaled(1.4, 0.25, 1), plan.scaled(6.0, 0.25, 3));
    for (name, h) in [("lower skin", -1.0), ("upper skin", 1.0)] {
        // The round nose is divided more finely. Where the wing is cut away, the upper skin between the spars is left
        // out.
        let is_cut = move |strip: usize| open && h > 0.0 && strip == 1 && from > 0.12 && to < 0.9;
        let strips: Vec<usize> = (0..3).filter(|&s| !is_cut(s)).collect();
        let part = plan.part(name, bay, if h < 0.0 && look == Look::White { Look::Aluminium } else { look });
        let (foil, count) = (foil.clone(), strips.len() as u64);
        plan.family(part, count, 2 * nu * nv, move |i, soup| {
            let (c0, c1) = (SPARS[strips[i as usize]], SPARS[strips[i as usize] + 1]);
            soup.patch(nu, nv, &|u, v| {
                let v = if c0 == 0.0 { v * v } else { v };
                foil.point(from + (to - from) * u, c0 + (c1 - c0) * v, h)
            });
        });
    }
}

/// Adds a rib with its flanges and stiffeners.
fn rib(plan: &mut Plan, bay: u32, foil: &Foil, s: f64) {
    let part = plan.part("rib", bay, Look::Primer);
    let n = plan.scaled(22.0, 0.3, 3);
    let along = (foil.tip - foil.root).normalize();
    let web = foil.clone();
    plan.family(part, 1, 2 * n * (2 + 2), move |_, soup| {
        soup.patch(n, 2, &|u, v| web.point(s, 0.02 + 0.93 * u, 1.94 * v - 0.97));
        for h in [-0.985, 0.985] {
            soup.patch(n, 1, &|u, v| web.point(s, 0.02 + 0.93 * u, h) + along * (0.07 * (v - 0.5)));
        }
    });
    let part = plan.part("stiffeners", bay, Look::Clip);
    let (count, foil) = (plan.scaled(16.0, 0.4, 1), foil.clone());
    plan.family(part, count, 24, move |i, soup| {
        let c = 0.05 + 0.85 * (i as f64 + 0.5) / count as f64;
        let (low, high) = (foil.point(s, c, -0.96), foil.point(s, c, 0.96));
        let (center, up) = ((low + high) * 0.5, (high - low) * 0.5);
        soup.cuboid(center + along * 0.02, [DVec3::X * 0.001, along * 0.02, up]);
        soup.cuboid(center + DVec3::X * 0.012, [DVec3::X * 0.012, along * 0.001, up]);
    });
    plan.with_twins(16);
}

fn fasteners(plan: &mut Plan, bay: u32, foil: &Foil, s: f64) {
    let part = plan.part("fasteners", bay, Look::Steel);
    let (count, sides) = (plan.scaled(24.0, 0.6, 1), plan.scaled(8.0, 0.3, 4));
    let foil = foil.clone();
    plan.family(part, count, bolt_triangles(sides), move |i, soup| {
        let h = if i % 2 == 0 { 1.0 } else { -1.0 };
        let c = 0.03 + 0.9 * (i as f64 + soup.rng.unit()) / count as f64;
        let size = soup.rng.range(0.003, 0.006);
        soup.bolt(foil.point(s, c, 0.975 * h), foil.across * -h, size, size * 5.0, sides);
    });
    plan.with_twins(30);
}

fn spars(plan: &mut Plan, section: u32, foil: &Foil, ribs: u64) {
    let n = plan.scaled(4.0, 0.3, 1);
    for (i, c) in SPARS[1..3].iter().copied().enumerate() {
        let part = plan.part(format!("spar {i}"), section, Look::Primer);
        let foil = foil.clone();
        plan.family(part, ribs, 2 * n * 3, move |k, soup| {
            let s = |u: f64| (k as f64 + u) / ribs as f64;
            soup.patch(n, 1, &|u, v| foil.point(s(u), c, 1.96 * v - 0.98));
            for h in [-0.98, 0.98] {
                soup.patch(n, 1, &|u, v| foil.point(s(u), c, h) + DVec3::X * (0.12 * (v - 0.5)));
            }
        });
    }
}

/// Cross-section of the stringers, which run along the span under both skins: a Z of sheet metal.
const ZED: [DVec2; 4] = [DVec2::new(0.0, -0.03), DVec2::new(0.0, 0.0), DVec2::new(0.055, 0.0), DVec2::new(0.055, 0.03)];

fn stringers(plan: &mut Plan, section: u32, foil: &Foil, ribs: u64) {
    let group = plan.group("stringers", Some(section));
    let n = plan.scaled(1.0, 0.3, 1);
    let pieces = ribs / 8;
    for i in 0..24u64 {
        let h = if i % 2 == 0 { -1.0 } else { 1.0 };
        let c = SPARS[1] + (SPARS[2] - SPARS[1]) * ((i / 2) as f64 + 0.5) / 12.0;
        let part = plan.part(format!("stringer {i:02}"), group, Look::Stringer);
        let foil = foil.clone();
        plan.family(part, pieces, 2 * n * 3, move |k, soup| {
            let path: Vec<Station> = (0..=n)
                .map(|j| {
                    let s = (k as f64 + 1.02 * j as f64 / n as f64) / pieces as f64;
                    Station { at: foil.point(s, c, 0.96 * h), u: foil.across * -h, v: DVec3::X }
                })
                .collect();
            soup.sweep(&path, &ZED, false);
        });
    }
}

/// Adds pipes and cables along the span: before the front spar, between the spars, and behind the rear spar.
fn inside(plan: &mut Plan, section: u32, foil: &Foil) {
    let group = plan.group("systems", Some(section));
    let span = foil.span();
    let pieces = (span / 6.0).ceil() as u64;
    for i in 0..pieces * 14 {
        let (piece, lane) = (i / 14, i % 14);
        let (from, to) = (piece as f64 / pieces as f64, (piece as f64 + 1.15) / pieces as f64);
        let c = match lane {
            0..5 => 0.05 + 0.018 * lane as f64,
            5..9 => 0.2 + 0.1 * (lane - 5) as f64,
            _ => 0.65 + 0.03 * (lane - 9) as f64,
        };
        let wave = (i as f64 * 0.618_034).fract() * TAU;
        let own = foil.clone();
        let along = (foil.tip - foil.root).normalize();
        let route = move |t: f64| {
            let s = (from + (to - from) * t).min(0.99);
            let h = 0.55 * (t * 2.3 + wave).sin() + 0.1 * (t * 14.0).sin();
            let at = own.point(s, c + 0.012 * (t * 9.0 + wave).cos(), h);
            Station { at, u: own.across, v: along.cross(own.across) }
        };
        if lane % 3 == 2 {
            let part = plan.part(format!("pipes {i:03}"), group, routes::pipe_look(i));
            let thick = 0.008 + 0.02 * (i as f64 * 0.3247).fract();
            routes::pipes(plan, part, 2.0, (0.5 * thick, thick), span * (to - from), route);
        } else {
            let part = plan.part(format!("bundle {i:03}"), group, routes::cable_look(i));
            let bundle = Bundle { cables: 30.0, radius: 0.05, length: span * (to - from) };
            routes::cables(plan, part, bundle, route);
        }
    }
}

/// Adds the fairings of the flap tracks under the trailing edge.
fn fairings(plan: &mut Plan, section: u32, foil: Foil) {
    let (nu, nv) = (plan.scaled(12.0, 0.25, 4), plan.scaled(12.0, 0.25, 5));
    for s in [0.16, 0.42, 0.58, 0.74] {
        let part = plan.part("flap fairing", section, Look::Aluminium);
        let foil = foil.clone();
        plan.family(part, 1, 2 * nu * nv, move |_, soup: &mut Soup| {
            let center = foil.point(s, 0.82, -1.0) - DVec3::Z * 0.12;
            let length = 0.3 * foil.chord(s) + 0.5;
            soup.patch(nu, nv, &|u, v| {
                let (a, b) = (u * TAU / 2.0, v * TAU);
                let r = 0.26 * a.sin().powf(0.8);
                center + DVec3::new(-length * a.cos(), r * b.cos(), r * b.sin())
            });
        });
    }
}
