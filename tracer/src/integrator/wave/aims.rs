//! What the paths of a wave aim at.

use super::{Wave, state::Scatters};
use crate::{
    aim::{Cone, Cones, MOST, Target, Targets},
    integrator::Integrator,
    lanes::{Lane, Lane3, WIDTH, covering, lanes_of, stage},
    math::Vec3,
};

/// Targets of each path's vertex, and their cones.
#[derive(Debug)]
pub(super) struct AimLanes {
    center: [Lane3; MOST],
    radius: [Lane<f32>; MOST],
    axis: [Lane3; MOST],
    reach2: [Lane<f32>; MOST],
    share: [Lane<f32>; MOST],
    density: [Lane<f32>; MOST],
}

impl AimLanes {
    /// Nothing.
    pub(super) const NONE: Self = Self {
        center: [Lane3::ZERO; MOST],
        radius: [[0.0; WIDTH]; MOST],
        axis: [Lane3::ZERO; MOST],
        reach2: [[0.0; WIDTH]; MOST],
        share: [[0.0; WIDTH]; MOST],
        density: [[0.0; WIDTH]; MOST],
    };

    #[inline(always)]
    fn set(&mut self, i: usize, targets: &Targets) {
        for (k, target) in targets.iter().enumerate() {
            self.center[k].set(i, target.center);
            self.radius[k][i] = target.radius;
            self.share[k][i] = target.share;
        }
    }

    /// The cones of lane `i`.
    #[inline(always)]
    pub(super) fn cones(&self, i: usize) -> Cones {
        Cones(std::array::from_fn(|k| Cone {
            axis: self.axis[k].at(i),
            reach2: self.reach2[k][i],
            share: self.share[k][i],
            density: self.density[k][i],
        }))
    }
}

impl Integrator<'_> {
    /// Look up what the paths in `lanes` aim at from their vertices; those of others are known.
    pub(super) fn wave_aim(&self, wave: &mut Wave, lanes: u64) {
        let Some(aims) = self.aims else { return };
        if lanes == 0 {
            return;
        }
        for i in lanes_of(lanes) {
            if wave.scatters[i] != Scatters::Delta {
                wave.aim.set(i, aims.at(wave.p.at(i)));
            }
        }
        see(wave.proven, &mut wave.aim, wave.n, &wave.p, &wave.n_reflecting);
    }
}

stage! {
    /// Targets become cones; of cones that were seen already, the same ones.
    fn see(aim: &mut AimLanes, n: usize, p: &Lane3, normal: &Lane3) {
        for k in 0..MOST {
            see_one(aim, k, n, p, normal);
        }
    }
}

#[inline(always)]
fn see_one(aim: &mut AimLanes, k: usize, n: usize, p: &Lane3, normal: &Lane3) {
    for i in 0..covering(n) {
        let (center, radius, share) = (aim.center[k].at(i), aim.radius[k][i], aim.share[k][i]);
        let (p, normal): (Vec3, Vec3) = (p.at(i), normal.at(i));
        let cone = Cone::seen_from(&Target { center, radius, share }, p, normal);
        aim.axis[k].set(i, cone.axis);
        aim.reach2[k][i] = cone.reach2;
        aim.share[k][i] = cone.share;
        aim.density[k][i] = cone.density;
    }
}
