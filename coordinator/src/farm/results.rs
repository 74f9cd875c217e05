//! What workers hand in: results that are accepted once, and failures that are tried elsewhere.

use common::{
    job::{LeaseId, WorkerId},
    pass::PREPARE_PASS,
    protocol::{FailureCause, Outcome, UnitId},
};

use super::{
    Accepted, Effect, Farm, MAX_FAILURES, TileKey, Wanted,
    job::{Phase, PieceState},
    lease::{Held, UnitRef, unit_of},
};

impl Farm {
    /// Whether a result for a unit is wanted, and what it must hold.
    #[must_use]
    pub fn wanted(&self, unit: &UnitId) -> Wanted {
        let Some(job) = self.jobs.get(&unit.job) else { return Wanted::Unknown };
        let inside = job.spec.grid.rect(unit.tile).is_some_and(|tile| tile.contains(&unit.rect));
        if job.frame_index(unit.frame).is_none() || !inside || unit.rect.area() == 0 {
            return Wanted::Unknown;
        }
        let Some((at, state)) = self.locate(unit) else { return Wanted::Closed };
        if job.state.is_final() || !matches!(state, PieceState::Pending | PieceState::Leased) {
            return Wanted::Closed;
        }
        let Some(tile) = job.open_ref(unit.frame).and_then(|open| open.tiles.get(unit.tile as usize)) else {
            return Wanted::Closed;
        };
        let Phase::Running(running) = &tile.phase else { return Wanted::Closed };
        Wanted::Open(unit_of(unit.job, unit.frame, at, tile.rect, unit.rect, &running.work))
    }

    /// Where a unit is, if its pass is the one being rendered and it is cut as its name says.
    fn locate(&self, unit: &UnitId) -> Option<(UnitRef, PieceState)> {
        let open = self.jobs.get(&unit.job)?.open_ref(unit.frame)?;
        let tile = open.tiles.get(unit.tile as usize)?;
        let Phase::Running(running) = &tile.phase else { return None };
        if tile.passes != unit.pass {
            return None;
        }
        let piece = running.piece(unit.rect)?;
        let at = UnitRef { tile: unit.tile, pass: unit.pass, piece: piece as u32 };
        Some((at, running.pieces[piece].state))
    }

    pub(super) fn result(
        &mut self,
        lease: LeaseId,
        id: UnitId,
        samples: u64,
        cpu_seconds: f64,
        now: f64,
        out: &mut Vec<Effect>,
    ) {
        let granted = self.leases.get(&lease).map(|held| (held.worker, now - held.granted_at));
        let (worker, seconds) = granted.unzip();
        let at = match (self.wanted(&id), self.locate(&id)) {
            (Wanted::Open(_), Some((at, _))) => at,
            _ => {
                self.counters.closed += 1;
                out.push(Effect::Closed);
                return;
            }
        };
        let Some(job) = self.jobs.get_mut(&id.job) else { return };
        if id.pass != PREPARE_PASS {
            job.cost.add(cpu_seconds, samples as f64, id.rect.area() as f64);
        }
        job.samples.add(samples as f64, now);
        job.delivered += cpu_seconds;
        let Some(open) = job.open_mut(id.frame) else { return };
        let tile = &mut open.tiles[at.tile as usize];
        if samples > 0 && cpu_seconds > 0.0 {
            tile.cost = Some(cpu_seconds / samples as f64);
        }
        tile.worker = worker.or(tile.worker);
        let attempts = tile.attempts;
        let Phase::Running(running) = &mut tile.phase else { return };
        let piece = &mut running.pieces[at.piece as usize];
        piece.state = PieceState::Saving;
        let holders = std::mem::take(&mut piece.holders);
        open.pending.remove(&(at.pass, at.tile, at.piece));
        let accepted = Accepted { unit: id, split: running.split, share: running.share, attempts, worker, seconds };
        if let Some(held) = self.leases.get_mut(&lease) {
            held.cpu_seconds += cpu_seconds;
        }
        if let Some(worker) = worker.and_then(|id| self.workers.get_mut(&id)) {
            worker.last_seen = now;
            worker.strikes = 0;
            worker.history.units += 1;
            worker.samples.add(samples as f64, now);
            worker.samples_before.add(samples as f64, now);
            worker.jobs.insert(id.job);
        }
        for holder in holders {
            self.strike_out(holder, at, now);
        }
        self.counters.accepted += 1;
        out.push(Effect::Accept(accepted));
    }

    pub(super) fn saved(&mut self, id: UnitId, out: &mut Vec<Effect>) {
        let Some((at, _)) = self.locate(&id) else { return };
        let Some(open) = self.jobs.get_mut(&id.job).and_then(|job| job.open_mut(id.frame)) else { return };
        let Phase::Running(running) = &mut open.tiles[at.tile as usize].phase else { return };
        let piece = &mut running.pieces[at.piece as usize];
        if piece.state == PieceState::Saved {
            return;
        }
        // It was being stored while the job was restored, which made it pending again.
        open.pending.remove(&(at.pass, at.tile, at.piece));
        piece.state = PieceState::Saved;
        running.saved += 1;
        if running.saved == running.pieces.len() {
            self.merge(TileKey::from(&id), out);
        }
    }

    /// Every part of a pass is stored.
    pub(super) fn merge(&mut self, key: TileKey, out: &mut Vec<Effect>) {
        let Some(open) = self.jobs.get(&key.job).and_then(|job| job.open_ref(key.frame)) else { return };
        let tile = &open.tiles[key.tile as usize];
        let Phase::Running(running) = &tile.phase else { return };
        let unit = UnitId { job: key.job, frame: key.frame, tile: key.tile, pass: tile.passes, rect: tile.rect };
        out.push(Effect::Merge(Accepted {
            unit,
            split: running.split,
            share: running.share,
            attempts: tile.attempts,
            worker: tile.worker,
            seconds: None,
        }));
    }

    pub(super) fn save_failed(&mut self, id: UnitId) {
        let Some((at, PieceState::Saving)) = self.locate(&id) else { return };
        let Some(open) = self.jobs.get_mut(&id.job).and_then(|job| job.open_mut(id.frame)) else { return };
        let Phase::Running(running) = &mut open.tiles[at.tile as usize].phase else { return };
        running.pieces[at.piece as usize].state = PieceState::Pending;
        open.pending.insert((at.pass, at.tile, at.piece));
        self.stirred = true;
    }

    #[expect(clippy::too_many_arguments, reason = "the fields of one event")]
    pub(super) fn failed(
        &mut self,
        lease: LeaseId,
        worker: WorkerId,
        ids: &[UnitId],
        cause: FailureCause,
        message: &str,
        now: f64,
        out: &mut Vec<Effect>,
    ) {
        let Some(mut held) = self.leases.remove(&lease) else { return };
        if held.worker != worker {
            self.leases.insert(lease, held);
            return;
        }
        let named = |at: UnitRef| {
            ids.iter().any(|id| {
                (id.job, id.frame, id.tile, id.pass) == (held.job, held.frame, at.tile, at.pass)
                    && self.locate(id).is_some_and(|(found, _)| found == at)
            })
        };
        let units: Vec<UnitRef> = held.units.iter().map(|held| held.unit).filter(|&at| named(at)).collect();
        held.units.retain(|held| !units.contains(&held.unit));
        match cause {
            FailureCause::Returned => {
                self.counters.returned += units.len() as u64;
                self.attempts_failed((lease, &held), &units, (Outcome::Returned, message), now, out);
                self.give_back(lease, &held, &units, |_| {});
            }
            FailureCause::Failed => {
                self.units_failed(lease, &held, &units, (Outcome::Failed, message), now, out);
            }
        }
        // The job may have failed, and its leases with it.
        let over = self.jobs.get(&held.job).is_none_or(|job| job.state.is_final());
        if let Some(worker) = self.workers.get_mut(&worker) {
            worker.last_seen = now;
            if held.units.is_empty() || over {
                worker.leases.remove(&lease);
                if worker.leases.is_empty() {
                    worker.busy_until = now;
                    worker.free_since = now;
                }
                return;
            }
        }
        self.leases.insert(lease, held);
    }

    /// Units failed on a worker: others try, until there is reason to believe that the units are at fault.
    pub(super) fn units_failed(
        &mut self,
        lease: LeaseId,
        held: &Held,
        units: &[UnitRef],
        (outcome, message): (Outcome, &str),
        now: f64,
        out: &mut Vec<Effect>,
    ) {
        if units.is_empty() {
            return;
        }
        self.counters.failed += units.len() as u64;
        self.attempts_failed((lease, held), units, (outcome, message), now, out);
        self.strike(held.worker, units.len() as u64, now, out);
        let worst = self.give_back(lease, held, units, |piece| {
            piece.failures += 1;
            if !piece.failed_on.contains(&held.worker) {
                piece.failed_on.push(held.worker);
            }
        });
        let others = self.eligible(held.job, now).iter().any(|worker| !worst.failed_on.contains(worker));
        let everywhere = worst.failed_on.len() as u32 >= MAX_FAILURES;
        if everywhere || (worst.failures >= MAX_FAILURES && !others) {
            self.exonerate(&worst.failed_on, out);
            self.fail_job(held.job, format!("{}: {message}", worst.describe(held.frame)), out);
        }
    }
}
