//! The one way for work that keeps a processor busy to leave the async runtime. A panic there becomes an
//! error here.

/// The work panicked.
#[derive(Debug, thiserror::Error)]
#[error("{0} panicked")]
pub struct Panicked(&'static str);

/// Run `work` on a thread that may block; `what` names it in errors.
///
/// # Errors
/// The work panicked.
pub async fn blocking<T: Send + 'static>(
    what: &'static str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Panicked> {
    tokio::task::spawn_blocking(work).await.map_err(|_| Panicked(what))
}

impl From<Panicked> for crate::error::Failure {
    fn from(panicked: Panicked) -> Self {
        crate::error::Failure::Internal(panicked.to_string())
    }
}

#[cfg(test)]
mod tests {
    #[tokio::test]
    async fn a_panic_becomes_an_error() {
        assert_eq!(super::blocking("adding", || 1 + 1).await.unwrap(), 2);
        let error = super::blocking("dividing", || -> u32 { panic!("by zero") }).await.unwrap_err();
        assert_eq!(error.to_string(), "dividing panicked");
    }
}
