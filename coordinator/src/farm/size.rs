//! How much work a lease holds: what units cost, as far as it is measured, and how they are grouped and split.

use common::{job::WorkerId, pass::Work};

use super::{
    LEASE_LEAST, LEASE_TARGET,
    job::{Job, Phase, Piece, Stage, Tile},
    lease::UnitRef,
};

/// Fewest pixels of a piece.
const LEAST_PIXELS: usize = 64;
/// Processor seconds of a sample before any was measured.
const GUESSED_COST: f64 = 2e-6;
/// Processor seconds of the unit that prepares a job, about.
const PREPARE_COST: f64 = 0.1;
/// Leases of a job that nothing is known of aim at this share of the target.
const FIRST_SHARE: f64 = 0.25;
/// Pending units that are looked at to foresee the end of a frame.
const LOOKAHEAD: usize = 256;
/// Most units of a lease.
const MAX_UNITS: usize = 256;

impl Job {
    /// Wall time that the next lease is cut to: the target; less while nothing is measured, and near the
    /// end of the job, where each of the workers, together `all` strong, gets half its share of what is left.
    pub(super) fn lease_seconds(&self, all: f64) -> f64 {
        if self.cost.per_sample().is_none() {
            return LEASE_TARGET * FIRST_SHARE;
        }
        let mut left = 0.0;
        for frame in &self.frames[self.first..] {
            match &frame.stage {
                Stage::Done => {}
                Stage::Waiting(_) => return LEASE_TARGET,
                Stage::Open(open) => {
                    let seen = open.pending.iter().take(LOOKAHEAD);
                    let cost: f64 = seen.map(|&(_, tile, piece)| self.predict(&open.tiles[tile as usize], piece)).sum();
                    left += cost * (open.pending.len() as f64 / LOOKAHEAD as f64).max(1.0);
                }
            }
        }
        (left / (2.0 * all)).clamp(LEASE_LEAST, LEASE_TARGET)
    }

    /// Predicted processor seconds of a piece of a tile's present pass.
    fn predict(&self, tile: &Tile, piece: u32) -> f64 {
        let Phase::Running(running) = &tile.phase else { return 0.0 };
        let pixels = running.pieces[piece as usize].rect.area() as f64;
        let samples = match &running.work {
            Work::Uniform { samples, .. } => f64::from(*samples),
            Work::PerPixel { batches, .. } => {
                let sum: f64 = batches.iter().map(|&n| f64::from(n)).sum();
                sum * f64::from(self.spec.batch) / tile.rect.area() as f64
            }
            Work::Prepare { .. } => return PREPARE_COST,
            Work::Textbook { max_samples, .. } => {
                let guess = || f64::from(*max_samples) / 4.0;
                self.cost.samples_per_pixel().unwrap_or_else(guess)
            }
        };
        let cost = tile.cost.or(self.cost.per_sample()).unwrap_or(GUESSED_COST);
        pixels * samples * cost
    }

    /// Take pending units of a frame, up to `target` processor seconds; a tile that is dearer is split.
    pub(super) fn take(
        &mut self,
        index: usize,
        worker: WorkerId,
        eligible: &[WorkerId],
        target: f64,
    ) -> Vec<(UnitRef, f64)> {
        let mut taken: Vec<(UnitRef, f64)> = Vec::new();
        let mut sum = 0.0;
        let mut after = (0, 0, 0);
        while taken.len() < MAX_UNITS && sum < target {
            let Stage::Open(open) = &self.frames[index].stage else { break };
            let Some(&(pass, tile, piece)) = open.pending.range(after..).next() else { break };
            after = (pass, tile, piece + 1);
            let unit = UnitRef { tile, pass, piece };
            let this = &open.tiles[tile as usize];
            let Phase::Running(running) = &this.phase else { continue };
            let candidate = &running.pieces[piece as usize];
            let elsewhere = |w: &WorkerId| *w != worker && !candidate.failed_on.contains(w);
            if candidate.failed_on.contains(&worker) && eligible.iter().any(elsewhere) {
                continue;
            }
            let suspicious = candidate.suspicious();
            if suspicious && !taken.is_empty() {
                continue;
            }
            let cost = self.predict(this, piece);
            if cost > 1.5 * target && running.split.is_none() && !suspicious && self.split(index, unit, cost / target) {
                after = (pass, tile, 0);
                continue;
            }
            if !taken.is_empty() && sum + cost > 1.5 * target {
                break;
            }
            if let Stage::Open(open) = &mut self.frames[index].stage {
                open.pending.remove(&(pass, tile, piece));
            }
            sum += cost;
            taken.push((unit, cost));
            if suspicious {
                break;
            }
        }
        taken
    }

    /// Cut a tile that nobody has begun into about `parts` pieces. Whether there is more than one.
    fn split(&mut self, index: usize, unit: UnitRef, parts: f64) -> bool {
        let Stage::Open(open) = &mut self.frames[index].stage else { return false };
        let tile = &mut open.tiles[unit.tile as usize];
        let Phase::Running(running) = &mut tile.phase else { return false };
        let area = tile.rect.area();
        let pixels = ((area as f64 / libm::ceil(parts)) as usize).max(LEAST_PIXELS);
        let pieces = tile.rect.split(pixels);
        if pieces.len() < 2 {
            return false;
        }
        running.split = Some(pixels);
        running.pieces = pieces.into_iter().map(Piece::new).collect();
        open.pending.remove(&(unit.pass, unit.tile, unit.piece));
        open.pending.extend((0..running.pieces.len() as u32).map(|piece| (unit.pass, unit.tile, piece)));
        true
    }
}
