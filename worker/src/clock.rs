//! Processor time of the calling thread.

/// Processor seconds that this thread has used. On systems that do not tell, seconds of wall time, which
/// are more where other programs compete for the processor.
#[cfg(unix)]
#[must_use]
pub fn thread_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Processor seconds that this thread has used. On systems that do not tell, seconds of wall time, which
/// are more where other programs compete for the processor.
#[cfg(not(unix))]
#[must_use]
pub fn thread_seconds() -> f64 {
    use std::{sync::OnceLock, time::Instant};
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn only_work_counts() {
        let start = thread_seconds();
        std::thread::sleep(std::time::Duration::from_millis(50));
        let slept = thread_seconds() - start;
        assert!(slept < 0.04, "{slept} s of processor time while asleep");
        let mut x = 1u64;
        while thread_seconds() - start < slept + 0.001 {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
    }
}
