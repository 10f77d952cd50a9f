//! What the verbs share: failures, sizes, counts and points in arguments, Ctrl-C, progress bars.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use outcrop::base::progress::Cancel;
use std::fmt;
use std::time::Duration;

/// What a verb returns.
pub type Outcome = Result<(), Failure>;

/// Why a verb ended without its result.
#[derive(Debug)]
pub enum Failure {
    /// The work failed.
    Failed(outcrop::Error),
    /// Standard output is gone.
    Output(std::io::Error),
    /// The arguments make no sense together.
    Usage(String),
}

impl Failure {
    /// The process's exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Failure::Usage(_) | Failure::Failed(outcrop::Error::BadArgument(_)) => 2,
            Failure::Failed(_) | Failure::Output(_) => 1,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Failed(e) => e.fmt(f),
            Failure::Output(e) => write!(f, "standard output: {e}"),
            Failure::Usage(what) => f.write_str(what),
        }
    }
}

impl From<outcrop::Error> for Failure {
    fn from(e: outcrop::Error) -> Self {
        Failure::Failed(e)
    }
}

/// Parses a size in bytes: digits, then optionally K, M, G or T (powers of 1024).
pub fn byte_size(text: &str) -> Result<u64, String> {
    scaled(text, 1024)
}

/// Parses a count: digits, then optionally K, M or G (powers of 1000).
pub fn count(text: &str) -> Result<u64, String> {
    scaled(text, 1000)
}

fn scaled(text: &str, thousand: u64) -> Result<u64, String> {
    let (digits, power) = match text.char_indices().next_back() {
        Some((at, suffix)) if !suffix.is_ascii_digit() => {
            let power = "KMGT".find(suffix.to_ascii_uppercase()).ok_or(format!("unknown suffix {suffix:?}"))?;
            (&text[..at], power as u32 + 1)
        }
        _ => (text, 0),
    };
    let number: f64 = digits.parse().map_err(|_| format!("{digits:?} is no number"))?;
    let value = number * (thousand as f64).powi(power as i32);
    if value.is_finite() && (0.0..9e18).contains(&value) { Ok(value as u64) } else { Err("out of range".into()) }
}

/// A switch that Ctrl-C throws; a second Ctrl-C ends the process at once.
pub fn cancel_on_ctrl_c() -> Cancel {
    let cancel = Cancel::new();
    let switch = cancel.clone();
    // Without a handler Ctrl-C kills: temporaries may stay, nothing else is lost.
    let _ = ctrlc::set_handler(move || {
        if switch.is_cancelled() {
            std::process::exit(130);
        }
        switch.cancel();
    });
    cancel
}

/// A bar on stderr if that is a terminal, else nothing. `total` in `unit`s.
pub fn progress_bar(total: u64, unit: &str, quiet: bool) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(8) };
    let bar = ProgressBar::with_draw_target(Some(total), target);
    let template = format!("{{msg:8}} {{bar:40}} {{percent:>3}} %  {{human_pos}} {unit}, {{eta}} left");
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

/// Prints one JSON object, or the lines of text.
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
    fn sizes_and_counts() {
        assert_eq!(byte_size("4096"), Ok(4096));
        assert_eq!(byte_size("1K"), Ok(1024));
        assert_eq!(byte_size("1.5g"), Ok(3 << 29));
        assert_eq!(count("10M"), Ok(10_000_000));
        for bad in ["", "K", "-1", "1X", "1é", "nan", "infK", "99999999T"] {
            assert!(byte_size(bad).is_err(), "{bad}");
        }
    }
}
