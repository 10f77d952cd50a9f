//! The option `-o` of all commands: a file of the command's format, or standard output.

use crate::common::{self, Failure, Outcome};
use outcrop::base::output;
use serde_json::Value;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};

/// Where the output of a command goes.
pub enum Destination {
    File(PathBuf),
    /// Standard output, `-o -`. The report of the command then goes to stderr.
    Stdout,
}

impl Destination {
    /// Checks the value of `-o` before any work is done. `suffix`: suffix of the command's only format. `kind`: the
    /// kind of file. `inputs`: files that must not be overwritten. `streams`: true if the command can write to standard
    /// output.
    pub fn new(path: &Path, suffix: &str, kind: &str, inputs: &[&Path], streams: bool) -> Result<Self, Failure> {
        let refuse = |why: String| Err(Failure::Usage(format!("--output {}: {why}", path.display())));
        if path.as_os_str() == "-" {
            return match streams {
                false => refuse(format!("{kind} cannot be written to standard output; name a file")),
                true if std::io::stdout().is_terminal() => {
                    refuse("standard output is a terminal; redirect it to a file or a pipe".into())
                }
                true => Ok(Self::Stdout),
            };
        }
        if !path.extension().is_some_and(|found| found.eq_ignore_ascii_case(suffix)) {
            return refuse(format!("the name of {kind} must end with .{suffix}, the only format that is written"));
        }
        output::check(path, inputs)?;
        Ok(Self::File(path.to_path_buf()))
    }

    /// Prints the report of the command: one JSON object or the lines of text.
    pub fn report(&self, json: bool, value: &Value, text: &str) -> Outcome {
        match self {
            Self::File(_) => common::print(json, value, text),
            Self::Stdout if json => writeln!(std::io::stderr(), "{value}").map_err(Failure::Output),
            Self::Stdout => writeln!(std::io::stderr(), "{}", text.trim_end()).map_err(Failure::Output),
        }
    }
}
