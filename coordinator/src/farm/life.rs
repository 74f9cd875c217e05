//! A job's life: submitted, restored, told what to do, planned pass by pass, merged, and ended.

use std::collections::BTreeMap;

use common::{
    job::{JobId, JobState},
    pass::PREPARE_PASS,
};

use super::{
    Command, Effect, Farm, JobSpec, Plan, Restored, TileKey,
    job::{Job, Phase, Piece, PieceState, Running, Stage},
    lease::UnitRef,
};

impl Farm {
    pub(super) fn submit(&mut self, spec: JobSpec, now: f64, out: &mut Vec<Effect>) {
        let restored =
            Restored { spec, state: JobState::Queued, message: None, done: Vec::new(), tiles: BTreeMap::new() };
        self.restore(restored, now, out);
    }

    pub(super) fn restore(&mut self, restored: Restored, _now: f64, out: &mut Vec<Effect>) {
        let Restored { spec, state, message, done, tiles } = restored;
        let id = spec.id;
        self.drop_leases(id);
        let served = self.least_served();
        let mut job = Job::new(spec, state, served);
        job.message = message;
        for number in done {
            if let Some(index) = job.frame_index(number) {
                job.left -= usize::from(!matches!(job.frames[index].stage, Stage::Done));
                job.frames[index].stage = Stage::Done;
            }
        }
        for ((frame, tile), progress) in tiles {
            if let Some(index) = job.frame_index(frame)
                && let Stage::Waiting(stored) = &mut job.frames[index].stage
            {
                stored.insert(tile, progress);
            }
        }
        job.skip_done();
        if job.left == 0 && !job.state.is_final() {
            let _ = job.set(JobState::Completed, out);
        }
        self.jobs.insert(id, job);
        self.stirred = true;
        out.push(Effect::JobChanged(id));
    }

    /// What a job that starts now has been served, so that it neither starves the others nor is starved.
    fn least_served(&self) -> f64 {
        let running = self.jobs.values().filter(|job| job.runnable()).map(|job| job.served);
        let least = running.fold(f64::INFINITY, f64::min);
        if least.is_finite() { least } else { 0.0 }
    }

    pub(super) fn command(&mut self, id: JobId, command: Command, _now: f64, out: &mut Vec<Effect>) {
        let least = self.least_served();
        let Some(job) = self.jobs.get_mut(&id) else {
            out.push(Effect::UnknownJob(id));
            return;
        };
        let changed = match command {
            Command::Cancel => job.set(JobState::Canceled, out),
            Command::Pause => job.set(JobState::Paused, out),
            Command::Resume if job.state != JobState::Paused => {
                Err(format!("the job is {} and cannot be resumed", job.state))
            }
            Command::Requeue if !matches!(job.state, JobState::Failed | JobState::Canceled) => {
                Err(format!("the job is {}; only a failed or canceled one can be tried again", job.state))
            }
            Command::Resume | Command::Requeue => job.set(JobState::Queued, out),
            Command::Priority(priority) => {
                job.spec.priority = priority;
                out.push(Effect::JobChanged(id));
                Ok(())
            }
            Command::Remove if !job.state.is_final() => {
                Err(format!("the job is {}; cancel it before it is deleted", job.state))
            }
            Command::Remove => Ok(()),
        };
        if let Err(message) = changed {
            out.push(Effect::Conflict(message));
            return;
        }
        match command {
            Command::Cancel => self.drop_leases(id),
            Command::Remove => {
                self.drop_leases(id);
                self.jobs.remove(&id);
            }
            Command::Resume => job.served = job.served.max(least),
            Command::Requeue => {
                job.message = None;
                job.served = job.served.max(least);
                job.forgive();
            }
            Command::Pause | Command::Priority(_) => {}
        }
        self.stirred = true;
    }

    pub(super) fn planned(&mut self, plan: Plan, out: &mut Vec<Effect>) {
        let Plan { tile: key, pass, work } = plan;
        let Some(job) = self.jobs.get_mut(&key.job) else { return };
        let Some(open) = job.open_mut(key.frame) else { return };
        let Some(tile) = open.tiles.get_mut(key.tile as usize) else { return };
        if !matches!(tile.phase, Phase::Planning) || tile.passes != pass {
            return;
        }
        open.planning -= 1;
        let Some((work, share)) = work else {
            tile.phase = Phase::Finished;
            let area = tile.rect.area() as f64;
            open.done += area * (1.0 - tile.share);
            tile.share = 1.0;
            open.unfinished -= 1;
            out.push(Effect::TileFinished(key));
            job.plan_around(key.frame, key.tile, out);
            job.measure_if_finished(key.frame, out);
            return;
        };
        let rect = tile.rect;
        let mut running = Running { work, share, split: None, pieces: vec![Piece::new(rect)], saved: 0 };
        if let Some((split, rects)) = tile.parts.take() {
            running.split = Some(split);
            running.pieces = rect.split(split).into_iter().map(Piece::new).collect();
            for rect in rects {
                if let Some(found) = running.piece(rect) {
                    running.pieces[found].state = PieceState::Saved;
                    running.saved += 1;
                }
            }
        }
        for (piece, _) in running.pieces.iter().enumerate().filter(|(_, p)| p.state == PieceState::Pending) {
            open.pending.insert((pass, key.tile, piece as u32));
        }
        let complete = running.saved == running.pieces.len();
        tile.phase = Phase::Running(running);
        self.stirred = true;
        if complete {
            // All parts were stored before a restart, but not merged.
            self.merge(key, out);
        }
    }

    /// What a job must have prepared is stored: its units may be rendered.
    pub(super) fn prepared(&mut self, id: JobId, now: f64, out: &mut Vec<Effect>) {
        let Some(job) = self.jobs.get_mut(&id) else { return };
        for lease in job.prepared(out) {
            self.strike_out(lease, UnitRef { tile: 0, pass: PREPARE_PASS, piece: 0 }, now);
        }
        self.stirred = true;
    }

    pub(super) fn measured(&mut self, id: JobId, frame: u32, again: Option<u32>, out: &mut Vec<Effect>) {
        if let Some(job) = self.jobs.get_mut(&id) {
            match again {
                Some(passes) => job.reopen_frame(frame, passes, out),
                None => job.frame_measured(frame, out),
            }
        }
    }

    /// A pass is merged and stored: the tile, and those that waited for it, go on.
    pub(super) fn merged(&mut self, key: TileKey, pass: u32, now: f64, out: &mut Vec<Effect>) {
        let Some(job) = self.jobs.get_mut(&key.job) else { return };
        let Some(open) = job.open_mut(key.frame) else { return };
        let Some(tile) = open.tiles.get_mut(key.tile as usize) else { return };
        if tile.passes != pass {
            return;
        }
        let mut holders = Vec::new();
        match std::mem::take(&mut tile.phase) {
            Phase::Running(running) => {
                for (index, piece) in running.pieces.iter().enumerate() {
                    open.pending.remove(&(pass, key.tile, index as u32));
                    holders.extend(piece.holders.iter().map(|&lease| (lease, index as u32)));
                }
                let area = tile.rect.area() as f64;
                open.done += area * (running.share - tile.share);
                tile.share = running.share;
            }
            // The job was restored while the pass was on its way to the disk.
            Phase::Waiting => {}
            Phase::Planning => open.planning -= 1,
            Phase::Finished => {
                tile.phase = Phase::Finished;
                return;
            }
        }
        tile.passes += 1;
        job.plan_around(key.frame, key.tile, out);
        for (lease, piece) in holders {
            self.strike_out(lease, UnitRef { tile: key.tile, pass, piece }, now);
        }
    }

    /// End a job whose work cannot be done.
    pub(super) fn fail_job(&mut self, id: JobId, message: String, out: &mut Vec<Effect>) {
        let Some(job) = self.jobs.get_mut(&id) else { return };
        if job.set(JobState::Failed, out).is_ok() {
            job.message = Some(message);
            self.drop_leases(id);
        }
    }
}
