//! The limit on numbers of threads, the same for contexts, builds and the command line.

use super::error::{Error, Result};

/// Number of processors that this process may use, at least 1.
pub fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Largest number of threads of a context or a build: four for each processor, but at least 64. More would only wait
/// for each other, and a machine stalls while it starts many thousands.
pub fn most() -> usize {
    (4 * processors()).max(64)
}

/// Bytes of address space of the stack of each thread that the library starts, whatever the default of the system or of
/// the variable `RUST_MIN_STACK` is. The system provides memory for the part that is used.
pub const STACK: usize = 2 << 20;

/// Returns a builder of a thread of the library.
pub fn named(name: String) -> std::thread::Builder {
    std::thread::Builder::new().name(name).stack_size(STACK)
}

/// Refuses a number of threads above the limit. `name`: name of the argument.
pub fn check(asked: usize, name: &str) -> Result<()> {
    let most = most();
    if asked <= most {
        return Ok(());
    }
    Err(Error::bad_argument(format!(
        "{name} is {asked}; on this machine it must be at most {most} (four for each processor, but at least 64)"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_is_a_few_times_the_processors_and_the_error_names_it() {
        assert!(most() >= 64 && most() >= 4 * processors() && most() <= 64 * processors());
        assert!(check(0, "threads").is_ok() && check(most(), "threads").is_ok());
        let error = check(99_999, "the option").unwrap_err().to_string();
        assert!(error.contains("the option is 99999") && error.contains(&most().to_string()), "{error}");
    }
}
