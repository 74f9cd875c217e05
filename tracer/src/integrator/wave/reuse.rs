//! Paths of a wave that share what they find: [`crate::integrator::reuse`], many at once and to the same bits.

use super::{Scatters, Wave, stages};
use crate::{
    geometry::{Counters, NO_ROUND},
    integrator::{
        Integrator,
        reuse::{AT_ONCE, Joint, MEMBERS, Share, common},
    },
    lanes::{Flag, Lane, Lane3, NO, WIDTH, YES, lanes_of, mask_of},
    math::{Rgb, Vec2, Vec3},
    sampler::Sampler,
};

/// The members of a group, over and over again: lane `i` is number `i % MEMBERS`.
#[derive(Debug)]
pub(super) struct Group {
    pub p: Lane3,
    pub p_error: Lane3,
    pub ng: Lane3,
    pub n: Lane3,
    pub own: [Lane<u32>; 2],
    pub weight: Lane3,
    pub starts: Lane<Flag>,
    /// What each was given.
    pub sum: Lane3,
    /// Ends that members are joined to at once, each with the one who found it and its light.
    pub ends: [(u32, Joint, Rgb); AT_ONCE],
}

impl Group {
    pub(super) const EMPTY: Self = Self {
        p: Lane3::ZERO,
        p_error: Lane3::ZERO,
        ng: Lane3::ZERO,
        n: Lane3::ZERO,
        own: [[0; WIDTH]; 2],
        weight: Lane3::ZERO,
        starts: [NO; WIDTH],
        sum: Lane3::ZERO,
        ends: [(0, Share::NOTHING.end, Rgb::ZERO); AT_ONCE],
    };

    /// Take up the paths of a group.
    fn gather(&mut self, members: impl Iterator<Item = Share>) {
        self.starts = [NO; WIDTH];
        self.sum = Lane3::ZERO;
        for (j, share) in members.enumerate() {
            for i in (j..WIDTH).step_by(MEMBERS) {
                self.starts[i] = Flag::from(share.starts);
                self.p.set(i, share.start.p);
                self.p_error.set(i, share.start.p_error);
                self.ng.set(i, share.start.ng);
                self.n.set(i, share.start.n);
                self.weight.set(i, share.weight);
                (self.own[0][i], self.own[1][i]) = (share.own[0], share.own[1]);
            }
        }
    }

    /// What member `j` was given.
    fn given(&self, j: usize) -> Rgb {
        (j..WIDTH).step_by(MEMBERS).fold(Rgb::ZERO, |sum, i| sum + self.sum.at(i))
    }
}

impl Wave {
    /// Where the numbers come from that paths of `groups` share, requests up to each of those.
    pub(super) fn set_members(&mut self, sampler: &Sampler, requests: &[[u32; 3]], groups: &[u32]) {
        self.members.clear();
        let mut begin = 0;
        for &end in groups {
            let common = common(sampler, requests[begin]);
            let stream = |l| common.fork(l as u32, MEMBERS as u32).parts();
            self.members.extend((0..end as usize - begin).map(stream));
            begin = end as usize;
        }
    }

    /// Numbers of the path of lane `i` come from those that its group shares, from here on.
    pub(super) fn go_apart(&mut self, i: usize) {
        (self.key[i], self.index[i]) = self.members[self.slot[i] as usize];
        self.forked[i] = YES;
    }

    /// The number of lane `i`'s share.
    fn share(&self, i: usize) -> usize {
        if self.branches.is_empty() { self.slot[i] as usize } else { self.way[i] as usize }
    }

    /// Forget what the path of lane `i` was to share, and tell what it keeps of what it found.
    #[inline(always)]
    pub(super) fn close(&mut self, i: usize) -> Rgb {
        let radiance = self.radiance.at(i);
        self.started[i] = NO;
        if self.beyond[i] == NO {
            return radiance;
        }
        self.beyond[i] = NO;
        let share = self.share(i);
        self.shares[share].close(radiance)
    }
}

impl Integrator<'_> {
    /// Begin to share the paths that can be joined where they are.
    pub(super) fn wave_start(&self, wave: &mut Wave) {
        for i in lanes_of(wave.active()) {
            if wave.depth[i] != 0 {
                continue;
            }
            let Some((start, reflectance)) = self.wave_joint(wave, i) else { continue };
            let weight = wave.throughput.at(i) * reflectance;
            if weight == Rgb::ZERO {
                continue;
            }
            if wave.forked[i] == NO {
                wave.go_apart(i);
            }
            wave.started[i] = YES;
            let share = wave.share(i);
            wave.shares[share] = Share::of(start, weight, [wave.own[0][i], wave.own[1][i]]);
        }
    }

    /// What paths find from their ends on is kept apart.
    pub(super) fn wave_arrive(&self, wave: &mut Wave) {
        for i in lanes_of(wave.active() & mask_of(&wave.started)) {
            wave.started[i] = NO;
            let Some((end, _)) = self.wave_joint(wave, i) else { continue };
            wave.beyond[i] = YES;
            let share = wave.share(i);
            let throughput = wave.shares[share].arrive(end, wave.radiance.at(i), wave.throughput.at(i));
            wave.throughput.set(i, throughput);
            wave.radiance.set(i, Rgb::ZERO);
        }
    }

    fn wave_joint(&self, wave: &Wave, i: usize) -> Option<(Joint, Rgb)> {
        let reflectance = match wave.scatters[i] {
            Scatters::Diffuse => {
                let wo_z = wave.wo.at(i).z;
                let reflects = wo_z > 0.0 || wo_z < 0.0 && wave.two_sided[i] == YES;
                reflects.then(|| wave.reflectance.at(i))
            }
            Scatters::Other => self.wave_material(wave, i).bsdf(Vec2::ZERO).reflects_diffusely(wave.wo.at(i)),
            Scatters::Facets | Scatters::Delta => None,
        }?;
        let n = wave.n_reflecting.at(i);
        let joint = Joint { p: wave.p.at(i), p_error: wave.p_error.at(i), ng: wave.ng.at(i), n };
        (n != Vec3::ZERO).then_some((joint, reflectance))
    }

    /// Join the paths of each group of requests, which reach up to each of `groups`.
    pub(super) fn wave_join_all(&self, wave: &mut Wave, groups: &[u32], counters: &mut Counters) {
        let mut begin = 0;
        for &end in groups {
            for way in 0..self.splits as usize {
                self.wave_join(wave, begin..end as usize, way, counters);
            }
            begin = end as usize;
        }
    }

    fn wave_join(&self, wave: &mut Wave, slots: std::ops::Range<usize>, way: usize, counters: &mut Counters) {
        let of_way = |slot: usize| slot * self.splits as usize + way;
        if !slots.clone().any(|slot| wave.shares[of_way(slot)].ends) {
            return;
        }
        wave.group
            .gather(wave.shares[of_way(slots.start)..].iter().step_by(self.splits as usize).take(slots.len()).copied());
        let mut slot = slots.start;
        loop {
            let mut count = 0;
            while count < AT_ONCE && slot < slots.end {
                let Share { ends, end, light, .. } = wave.shares[of_way(slot)];
                if ends {
                    wave.group.ends[count] = ((slot - slots.start) as u32, end, light);
                    count += 1;
                }
                slot += 1;
            }
            if count == 0 {
                break;
            }
            stages::join(wave.proven, wave, count);
            self.wave_shadows(wave, WIDTH, NO_ROUND, counters);
            stages::give(wave.proven, wave, count);
        }
        for (j, slot) in slots.enumerate() {
            wave.samples[slot].radiance += wave.group.given(j) / self.splits as f32;
        }
    }
}
