//! Keeps asking a coordinator that is away, ever more slowly, and says so once.

use std::{
    future::Future,
    sync::Mutex,
    time::{Duration, Instant},
};

use crate::endpoint::{CallError, Endpoint};

/// Pause after the first failure.
const FIRST: Duration = Duration::from_millis(100);
/// Longest pause.
const LONGEST: Duration = Duration::from_secs(5);

/// A coordinator, and whether it answered last time.
#[derive(Debug)]
pub struct Link {
    /// The coordinator.
    pub endpoint: Endpoint,
    /// Since when nobody answers.
    away: Mutex<Option<Instant>>,
}

impl Link {
    /// A coordinator that is believed to be there.
    #[must_use]
    pub fn new(endpoint: Endpoint) -> Self {
        Self { endpoint, away: Mutex::new(None) }
    }

    /// Call until there is an answer, be it a refusal. The first failure is logged, the next ones are
    /// not, and the first answer after them is.
    ///
    /// # Errors
    /// The errors that are not [transient](CallError::is_transient).
    pub async fn persist<T, F>(&self, mut call: impl FnMut() -> F) -> Result<T, CallError>
    where
        F: Future<Output = Result<T, CallError>>,
    {
        let mut backoff = Backoff::default();
        loop {
            match call().await {
                Err(error) if error.is_transient() => self.note_away(&error),
                answer => {
                    self.note_back();
                    return answer;
                }
            }
            tokio::time::sleep(backoff.pause()).await;
        }
    }

    fn note_away(&self, error: &CallError) {
        let mut away = self.away.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if away.is_none() {
            *away = Some(Instant::now());
            tracing::warn!("{error}; trying again until it answers");
        }
    }

    fn note_back(&self) {
        let mut away = self.away.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(since) = away.take() {
            let seconds = since.elapsed().as_secs_f64();
            tracing::info!("{} answers again after {seconds:.1} s", self.endpoint.url());
        }
    }
}

/// Pauses between attempts: doubling from 0.1 s to 5 s, each shortened by up to half at random so that
/// workers which lost their coordinator together do not return together.
#[derive(Debug)]
pub struct Backoff {
    next: Duration,
    random: u64,
}

impl Default for Backoff {
    fn default() -> Self {
        Self { next: FIRST, random: entropy() }
    }
}

impl Backoff {
    /// How long to wait before the next attempt.
    pub fn pause(&mut self) -> Duration {
        // xorshift64*: any spread will do here.
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        let share = (self.random.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64;
        let pause = self.next.mul_f64(1.0 - 0.5 * share);
        self.next = (self.next * 2).min(LONGEST);
        pause
    }
}

/// 64 bits that differ between processes and calls, and are never 0. Not for secrets.
#[must_use]
pub fn entropy() -> u64 {
    use std::hash::{BuildHasher, RandomState};
    RandomState::new().hash_one(std::process::id()) | 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_up_to_the_longest_and_differ_between_workers() {
        let mut backoff = Backoff::default();
        let pauses: Vec<f64> = (0..10).map(|_| backoff.pause().as_secs_f64()).collect();
        for (i, pause) in pauses.iter().enumerate() {
            let full = (0.1 * f64::from(1 << i)).min(5.0);
            assert!((0.5 * full..=full).contains(pause), "{pauses:?}");
        }
        assert_ne!(Backoff::default().pause(), Backoff::default().pause());
    }
}
