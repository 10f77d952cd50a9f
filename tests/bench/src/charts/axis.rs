//! Axes: where values go, and which of them are written.

/// What an axis shows.
pub struct Axis {
    /// With the unit.
    pub label: String,
    pub scale: Scale,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// From 0.
    Linear,
    /// From the least value to the greatest.
    Span,
    /// Powers of ten. What is 0 has a place of its own, before all others.
    Log,
}

impl Axis {
    pub fn linear(label: &str) -> Self {
        Self { label: label.into(), scale: Scale::Linear }
    }

    pub fn span(label: &str) -> Self {
        Self { label: label.into(), scale: Scale::Span }
    }

    pub fn log(label: &str) -> Self {
        Self { label: label.into(), scale: Scale::Log }
    }

    /// For these values.
    pub fn place(&self, values: impl Iterator<Item = f64>) -> Place {
        let values: Vec<f64> = values.filter(|v| v.is_finite()).collect();
        match self.scale {
            Scale::Linear => linear(&values),
            Scale::Span => span(&values),
            Scale::Log => log(&values),
        }
    }
}

/// A scale for certain values.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    scale: Scale,
    /// Ends, as positions.
    pub ends: (f64, f64),
    /// Positions, and what is written there.
    pub ticks: Vec<(f64, String)>,
    /// Where 0 is.
    zero: f64,
}

impl Place {
    /// The position of a value.
    pub fn of(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear | Scale::Span => value,
            Scale::Log if value <= 0.0 => self.zero,
            Scale::Log => value.log10(),
        }
    }

    /// What is written at a position.
    pub fn label(&self, at: f64) -> String {
        let tick = self.ticks.iter().find(|(tick, _)| (tick - at).abs() < 1e-9);
        tick.map_or(String::new(), |(_, text)| text.clone())
    }
}

/// As people write it: no more digits than a tick needs.
pub fn written(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    format!("{rounded}")
}

/// A round step, of which up to six make so much.
fn step_of(most: f64) -> f64 {
    let power = 10f64.powf((most / 5.0).log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|s| s * power).into_iter().find(|s| most / s <= 6.0).unwrap_or(power * 10.0)
}

/// The multiples of a step from one value to another.
fn multiples(step: f64, from: f64, to: f64) -> impl Iterator<Item = f64> {
    ((from / step).ceil() as i64..=(to / step).floor() as i64).map(move |i| step * i as f64)
}

fn span(values: &[f64]) -> Place {
    let (least, most) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
    if least > most {
        return linear(&[]);
    }
    let room = ((most - least) * 0.08).max(most.abs() * 1e-3).max(f64::MIN_POSITIVE);
    let ends = (least - room, most + room);
    let ticks = multiples(step_of(ends.1 - ends.0), ends.0, ends.1).map(|t| (t, written(t))).collect();
    Place { scale: Scale::Span, ends, ticks, zero: 0.0 }
}

fn linear(values: &[f64]) -> Place {
    let most = values.iter().copied().fold(0.0, f64::max);
    let most = if most > 0.0 { most } else { 1.0 };
    let step = step_of(most);
    let count = (most / step).floor() as usize;
    let ticks =
        (0..=count + 1).map(|i| step * i as f64).filter(|t| *t <= most * 1.08).map(|t| (t, written(t))).collect();
    Place { scale: Scale::Linear, ends: (0.0, most * 1.08), ticks, zero: 0.0 }
}

fn log(values: &[f64]) -> Place {
    let positive = || values.iter().copied().filter(|v| *v > 0.0);
    let (least, most) = (positive().fold(f64::INFINITY, f64::min), positive().fold(0.0, f64::max));
    let (least, most) = if most > 0.0 { (least.log10(), most.log10()) } else { (0.0, 1.0) };
    let has_zero = values.iter().any(|v| *v <= 0.0);
    let room = ((most - least) * 0.06).max(0.08);
    let zero = least - room * 2.5;
    let ends = (if has_zero { zero - room } else { least - room }, most + room);
    let mut ticks = Vec::new();
    if has_zero {
        ticks.push((zero, "0".to_owned()));
    }
    // Few decades have room for more than their powers of ten.
    let within: &[f64] = if most - least > 3.0 {
        &[1.0]
    } else if most - least > 2.0 {
        &[1.0, 3.0]
    } else {
        &[1.0, 2.0, 5.0]
    };
    let zeros = ticks.len();
    for decade in (least.floor() as i32 - 1)..=(most.ceil() as i32) {
        for factor in within {
            let value = factor * 10f64.powi(decade);
            let at = value.log10();
            if at >= least - room && at <= ends.1 && (!has_zero || at > zero + room) {
                ticks.push((at, written(value)));
            }
        }
    }
    // Within a small part of a decade: round values as on a linear axis.
    if ticks.len() < zeros + 2 {
        let (from, to) = (10f64.powf(least - room), 10f64.powf(ends.1));
        ticks.truncate(zeros);
        ticks.extend(
            multiples(step_of((to - from) * 2.0), from, to).filter(|t| *t > 0.0).map(|t| (t.log10(), written(t))),
        );
    }
    Place { scale: Scale::Log, ends, ticks, zero }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(place: &Place) -> Vec<&str> {
        place.ticks.iter().map(|(_, text)| text.as_str()).collect()
    }

    #[test]
    fn linear_axes_begin_at_zero_with_round_numbers() {
        let place = Axis::linear("").place([3.0, 46.7].into_iter());
        assert_eq!(texts(&place), ["0", "10", "20", "30", "40", "50"]);
        assert_eq!(place.label(20.0), "20");
        assert_eq!(texts(&Axis::linear("").place([].into_iter())), ["0", "0.2", "0.4", "0.6", "0.8", "1"]);
    }

    #[test]
    fn logarithmic_axes_have_a_place_for_zero() {
        let place = Axis::log("").place([0.0, 0.04, 3.0].into_iter());
        assert_eq!(texts(&place), ["0", "0.05", "0.1", "0.2", "0.5", "1", "2"]);
        assert!(place.of(0.0) < place.of(0.04) && place.ends.0 < place.of(0.0));
        let place = Axis::log("").place([20.0, 90.0].into_iter());
        assert_eq!(texts(&place), ["20", "50", "100"]);
        assert_eq!(texts(&Axis::log("").place([0.0].into_iter())).first(), Some(&"0"));
        // All between two powers, and two of anything are written.
        let place = Axis::log("").place([0.0, 31.0, 37.0].into_iter());
        assert_eq!(texts(&place), ["0", "30", "40"]);
    }

    #[test]
    fn a_span_begins_and_ends_with_its_values() {
        let place = Axis::span("").place([0.96, 1.04].into_iter());
        assert_eq!(texts(&place), ["0.96", "0.98", "1", "1.02", "1.04"]);
        assert!(place.ends.0 > 0.94 && place.ends.1 < 1.06);
        assert!(texts(&Axis::span("").place([1.0, 1.0].into_iter())).contains(&"1"));
        assert!(!texts(&Axis::span("").place([].into_iter())).is_empty());
    }
}
