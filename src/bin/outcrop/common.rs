//! Shared parts of the commands: failures, parsing of sizes, counts and points, Ctrl-C, progress bars.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec3;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use outcrop::base::progress::{Cancel, Phase, Progress};
use outcrop::base::threads;
use std::fmt;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

/// Result of a command.
pub type Outcome = Result<(), Failure>;

/// Reason for which a command failed.
#[derive(Debug)]
pub enum Failure {
    /// The operation failed.
    Failed(outcrop::Error),
    /// A picture failed, for this reason.
    Frame(String),
    /// Writing to standard output failed.
    Output(std::io::Error),
    /// The combination of arguments is invalid.
    Usage(String),
}

impl Failure {
    /// Returns the exit code of the process.
    pub fn exit_code(&self) -> u8 {
        match self {
            Failure::Usage(_) | Failure::Failed(outcrop::Error::BadArgument(_)) => 2,
            Failure::Failed(outcrop::Error::Cancelled) => INTERRUPTED,
            Failure::Failed(_) | Failure::Frame(_) | Failure::Output(_) => 1,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Failed(e) => e.fmt(f),
            Failure::Output(e) => write!(f, "standard output: {e}"),
            Failure::Frame(what) | Failure::Usage(what) => f.write_str(what),
        }
    }
}

impl From<outcrop::Error> for Failure {
    fn from(e: outcrop::Error) -> Self {
        Failure::Failed(e)
    }
}

/// Returns a parser for an option that is one of `all`, by name.
pub fn one_of<T: Copy + Send + Sync + 'static, const N: usize>(
    all: [T; N],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    let find = move |text: String| all.into_iter().find(|&it| name(it) == text).expect("only these names are possible");
    PossibleValuesParser::new(all.map(name)).map(find)
}

/// Parses a size in bytes: digits, an optional K, M, G or T (powers of 1024), and an optional B or iB.
pub fn byte_size(text: &str) -> Result<u64, String> {
    let number = text.strip_suffix("iB").or(text.strip_suffix('B')).unwrap_or(text);
    scaled(number, 1024)
}

/// Parses a count: digits, and an optional K, M, G or T (powers of 1000).
pub fn count(text: &str) -> Result<u64, String> {
    scaled(text, 1000)
}

fn scaled(text: &str, thousand: u64) -> Result<u64, String> {
    let (digits, power) = match text.char_indices().next_back() {
        Some((at, suffix)) if !suffix.is_ascii_digit() => {
            let power = "KMGT"
                .find(suffix.to_ascii_uppercase())
                .ok_or(format!("unknown suffix {suffix:?}; expected K, M, G or T"))?;
            (&text[..at], power as u32 + 1)
        }
        _ => (text, 0),
    };
    let number: f64 = digits.parse().map_err(|_| format!("{digits:?} is not a number"))?;
    let value = number * (thousand as f64).powi(power as i32);
    if value.is_finite() && (0.0..9e18).contains(&value) { Ok(value as u64) } else { Err("out of range".into()) }
}

/// Exit code of a process that Ctrl-C has ended: 128 and the number of the signal, as shells count.
const INTERRUPTED: u8 = 130;

/// Returns a cancel flag that Ctrl-C sets. A second Ctrl-C ends the process at once.
pub fn cancel_on_ctrl_c() -> Cancel {
    let cancel = Cancel::new();
    let switch = cancel.clone();
    // If the handler cannot be set, Ctrl-C kills the process: temporary files may stay, nothing else is lost.
    let _ = ctrlc::set_handler(move || {
        if switch.is_cancelled() {
            std::process::exit(INTERRUPTED.into());
        }
        switch.cancel();
    });
    cancel
}

/// Returns a progress bar on stderr, which is invisible if stderr is not a terminal.
pub fn progress_bar(total: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr_with_hz(8));
    if let Ok(style) = ProgressStyle::with_template("{msg:9} {bar:40} {percent:>3} %, {eta} left") {
        bar.set_style(style);
    }
    bar
}

/// Shows `progress` in `bar` while `work` runs on this thread.
pub fn watched<T>(progress: &Progress, bar: &ProgressBar, work: impl FnOnce() -> T) -> T {
    watched_part(progress, bar, 0..bar.length().unwrap_or(0), work)
}

/// Shows `progress` in a part of `bar` while `work` runs on this thread.
pub fn watched_part<T>(progress: &Progress, bar: &ProgressBar, part: Range<u64>, work: impl FnOnce() -> T) -> T {
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(Relaxed) {
                let length = part.end.saturating_sub(part.start);
                bar.set_position(part.start + (progress.fraction() * length as f64) as u64);
                bar.set_message(match progress.phase() {
                    Phase::Waiting | Phase::Read => "reading",
                    Phase::Build => "building",
                    Phase::Write => "writing",
                    Phase::Seal | Phase::Done => "sealing",
                });
                std::thread::park_timeout(Duration::from_millis(100));
            }
        });
        // The flag is also set if `work` panics; otherwise the watching thread would never end.
        let _end = SetOnDrop(&done);
        work()
    })
}

struct SetOnDrop<'a>(&'a AtomicBool);

impl Drop for SetOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Relaxed);
    }
}

/// Returns a count with its noun: "1 block", "2 blocks".
pub fn counted(n: u64, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}

/// Returns a number with a noun whose plural has another ending.
pub fn counted_as(n: u64, one: &str, several: &str) -> String {
    format!("{n} {}", if n == 1 { one } else { several })
}

/// Returns the bytes per triangle as text, or "no triangles" for an empty model.
pub fn each(bytes: u64, triangles: u64) -> String {
    match triangles {
        0 => "no triangles".into(),
        n => format!("{:.1} bytes per triangle", bytes as f64 / n as f64),
    }
}

/// Returns a size in bytes as readable text.
pub fn in_bytes(bytes: u64) -> String {
    indicatif::BinaryBytes(bytes).to_string()
}

/// Parses a number of threads: 0, for all of the machine, or up to the limit.
pub fn threads(text: &str) -> Result<usize, String> {
    let most = threads::most();
    match text.parse() {
        Ok(threads) if threads <= most => Ok(threads),
        _ => Err(format!("expected a number from 0 to {most}, the limit on this machine")),
    }
}

/// Parses a finite number above 0.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if number > 0.0 && f64::is_finite(number) => Ok(number),
        _ => Err("expected a finite number above 0".into()),
    }
}

/// Parses three numbers "x,y,z".
pub fn point(text: &str) -> Result<DVec3, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse::<f64>()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z]) if x.is_finite() && y.is_finite() && z.is_finite() => Ok(DVec3::new(x, y, z)),
        _ => Err("expected three numbers X,Y,Z".into()),
    }
}

/// Greatest number of pixels of a picture.
const MOST_PIXELS: u64 = 1 << 30;

/// Parses a picture size "WIDTHxHEIGHT".
pub fn size(text: &str) -> Result<(u32, u32), String> {
    let wanted = || "expected WIDTHxHEIGHT, each from 1 to 65536".to_string();
    let (w, h) = text.split_once(['x', 'X']).ok_or_else(wanted)?;
    match (w.parse(), h.parse()) {
        (Ok(w @ 1..=65536u32), Ok(h @ 1..=65536u32)) => match u64::from(w) * u64::from(h) {
            0..=MOST_PIXELS => Ok((w, h)),
            _ => Err(format!("too large: a picture has at most {MOST_PIXELS} pixels, for instance 32768x32768")),
        },
        _ => Err(wanted()),
    }
}

/// Prints one JSON object or the lines of text.
pub fn print(json: bool, value: &serde_json::Value, text: &str) -> Outcome {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    let written = if json { writeln!(out, "{value}") } else { writeln!(out, "{}", text.trim_end()) };
    written.map_err(Failure::Output)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_sizes_are_readable() {
        assert_eq!((counted(0, "block"), counted(1, "block")), ("0 blocks".into(), "1 block".into()));
        assert_eq!((each(84, 2), each(84, 0)), ("42.0 bytes per triangle".into(), "no triangles".into()));
    }

    #[test]
    fn sizes_and_counts() {
        assert_eq!(byte_size("4096"), Ok(4096));
        assert_eq!(byte_size("1K"), Ok(1024));
        assert_eq!(byte_size("1.5g"), Ok(3 << 29));
        assert_eq!(count("10M"), Ok(10_000_000));
        assert_eq!(point("1, -2,3e1"), Ok(DVec3::new(1.0, -2.0, 30.0)));
        assert_eq!(size("640x480"), Ok((640, 480)));
        for bad in ["", "1,2", "1,2,inf", "1x", "0x5", "70000x1"] {
            assert!(point(bad).is_err() && size(bad).is_err(), "{bad}");
        }
        for bad in ["", "K", "-1", "1X", "1é", "nan", "infK", "99999999T"] {
            assert!(byte_size(bad).is_err(), "{bad}");
        }
    }
}
