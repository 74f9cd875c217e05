//! The threads that render. Every piece of work that takes a processor goes through here, and a panic in
//! it comes back as an error.

use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicU8, AtomicU32, Ordering},
    },
    time::Instant,
};

use common::{
    protocol::UnitId,
    result::{UnitResult, UnitStatistics},
};
use tokio::sync::oneshot;
use tracer::{RowResult, UnitRender};

use crate::clock::thread_seconds;

/// A fixed number of threads that take work in the order it was given.
#[derive(Debug, Clone)]
pub struct Pool(Arc<rayon::ThreadPool>);

/// A unit that is rendered row by row.
pub trait RowRender: Sync {
    /// Number of rows.
    fn rows(&self) -> u32;
    /// Render one row.
    fn row(&self, row: u32) -> RowResult;
    /// Put all rows together.
    fn assemble(&self, rows: Vec<RowResult>) -> UnitResult;
}

impl RowRender for UnitRender<'_> {
    fn rows(&self) -> u32 {
        UnitRender::rows(self)
    }

    fn row(&self, row: u32) -> RowResult {
        UnitRender::row(self, row)
    }

    fn assemble(&self, rows: Vec<RowResult>) -> UnitResult {
        UnitRender::assemble(self, rows)
    }
}

/// How a unit ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// Rendered; with the column, row and number of the first sample that was not finite, if one was.
    Done(Box<UnitResult>, Option<[u32; 3]>),
    /// The tracer panicked, with this message.
    Failed(String),
    /// Not rendered, because the worker leaves.
    Returned,
    /// Not rendered, because nobody wants it any more.
    Cancelled,
}

/// What is asked of work in progress. Looked at before every row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wish {
    /// Render everything.
    GoOn,
    /// Finish units that are begun, hand back the rest.
    Finish,
    /// Hand back everything.
    Return,
    /// Drop everything.
    Cancel,
}

impl Pool {
    /// A pool of `threads` threads, at least one.
    ///
    /// # Errors
    /// The system gives no more threads.
    pub fn new(threads: usize) -> Result<Self, rayon::ThreadPoolBuildError> {
        let builder = rayon::ThreadPoolBuilder::new().num_threads(threads.max(1));
        builder.thread_name(|i| format!("render-{i}")).build().map(|pool| Self(Arc::new(pool)))
    }

    /// Number of threads.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.0.current_num_threads()
    }

    /// Run `work` on the pool, behind what was given before.
    ///
    /// # Errors
    /// The message of the panic, if `work` panics.
    pub async fn run<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Result<T, String> {
        let (answer, wait) = oneshot::channel();
        self.0.spawn_fifo(move || {
            // Nobody waits any more if this fails: the worker leaves.
            let _ = answer.send(guarded(work));
        });
        wait.await.unwrap_or_else(|_| Err("the render threads are gone".into()))
    }

    /// Run `work` on one of the threads, and what it does side by side on all of them. Blocks.
    pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.0.install(work)
    }

    /// Render units, all their rows side by side, and return when the last is done. `deliver` gets each
    /// unit's outcome as soon as it is known, on one of the threads. Blocks.
    pub fn render<R: RowRender>(
        &self,
        units: &[(UnitId, R)],
        wish: impl Fn() -> Wish + Sync,
        deliver: impl Fn(UnitId, Outcome) + Sync,
    ) {
        let progress: Vec<Progress> = units.iter().map(|(_, unit)| Progress::new(unit.rows())).collect();
        let (wish, deliver) = (&wish, &deliver);
        self.0.in_place_scope_fifo(|scope| {
            for ((id, unit), progress) in units.iter().zip(&progress) {
                for row in 0..unit.rows() {
                    scope.spawn_fifo(move |_| {
                        if let Some(outcome) = progress.render(unit, row, wish) {
                            deliver(*id, outcome);
                        }
                    });
                }
                if unit.rows() == 0 {
                    deliver(*id, Outcome::Failed("the unit has no rows".into()));
                }
            }
        });
    }
}

/// Run `work`; a panic becomes its message.
pub fn guarded<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    // What the closure borrowed is not looked at again after a panic, but to be dropped.
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic| message(&*panic))
}

fn message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    format!("the renderer panicked: {}", text.unwrap_or("it does not say why"))
}

const FRESH: u8 = 0;
const BEGUN: u8 = 1;
const RETURNED: u8 = 2;
const CANCELLED: u8 = 3;
const FAILED: u8 = 4;

/// How far a unit is, shared by the threads on its rows.
struct Progress {
    state: AtomicU8,
    left: AtomicU32,
    parts: Mutex<Parts>,
}

#[derive(Default)]
struct Parts {
    rows: Vec<Option<RowResult>>,
    began: Option<Instant>,
    panic: Option<String>,
}

impl Progress {
    fn new(rows: u32) -> Self {
        let parts = Parts { rows: vec![None; rows as usize], ..Default::default() };
        Self { state: AtomicU8::new(FRESH), left: AtomicU32::new(rows), parts: Mutex::new(parts) }
    }

    fn parts(&self) -> std::sync::MutexGuard<'_, Parts> {
        self.parts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether to render one more row, in view of what is wished.
    fn may_go_on(&self, wish: Wish) -> bool {
        let next = |state| match (state, wish) {
            (FRESH, Wish::GoOn) => Some(BEGUN),
            (FRESH, Wish::Finish | Wish::Return) | (BEGUN, Wish::Return) => Some(RETURNED),
            (FRESH | BEGUN, Wish::Cancel) => Some(CANCELLED),
            _ => None,
        };
        // The state is all that is shared here; the parts have a lock of their own.
        let _ = self.state.fetch_update(Ordering::Relaxed, Ordering::Relaxed, next);
        self.state.load(Ordering::Relaxed) == BEGUN
    }

    /// Render a row if it is still wanted. Whoever ends the last row gets the outcome.
    fn render(&self, unit: &impl RowRender, row: u32, wish: impl Fn() -> Wish) -> Option<Outcome> {
        if self.may_go_on(wish()) {
            let (start, cpu) = (Instant::now(), thread_seconds());
            self.parts().began.get_or_insert(start);
            match guarded(|| unit.row(row)) {
                Ok(mut result) => {
                    result.statistics.cpu_seconds = thread_seconds() - cpu;
                    self.parts().rows[row as usize] = Some(result);
                }
                Err(panic) => {
                    self.state.store(FAILED, Ordering::Relaxed);
                    self.parts().panic.get_or_insert(panic);
                }
            }
        }
        // AcqRel: the last one sees the state as every other row left it.
        (self.left.fetch_sub(1, Ordering::AcqRel) == 1).then(|| self.outcome(unit))
    }

    fn outcome(&self, unit: &impl RowRender) -> Outcome {
        let Parts { rows, began, panic } = std::mem::take(&mut *self.parts());
        match self.state.load(Ordering::Relaxed) {
            RETURNED => Outcome::Returned,
            CANCELLED => Outcome::Cancelled,
            _ => match (panic, rows.into_iter().collect::<Option<Vec<RowResult>>>()) {
                (None, Some(rows)) => {
                    let rejected = rows.iter().find_map(|row| row.first_rejected);
                    match guarded(|| unit.assemble(rows)) {
                        Ok(mut result) => {
                            let wall_seconds = began.map_or(0.0, |began| began.elapsed().as_secs_f64());
                            result.statistics = UnitStatistics { wall_seconds, ..result.statistics };
                            Outcome::Done(Box::new(result), rejected)
                        }
                        Err(panic) => Outcome::Failed(panic),
                    }
                }
                (panic, _) => Outcome::Failed(panic.unwrap_or_else(|| "a row of the unit was lost".into())),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, sync::atomic::AtomicUsize};

    use common::{
        film::{Film, Moments},
        job::JobId,
        tile::Rect,
    };

    use super::*;

    struct Fake<'a> {
        rect: Rect,
        row: &'a (dyn Fn(u32) + Sync),
    }

    impl RowRender for Fake<'_> {
        fn rows(&self) -> u32 {
            self.rect.h
        }

        fn row(&self, row: u32) -> RowResult {
            (self.row)(row);
            let moments = vec![Moments::batch(1, [f64::from(row); 3])];
            RowResult { moments, features: Vec::new(), statistics: UnitStatistics::default(), first_rejected: None }
        }

        fn assemble(&self, rows: Vec<RowResult>) -> UnitResult {
            let moments = rows.into_iter().flat_map(|row| row.moments).collect();
            let film = Film { moments, ..Default::default() };
            UnitResult { rect: self.rect, film, statistics: UnitStatistics::default() }
        }
    }

    /// Render two units of `rows` rows each with `row`, and return what became of them.
    fn outcomes(
        threads: usize,
        rows: u32,
        row: impl Fn(u32) + Sync,
        wish: impl Fn() -> Wish + Sync,
    ) -> BTreeMap<u32, Outcome> {
        let rect = Rect { x: 0, y: 0, w: 1, h: rows };
        let id = |tile| UnitId { job: JobId(1), frame: 1, tile, pass: 0, rect };
        let units: Vec<_> = (0..2).map(|tile| (id(tile), Fake { rect, row: &row })).collect();
        let found = Mutex::new(BTreeMap::new());
        Pool::new(threads).unwrap().render(&units, wish, |id, outcome| {
            assert_eq!(found.lock().unwrap().insert(id.tile, outcome), None, "one outcome a unit");
        });
        found.into_inner().unwrap()
    }

    #[test]
    fn rows_are_put_together_in_order_whoever_rendered_them() {
        for threads in [1, 2, 5] {
            let found = outcomes(threads, 40, |_| (), || Wish::GoOn);
            for tile in 0..2 {
                let Outcome::Done(result, _) = &found[&tile] else { panic!("{found:?}") };
                let order: Vec<f64> = result.film.moments.iter().map(|m| m.mean[0]).collect();
                assert_eq!(order, (0..40).map(f64::from).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn a_panic_fails_its_unit_and_spares_the_threads() {
        let rows = AtomicUsize::new(0);
        let row = |row| {
            rows.fetch_add(1, Ordering::Relaxed);
            assert!(row != 3, "row {row} is cursed");
        };
        let found = outcomes(1, 10, row, || Wish::GoOn);
        let Outcome::Failed(message) = &found[&0] else { panic!("{found:?}") };
        assert!(message.contains("row 3 is cursed"), "{message}");
        assert!(matches!(found[&1], Outcome::Failed(_)));
        assert_eq!(rows.into_inner(), 8, "rows after the panic are left alone");
    }

    #[test]
    fn begun_units_are_finished_and_others_handed_back() {
        // One thread: when the wish turns, the first unit is in its third row and the second is untouched.
        let rows = AtomicUsize::new(0);
        let count = |_| {
            rows.fetch_add(1, Ordering::Relaxed);
        };
        for (wish, first, second, rendered) in [
            (Wish::Finish, None, Outcome::Returned, 10),
            (Wish::Return, Some(Outcome::Returned), Outcome::Returned, 3),
            (Wish::Cancel, Some(Outcome::Cancelled), Outcome::Cancelled, 3),
        ] {
            rows.store(0, Ordering::Relaxed);
            let wish = || if rows.load(Ordering::Relaxed) < 3 { Wish::GoOn } else { wish };
            let found = outcomes(1, 10, count, wish);
            match first {
                Some(first) => assert_eq!(found[&0], first),
                None => assert!(matches!(found[&0], Outcome::Done(..))),
            }
            assert_eq!(found[&1], second);
            assert_eq!(rows.load(Ordering::Relaxed), rendered);
        }
    }

    #[tokio::test]
    async fn work_beside_units_runs_here_too_and_may_panic() {
        let pool = Pool::new(2).unwrap();
        assert_eq!(pool.run(|| 6 * 7).await, Ok(42));
        let error = pool.run(|| -> u32 { panic!("no") }).await.unwrap_err();
        assert_eq!(error, "the renderer panicked: no");
        assert_eq!(pool.run(|| 1).await, Ok(1));
    }
}
