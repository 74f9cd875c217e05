//! Jobs, frames, tiles and passes: their states, and how one follows from the other.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use common::{
    job::{JobState, LeaseId, WorkerId},
    pass::{PREPARE_PASS, Work},
    tile::Rect,
};

use super::{Effect, JobSpec, TileKey, TileProgress};

/// Check a change of a job's state.
///
/// # Errors
/// One sentence that says why it cannot be.
pub fn transition(from: JobState, to: JobState) -> Result<JobState, String> {
    use JobState::{Active, Canceled, Completed, Failed, Paused, Queued};
    match (from, to) {
        (Queued, Active) => Ok(to),
        (Queued | Active, Paused) | (Paused, Queued) => Ok(to),
        // Work that was out when the job was held back, or before a restart, may complete it.
        (Queued | Active | Paused, Completed | Failed | Canceled) => Ok(to),
        // Tried again from what it has; or continued to a finer target.
        (Failed | Canceled | Completed, Queued) => Ok(to),
        (from, to) => Err(format!("the job is {from} and cannot become {to}")),
    }
}

/// Something counted per second, over the last so many seconds.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Rate<const SECONDS: u32 = 5> {
    value: f64,
    at: f64,
}

impl<const SECONDS: u32> Rate<SECONDS> {
    pub(super) fn add(&mut self, amount: f64, now: f64) {
        *self = Rate { value: self.get(now) + amount / f64::from(SECONDS), at: now };
    }

    pub(super) fn get(&self, now: f64) -> f64 {
        self.value * libm::exp(-(now - self.at).max(0.0) / f64::from(SECONDS))
    }

    /// The same of something that began only at `began`: what came before counts as alike, not as nothing.
    pub(super) fn since(&self, began: f64, now: f64) -> f64 {
        let known = -libm::expm1(-(now - began).max(0.0) / f64::from(SECONDS));
        if known > 0.0 { self.get(now) / known } else { 0.0 }
    }
}

/// Measured cost, with the past fading.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cost {
    seconds: f64,
    samples: f64,
    pixels: f64,
}

impl Cost {
    const MEMORY: f64 = 0.95;

    pub(super) fn add(&mut self, seconds: f64, samples: f64, pixels: f64) {
        self.seconds = self.seconds * Self::MEMORY + seconds;
        self.samples = self.samples * Self::MEMORY + samples;
        self.pixels = self.pixels * Self::MEMORY + pixels;
    }

    /// Processor seconds of a sample.
    pub(super) fn per_sample(&self) -> Option<f64> {
        (self.samples > 0.0).then(|| self.seconds / self.samples)
    }

    /// Samples of a pixel.
    pub(super) fn samples_per_pixel(&self) -> Option<f64> {
        (self.pixels > 0.0).then(|| self.samples / self.pixels)
    }
}

#[derive(Debug)]
pub(super) struct Job {
    pub(super) spec: JobSpec,
    pub(super) state: JobState,
    pub(super) message: Option<String>,
    pub(super) frames: Vec<Frame>,
    /// All frames before this index are done.
    pub(super) first: usize,
    /// Frames that are not done.
    pub(super) left: usize,
    /// Processor seconds leased so far, as the fair share counts them.
    pub(super) served: f64,
    pub(super) cost: Cost,
    pub(super) samples: Rate,
    pub(super) retries: u64,
    /// Processor seconds of all results since it came here.
    pub(super) delivered: f64,
    /// Time, progress and processor seconds over the last seconds, for the time that is left.
    pub(super) history: VecDeque<(f64, f64, f64)>,
}

#[derive(Debug)]
pub(super) struct Frame {
    pub(super) number: u32,
    pub(super) stage: Stage,
}

#[derive(Debug)]
pub(super) enum Stage {
    /// Not begun here; what was stored of it.
    Waiting(BTreeMap<u32, TileProgress>),
    Open(Open),
    Done,
}

/// A frame being rendered.
#[derive(Debug)]
pub(super) struct Open {
    pub(super) tiles: Vec<Tile>,
    /// Pieces to be leased, as (pass, tile, piece): all first passes first.
    pub(super) pending: BTreeSet<(u32, u32, u32)>,
    /// Tiles that are not finished.
    pub(super) unfinished: u32,
    /// Tiles whose next pass is being planned.
    pub(super) planning: u32,
    /// Whether it is finished and being measured.
    pub(super) measuring: bool,
    /// Sum over tiles of area x share done.
    pub(super) done: f64,
}

#[derive(Debug)]
pub(super) struct Tile {
    pub(super) rect: Rect,
    pub(super) passes: u32,
    pub(super) share: f64,
    pub(super) attempts: u32,
    pub(super) worker: Option<WorkerId>,
    pub(super) cost: Option<f64>,
    pub(super) phase: Phase,
    /// Parts stored before a restart, until the pass is planned again.
    pub(super) parts: Option<(usize, Vec<Rect>)>,
}

#[derive(Debug, Default)]
pub(super) enum Phase {
    /// The next pass waits for neighbours.
    #[default]
    Waiting,
    /// The next pass is being planned.
    Planning,
    Running(Running),
    Finished,
}

/// A pass being rendered.
#[derive(Debug)]
pub(super) struct Running {
    pub(super) work: Work,
    pub(super) share: f64,
    /// Pixels of a piece, where the tile is split.
    pub(super) split: Option<usize>,
    /// In row order.
    pub(super) pieces: Vec<Piece>,
    /// Pieces that are stored.
    pub(super) saved: usize,
}

#[derive(Debug)]
pub(super) struct Piece {
    pub(super) rect: Rect,
    pub(super) state: PieceState,
    /// Leases that hold it now.
    pub(super) holders: Vec<LeaseId>,
    /// Workers it failed on, each once.
    pub(super) failed_on: Vec<WorkerId>,
    pub(super) failures: u32,
    pub(super) lost: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PieceState {
    Pending,
    Leased,
    Saving,
    Saved,
}

impl Piece {
    pub(super) fn new(rect: Rect) -> Self {
        Piece { rect, state: PieceState::Pending, holders: Vec::new(), failed_on: Vec::new(), failures: 0, lost: 0 }
    }

    /// Whether it went wrong before: it is then leased alone, so that it takes no other unit with it.
    pub(super) fn suspicious(&self) -> bool {
        self.failures > 0 || self.lost > 0
    }
}

impl Running {
    pub(super) fn piece(&self, rect: Rect) -> Option<usize> {
        let found = self.pieces.binary_search_by_key(&(rect.y, rect.x), |piece| (piece.rect.y, piece.rect.x)).ok()?;
        (self.pieces[found].rect == rect).then_some(found)
    }
}

impl Job {
    pub(super) fn new(spec: JobSpec, state: JobState, served: f64) -> Self {
        let frames =
            spec.frames.iter().map(|&number| Frame { number, stage: Stage::Waiting(BTreeMap::new()) }).collect();
        Job {
            left: spec.frames.len(),
            spec,
            state,
            message: None,
            frames,
            first: 0,
            served,
            cost: Cost::default(),
            samples: Rate::default(),
            retries: 0,
            delivered: 0.0,
            history: VecDeque::new(),
        }
    }

    pub(super) fn frame_index(&self, number: u32) -> Option<usize> {
        self.frames.binary_search_by_key(&number, |frame| frame.number).ok()
    }

    pub(super) fn open_mut(&mut self, number: u32) -> Option<&mut Open> {
        let index = self.frame_index(number)?;
        match &mut self.frames[index].stage {
            Stage::Open(open) => Some(open),
            _ => None,
        }
    }

    pub(super) fn open_ref(&self, number: u32) -> Option<&Open> {
        match &self.frames[self.frame_index(number)?].stage {
            Stage::Open(open) => Some(open),
            _ => None,
        }
    }

    /// Whether leases may be cut from it.
    pub(super) fn runnable(&self) -> bool {
        matches!(self.state, JobState::Queued | JobState::Active)
    }

    pub(super) fn set(&mut self, to: JobState, out: &mut Vec<Effect>) -> Result<(), String> {
        self.state = transition(self.state, to)?;
        out.push(Effect::JobChanged(self.spec.id));
        Ok(())
    }

    /// Begin a frame: its tiles ask to be planned. More than one pass may be behind them.
    pub(super) fn open(&mut self, index: usize, out: &mut Vec<Effect>) {
        let Job { spec, frames, .. } = self;
        let Stage::Waiting(stored) = &mut frames[index].stage else { return };
        let mut stored = std::mem::take(stored);
        let count = spec.grid.count();
        let mut open = Open {
            tiles: Vec::with_capacity(count as usize),
            pending: BTreeSet::new(),
            unfinished: 0,
            planning: 0,
            measuring: false,
            done: 0.0,
        };
        for (index, rect) in (0..count).filter_map(|i| spec.grid.rect(i).map(|rect| (i, rect))) {
            let TileProgress { passes, share, finished, attempts, worker, parts } =
                stored.remove(&index).unwrap_or_default();
            let phase = if finished { Phase::Finished } else { Phase::Waiting };
            open.unfinished += u32::from(!finished);
            open.done += rect.area() as f64 * share;
            open.tiles.push(Tile { rect, passes, share, attempts, worker, cost: None, phase, parts });
        }
        // One unit comes before all others: it stands in the place of the first tile's passes.
        if let (Some(trial), Some(tile)) = (&spec.prepare, open.tiles.first_mut()) {
            let work = Work::Prepare { trial: trial.clone() };
            tile.passes = PREPARE_PASS;
            tile.phase = Phase::Running(Running {
                work,
                share: 0.0,
                split: None,
                pieces: vec![Piece::new(tile.rect)],
                saved: 0,
            });
            open.pending.insert((PREPARE_PASS, 0, 0));
            frames[index].stage = Stage::Open(open);
            return;
        }
        frames[index].stage = Stage::Open(open);
        let number = frames[index].number;
        for tile in 0..count {
            self.plan_if_ready(number, tile, out);
        }
        self.measure_if_finished(number, out);
    }

    /// The job is prepared: its open frames begin. Returns the leases that were out to prepare it.
    pub(super) fn prepared(&mut self, out: &mut Vec<Effect>) -> Vec<LeaseId> {
        let mut holders = Vec::new();
        if self.spec.prepare.take().is_none() {
            return holders;
        }
        let mut numbers = Vec::new();
        for frame in &mut self.frames {
            let Stage::Open(open) = &mut frame.stage else { continue };
            numbers.push(frame.number);
            open.pending.clear();
            let Some(first) = open.tiles.first_mut() else { continue };
            if let Phase::Running(running) = std::mem::take(&mut first.phase) {
                holders.extend(running.pieces.iter().flat_map(|piece| &piece.holders));
            }
            first.passes = 0;
        }
        for number in numbers {
            for tile in 0..self.spec.grid.count() {
                self.plan_if_ready(number, tile, out);
            }
        }
        holders
    }

    /// Ask for the plan of a tile's next pass, if nothing holds it back.
    fn plan_if_ready(&mut self, frame: u32, tile: u32, out: &mut Vec<Effect>) {
        let (gated, grid, id) = (self.spec.gated, self.spec.grid, self.spec.id);
        let Some(open) = self.open_mut(frame) else { return };
        let this = &open.tiles[tile as usize];
        if !matches!(this.phase, Phase::Waiting) {
            return;
        }
        let passes = this.passes;
        let behind = |&neighbour: &u32| {
            let other = &open.tiles[neighbour as usize];
            other.passes < passes && !matches!(other.phase, Phase::Finished)
        };
        if gated && passes > 0 && grid.neighbours(tile).iter().any(behind) {
            return;
        }
        open.tiles[tile as usize].phase = Phase::Planning;
        open.planning += 1;
        out.push(Effect::Plan(TileKey { job: id, frame, tile }, passes));
    }

    /// A tile went on: it and those that waited for it may be planned.
    pub(super) fn plan_around(&mut self, frame: u32, tile: u32, out: &mut Vec<Effect>) {
        self.plan_if_ready(frame, tile, out);
        if self.spec.gated {
            for neighbour in self.spec.grid.neighbours(tile) {
                self.plan_if_ready(frame, neighbour, out);
            }
        }
    }

    /// Have a frame measured whose tiles are all finished.
    pub(super) fn measure_if_finished(&mut self, number: u32, out: &mut Vec<Effect>) {
        let id = self.spec.id;
        let Some(open) = self.open_mut(number) else { return };
        if open.unfinished == 0 && !open.measuring {
            open.measuring = true;
            out.push(Effect::Measure(id, number));
        }
    }

    /// A finished frame has been measured: it is done, and with the last one the job.
    pub(super) fn frame_measured(&mut self, number: u32, out: &mut Vec<Effect>) {
        let Some(index) = self.frame_index(number) else { return };
        if !matches!(&self.frames[index].stage, Stage::Open(open) if open.measuring) {
            return;
        }
        self.frames[index].stage = Stage::Done;
        self.left -= 1;
        self.skip_done();
        out.push(Effect::FrameDone(self.spec.id, number));
        if self.left == 0 {
            // A state from which it cannot complete is a final one, and it stays as it is.
            let _ = self.set(JobState::Completed, out);
        }
    }

    /// A finished frame is gone over again.
    pub(super) fn reopen_frame(&mut self, number: u32, passes: u32, out: &mut Vec<Effect>) {
        let Some(open) = self.open_mut(number) else { return };
        if !std::mem::take(&mut open.measuring) {
            return;
        }
        open.unfinished = open.tiles.len() as u32;
        for tile in &mut open.tiles {
            (tile.passes, tile.phase, tile.parts) = (passes, Phase::Waiting, None);
        }
        for tile in 0..open.tiles.len() as u32 {
            self.plan_if_ready(number, tile, out);
        }
    }

    pub(super) fn skip_done(&mut self) {
        while self.frames.get(self.first).is_some_and(|frame| matches!(frame.stage, Stage::Done)) {
            self.first += 1;
        }
    }

    /// Share of the work done, 0 to 1.
    pub(super) fn progress(&self) -> f64 {
        let sum: f64 = self.frames.iter().map(|frame| self.frame_progress(frame)).sum();
        sum / self.frames.len().max(1) as f64
    }

    pub(super) fn frame_progress(&self, frame: &Frame) -> f64 {
        let all: f64 = self.spec.grid.region().area() as f64;
        match &frame.stage {
            Stage::Done => 1.0,
            Stage::Open(open) => (open.done / all).clamp(0.0, 1.0),
            Stage::Waiting(stored) => {
                let area = |index| self.spec.grid.rect(index).map_or(0.0, |rect| rect.area() as f64);
                stored.iter().map(|(&index, tile)| area(index) * tile.share).sum::<f64>() / all
            }
        }
    }

    /// Note the progress, for the time that is left.
    pub(super) fn meter(&mut self, now: f64) {
        const WINDOW: f64 = 20.0;
        if self.state != JobState::Active {
            self.history.clear();
            return;
        }
        if self.history.back().is_some_and(|&(at, ..)| now - at < 0.5) {
            return;
        }
        let progress = self.progress();
        self.history.push_back((now, progress, self.delivered));
        while self.history.front().is_some_and(|&(at, ..)| now - at > WINDOW) {
            self.history.pop_front();
        }
    }
}

impl Job {
    /// Forget every failed attempt: somebody wants it tried again.
    pub(super) fn forgive(&mut self) {
        for frame in &mut self.frames {
            let Stage::Open(open) = &mut frame.stage else { continue };
            for tile in &mut open.tiles {
                let Phase::Running(running) = &mut tile.phase else { continue };
                for piece in &mut running.pieces {
                    piece.failed_on.clear();
                    piece.failures = 0;
                    piece.lost = 0;
                }
            }
        }
    }
}
