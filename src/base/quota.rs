//! A limit of the bytes that some work has on the disk.

use super::error::{Error, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Counts the bytes of an output and of scratch files at any time. Copies share one count. The default has no limit.
#[derive(Debug, Clone, Default)]
pub struct Quota(Option<Arc<(u64, AtomicU64)>>);

impl Quota {
    /// A limit in bytes; 0 for none.
    pub fn new(most: u64) -> Self {
        Self((most > 0).then(|| Arc::new((most, AtomicU64::new(0)))))
    }

    /// Counts bytes that are about to be written. Fails with [`Error::OverLimit`] if they do not fit.
    pub fn take(&self, bytes: u64) -> Result<()> {
        let Some((most, used)) = self.0.as_deref() else { return Ok(()) };
        let fits = |used: u64| used.checked_add(bytes).filter(|used| used <= most);
        let what = "bytes of the model and its temporary files";
        let over = |_| Error::OverLimit { what, most: *most, limit: "max_bytes" };
        used.fetch_update(Relaxed, Relaxed, fits).map(drop).map_err(over)
    }

    /// Uncounts bytes that were removed.
    pub fn give(&self, bytes: u64) {
        if let Some((_, used)) = self.0.as_deref() {
            used.fetch_sub(bytes, Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_beyond_the_limit_are_refused_and_not_counted() {
        let quota = Quota::new(100);
        quota.take(60).unwrap();
        let error = quota.clone().take(41).unwrap_err().to_string();
        assert_eq!(error, "bytes of the model and its temporary files: more than 100, the limit max_bytes");
        quota.take(40).unwrap();
        assert!(quota.take(u64::MAX).is_err());
        quota.give(60);
        quota.take(60).unwrap();
        Quota::new(0).take(u64::MAX).unwrap();
    }
}
