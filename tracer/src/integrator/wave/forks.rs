//! Paths that go on in several ways (Arvo and Kirk 1990): vertices are kept until lanes are free for each way.

use super::{Wave, state::Scatters};
use crate::{
    geometry::Spared,
    integrator::Sample,
    lanes::{Flag, NO, YES, lanes_of},
    math::{Frame, Rgb, Vec3},
};

/// A vertex from which a path goes on in several ways: all that scattering needs to know of it.
#[derive(Debug)]
pub(super) struct Fork {
    /// Ways taken so far.
    taken: u32,
    slot: u32,
    key: u64,
    index: u32,
    depth: u32,
    throughput: Rgb,
    eta2: f32,
    material: u32,
    p: Vec3,
    p_error: Vec3,
    own: Spared,
    frame: Frame,
    wo: Vec3,
    front: Flag,
    n_reflecting: Vec3,
    scatters: Scatters,
    two_sided: Flag,
    reflectance: Rgb,
    alphas: [f32; 2],
    /// 1 where the material is not Lambert's law.
    other: u64,
}

impl Wave {
    /// Let paths whose surface is no delta go on in `n` ways, as lanes come free. A bit for each lane that got one.
    pub(super) fn fork(&mut self, n: u32) -> u64 {
        let mut placed = 0;
        for i in lanes_of(self.active()) {
            if self.forked[i] == YES || self.scatters[i] == Scatters::Delta {
                continue;
            }
            if !self.members.is_empty() {
                self.go_apart(i);
            }
            self.forks.push(self.vertex(i));
            let slot = self.slot[i] as usize;
            // All that there is of the whole path: what was gathered so far.
            self.samples[slot] = Sample { radiance: self.radiance.at(i), known: false };
            self.splits[slot] = true;
            self.alive[i] = NO;
            self.idle |= 1 << i;
        }
        while self.idle != 0
            && let Some(mut fork) = self.forks.pop()
        {
            for i in lanes_of(self.idle).take((n - fork.taken) as usize) {
                self.idle &= !(1 << i);
                placed |= 1 << i;
                self.go_on(i, &fork, n);
                fork.taken += 1;
            }
            if fork.taken < n {
                self.forks.push(fork);
            }
        }
        placed
    }

    /// Add up the ways of each path, in order.
    pub(super) fn join(&mut self, n: u32) {
        let ways = self.branches.chunks_exact(n as usize);
        for ((sample, ways), _) in self.samples.iter_mut().zip(ways).zip(&self.splits).filter(|(_, split)| **split) {
            let sum = ways.iter().fold(Rgb::ZERO, |sum, way| sum + way.radiance);
            sample.radiance += sum / n as f32;
            sample.known = ways.iter().all(|way| way.known);
        }
    }

    fn vertex(&self, i: usize) -> Fork {
        Fork {
            taken: 0,
            slot: self.slot[i],
            key: self.key[i],
            index: self.index[i],
            depth: self.depth[i],
            throughput: self.throughput.at(i),
            eta2: self.eta2[i],
            material: self.material[i],
            p: self.p.at(i),
            p_error: self.p_error.at(i),
            own: [self.own[0][i], self.own[1][i]],
            frame: self.frame(i),
            wo: self.wo.at(i),
            front: self.front[i],
            n_reflecting: self.n_reflecting.at(i),
            scatters: self.scatters[i],
            two_sided: self.two_sided[i],
            reflectance: self.reflectance.at(i),
            alphas: [self.alphas[0][i], self.alphas[1][i]],
            other: self.others >> i & 1,
        }
    }

    /// The next of `n` ways on from `fork`, in lane `i`.
    #[inline(always)]
    fn go_on(&mut self, i: usize, fork: &Fork, n: u32) {
        self.alive[i] = YES;
        (self.forked[i], self.ways[i]) = (YES, n as f32);
        self.slot[i] = fork.slot;
        self.way[i] = fork.slot * n + fork.taken;
        (self.key[i], self.index[i]) = (fork.key, fork.index * n + fork.taken);
        self.depth[i] = fork.depth;
        self.radiance.set(i, Rgb::ZERO);
        self.throughput.set(i, fork.throughput);
        self.eta2[i] = fork.eta2;
        self.material[i] = fork.material;
        self.p.set(i, fork.p);
        self.p_error.set(i, fork.p_error);
        (self.own[0][i], self.own[1][i]) = (fork.own[0], fork.own[1]);
        self.tangent.set(i, fork.frame.t);
        self.bitangent.set(i, fork.frame.b);
        self.ng.set(i, fork.frame.n);
        self.wo.set(i, fork.wo);
        self.front[i] = fork.front;
        self.n_reflecting.set(i, fork.n_reflecting);
        self.scatters[i] = fork.scatters;
        self.two_sided[i] = fork.two_sided;
        self.reflectance.set(i, fork.reflectance);
        [self.alphas[0][i], self.alphas[1][i]] = fork.alphas;
        self.others = self.others & !(1 << i) | fork.other << i;
    }
}
