//! The engines: nacelle, fan, stages, core with its pipes and cables, pylon.

use super::plan::{Look, Plan};
use super::routes::{self, Bundle};
use super::shape::{Foil, NACELLE, core, engine, nacelle};
use super::soup::{Soup, Station, bolt_triangles};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Position of the fan along the nacelle, then those of the beginning and end of the core, as fractions of its length.
const FAN: f64 = 0.2;
const CORE: (f64, f64) = (0.3, 1.12);

/// Adds the sections of both engines.
pub fn plan(plan: &mut Plan, root: u32) {
    for (name, side) in [("left engine", -1.0), ("right engine", 1.0)] {
        let section = plan.group(name, Some(root));
        let lip = engine(side) - DVec3::X * (FAN * NACELLE);
        cowling(plan, section, lip, side);
        fan(plan, section, lip);
        stages(plan, section, lip);
        casing(plan, section, lip);
        systems(plan, section, lip);
        pylon(plan, section, lip, side);
    }
}

/// Returns the point at `t` along the nacelle and radius `r`; `angle` is 0 upward and grows to the right.
fn at(lip: DVec3, t: f64, angle: f64, r: f64) -> DVec3 {
    lip + DVec3::new(t * NACELLE, r * angle.sin(), r * angle.cos())
}

/// Returns the station at this point: `u` points outward, `v` around the axis.
fn station(lip: DVec3, t: f64, angle: f64, r: f64) -> Station {
    let (s, c) = angle.sin_cos();
    Station { at: at(lip, t, angle, r), u: DVec3::new(0.0, s, c), v: DVec3::new(0.0, c, -s) }
}

fn cowling(plan: &mut Plan, section: u32, lip: DVec3, side: f64) {
    let (nu, nv) = (plan.scaled(5.0, 0.25, 2), plan.scaled(10.0, 0.25, 4));
    for sector in 0..8u64 {
        for ring in 0..4u64 {
            // The outer half of the left cowling is open behind the fan.
            let open = side < 0.0 && (ring == 1 || ring == 2) && (4..8).contains(&sector);
            if open {
                continue;
            }
            let look = if ring == 0 { Look::Aluminium } else { Look::Blue };
            let part = plan.part(format!("cowl {ring}-{sector}"), section, look);
            plan.family(part, 2, 2 * nu * nv, move |wall, soup| {
                soup.patch(nu, nv, &|u, v| {
                    let t = (ring as f64 + u) / 4.0;
                    let angle = TAU * (sector as f64 + v) / 8.0;
                    let inner = 0.13 * (1.0 - (1.0 - (t * 8.0).min(1.0)).powi(2)).max(0.0).sqrt();
                    at(lip, t, angle, nacelle(t) - if wall == 0 { 0.0 } else { inner })
                });
            });
        }
    }
}

fn fan(plan: &mut Plan, section: u32, lip: DVec3) {
    let (nu, nv) = (plan.scaled(7.0, 0.3, 2), plan.scaled(14.0, 0.3, 4));
    let part = plan.part("fan", section, Look::Titanium);
    plan.family(part, 22, 4 * nu * nv, move |i, soup| {
        blade(soup, lip, FAN, i as f64 / 22.0, [0.42, 1.42], 0.5, nu, nv)
    });
    let part = plan.part("spinner", section, Look::Floor);
    plan.family(part, 1, 2 * nu * 24, move |_, soup| {
        soup.patch(nu, 24, &|u, v| at(lip, FAN - 0.14 + 0.15 * u, TAU * v, 0.42 * u.sqrt()));
    });
}

/// Adds both faces of a twisted blade.
#[allow(clippy::too_many_arguments)]
fn blade(soup: &mut Soup, lip: DVec3, t: f64, turn: f64, [low, high]: [f64; 2], chord: f64, nu: u64, nv: u64) {
    for face in [-1.0, 1.0] {
        soup.patch(nu, nv, &|u, v| {
            let r = low + (high - low) * v;
            let pitch = 0.35 + 0.85 * v;
            let (along, thick) = ((u - 0.5) * chord, face * 0.012 * (1.0 - v * 0.7) * (1.0 - (2.0 * u - 1.0).powi(2)));
            let around = along * pitch.sin() + thick + 0.08 * v * v;
            at(lip, t + along * pitch.cos() / NACELLE, turn * TAU + around / r, r)
        });
    }
}

/// Adds compressor and turbine: rings of blades and vanes, visible through the open cowling and from behind.
fn stages(plan: &mut Plan, section: u32, lip: DVec3) {
    let (nu, nv) = (plan.scaled(2.0, 0.3, 1), plan.scaled(4.0, 0.3, 2));
    for stage in 0..11u64 {
        let part = plan.part(format!("stage {stage:02}"), section, Look::Titanium);
        let t = CORE.0 + 0.02 + 0.058 * stage as f64;
        let count = plan.scaled(40.0 + 4.0 * stage as f64, 0.2, 10);
        let outer = if stage == 0 { 1.35 } else { core((t - CORE.0) / (CORE.1 - CORE.0)) - 0.02 };
        plan.family(part, count, 4 * nu * nv, move |i, soup| {
            blade(soup, lip, t, i as f64 / count as f64, [0.3, outer], 0.14, nu, nv);
        });
    }
}

fn casing(plan: &mut Plan, section: u32, lip: DVec3) {
    let (nu, nv) = (plan.scaled(3.0, 0.25, 1), plan.scaled(36.0, 0.25, 12));
    for ring in 0..14u64 {
        let name = format!("casing {ring:02}");
        let part = plan.part(name, section, if ring < 7 { Look::Aluminium } else { Look::Titanium });
        let along = move |u: f64| (ring as f64 + u) / 14.0;
        plan.family(part, 1, 2 * nu * nv + 2 * nv * 4, move |_, soup| {
            let t = |w: f64| CORE.0 + (CORE.1 - CORE.0) * w;
            soup.patch(nu, nv, &|u, v| at(lip, t(along(u)), TAU * v, core(along(u))));
            let flange: Vec<Station> =
                (0..=nv).map(|i| station(lip, t(along(0.0)), TAU * i as f64 / nv as f64, core(along(0.0)))).collect();
            let flange: Vec<Station> = flange.into_iter().map(|s| Station { v: DVec3::X, ..s }).collect();
            let side =
                [DVec2::new(0.0, -0.006), DVec2::new(0.03, -0.006), DVec2::new(0.03, 0.006), DVec2::new(0.0, 0.006)];
            soup.sweep(&flange, &side, true);
        });
        let part = plan.part(format!("flange bolts {ring:02}"), section, Look::Steel);
        let (count, sides) = (plan.scaled(60.0, 0.45, 3), plan.scaled(8.0, 0.3, 4));
        plan.family(part, count, bolt_triangles(sides), move |i, soup| {
            let s = station(
                lip,
                CORE.0 + (CORE.1 - CORE.0) * along(0.0),
                TAU * i as f64 / count as f64,
                core(along(0.0)) + 0.018,
            );
            soup.bolt(s.at + DVec3::X * 0.006, DVec3::X, 0.005, 0.024, sides);
        });
        plan.with_twins(20);
    }
    let part = plan.part("exhaust cone", section, Look::Titanium);
    plan.family(part, 1, 2 * nu * nv, move |_, soup| {
        soup.patch(nu, nv, &|u, v| at(lip, 1.0 + 0.35 * u, TAU * v, 0.42 * (1.0 - u) + 0.02));
    });
}

/// Adds pipes and cables that wind around the core.
fn systems(plan: &mut Plan, section: u32, lip: DVec3) {
    let group = plan.group("accessories", Some(section));
    for i in 0..64u64 {
        let f = |k: f64| (i as f64 * k).fract();
        let (angle, sweep) = (TAU * f(0.618_034), (f(0.754_88) - 0.5) * 3.4);
        let (from, long, high) = (0.55 * f(0.569_84), 0.25 + 0.3 * f(0.324_72), 0.03 + 0.16 * f(0.414_21));
        let route = move |t: f64| {
            let w = (from + long * t).min(0.95);
            let r = core(w) + high + 0.02 * (t * 11.0 + angle).sin();
            let s = station(lip, CORE.0 + (CORE.1 - CORE.0) * w, angle + sweep * t, r);
            Station { v: s.u.cross(DVec3::X), ..s }
        };
        let length = long * 4.0 + sweep.abs() * 0.7;
        if i % 5 < 3 {
            let part = plan.part(format!("pipes {i:02}"), group, routes::pipe_look(i));
            let thick = 0.006 + 0.02 * f(0.23);
            routes::pipes(plan, part, 4.0, (0.5 * thick, thick), length * 2.0, route);
        } else {
            let part = plan.part(format!("harness {i:02}"), group, routes::cable_look(i));
            routes::cables(plan, part, Bundle { cables: 14.0, radius: 0.025, length: length * 2.0 }, route);
        }
    }
    let part = plan.part("boxes", group, Look::Clip);
    let count = plan.scaled(60.0, 0.5, 8);
    plan.family(part, count, 24, move |_, soup| {
        let w = soup.rng.range(0.05, 0.8);
        let s = station(lip, CORE.0 + (CORE.1 - CORE.0) * w, soup.rng.range(0.0, TAU), core(w) + 0.06);
        let size = DVec3::new(soup.rng.range(0.02, 0.12), soup.rng.range(0.02, 0.1), soup.rng.range(0.02, 0.06));
        soup.cuboid(s.at, [DVec3::X * size.x, s.v * size.y, s.u * size.z]);
        soup.cuboid(s.at + s.u * size.z, [DVec3::X * (size.x + 0.01), s.v * (size.y + 0.01), s.u * 0.004]);
    });
}

fn pylon(plan: &mut Plan, section: u32, lip: DVec3, side: f64) {
    let (nu, nv) = (plan.scaled(8.0, 0.25, 3), plan.scaled(4.0, 0.25, 2));
    let wing = Foil::wing(side);
    let s = (lip.y - wing.root.y) / (wing.tip.y - wing.root.y);
    for (name, face) in [("pylon left", -1.0), ("pylon right", 1.0)] {
        let part = plan.part(name, section, Look::White);
        let wing = wing.clone();
        plan.family(part, 1, 2 * nu * nv, move |_, soup| {
            soup.patch(nu, nv, &|u, v| {
                let t = 0.22 + 0.95 * u;
                let low = at(lip, t, 0.0, nacelle(t.min(1.0)) - 0.12);
                let high = wing.point(s, (0.02 + 0.55 * (u - 0.3)).max(0.0), -0.9);
                let high = if u < 0.3 { low.lerp(high, u / 0.3) } else { high };
                low.lerp(high, v) + DVec3::Y * (face * 0.2 * (u * (1.05 - u)).max(0.0).sqrt() * 2.0)
            });
        });
    }
}
