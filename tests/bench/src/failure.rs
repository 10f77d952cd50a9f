//! Why a command ended without its result.

use std::fmt;

/// What to tell the user.
#[derive(Debug)]
pub struct Failure(String);

/// What a command returns.
pub type Outcome = Result<(), Failure>;

impl Failure {
    pub fn new(what: impl Into<String>) -> Self {
        Self(what.into())
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl From<outcrop::Error> for Failure {
    fn from(e: outcrop::Error) -> Self {
        Self(e.to_string())
    }
}

impl From<std::io::Error> for Failure {
    fn from(e: std::io::Error) -> Self {
        Self(e.to_string())
    }
}

impl From<String> for Failure {
    fn from(what: String) -> Self {
        Self(what)
    }
}
