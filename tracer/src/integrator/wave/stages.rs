//! The stages that all paths of a wave go through alike: loops without branches over whole groups of lanes.

use super::state::{Came, Fresh, Scatters, Wave};
use crate::{
    bsdf::Facets,
    camera::Camera,
    geometry::{Spared, spawn, spawn_to, surface::triangle_point},
    integrator::{
        dimension, power_heuristic,
        reuse::{AT_ONCE, Joint, MEMBERS, density, total},
    },
    lanes::{Flag, Lane, NO, YES, covering, stage},
    light::{Ball, FewBalls, Lamp, LampSample, Shard, of_child},
    math::{Frame, INV_PI, Rgb, Vec2, cosine_hemisphere, select, select3},
    microfacet::Ggx,
    sampler::{Batches, COMPUTED, COMPUTED_FORKED, TABLED, TABLED_FORKED, plain_one, plain_two, split_key},
};

/// Square of the cosine below which an angle is too flat for a ray to spare itself any plane.
const FLAT: f32 = 1.0 / 256.0;

stage! {
    /// Points on triangles, with error bounds and normals.
    pub(super) fn triangle_points(w: &mut Wave) {
        for i in 0..covering(w.n) {
            let corners = [w.corners[0].at(i), w.corners[1].at(i), w.corners[2].at(i)];
            let point = triangle_point(corners, w.b1[i], w.b2[i]);
            w.p.set(i, point.p);
            w.p_error.set(i, point.p_error);
            w.ng.set(i, point.ng);
        }
    }
}

stage! {
    /// Local frames, and the way back in them.
    pub(super) fn frames(w: &mut Wave) {
        for i in 0..covering(w.n) {
            let ng = w.ng.at(i);
            let to_eye = -w.direction.at(i).normalize();
            let frame = Frame::from_normal(ng);
            let front = to_eye.dot(ng) > 0.0;
            w.tangent.set(i, frame.t);
            w.bitangent.set(i, frame.b);
            w.front[i] = Flag::from(front);
            w.wo.set(i, frame.to_local(to_eye));
            let n = select3(front, ng, -ng);
            w.n_reflecting.set(i, select3(w.transmissive[i] == YES, Rgb::ZERO, n));
        }
    }
}

stage! {
    /// Rays of a plain camera, with numbers of a plain sampler, for the first `n` paths that begin.
    pub(super) fn camera_rays(fresh: &mut Fresh, n: usize, camera: &Camera, batches: Batches) {
        match batches.code() {
            TABLED | TABLED_FORKED => camera_rays_by::<TABLED>(fresh, n, camera, batches),
            _ => camera_rays_by::<COMPUTED>(fresh, n, camera, batches),
        }
    }
}

#[inline(always)]
fn camera_rays_by<const CODE: u32>(fresh: &mut Fresh, n: usize, camera: &Camera, batches: Batches) {
    let camera = *camera;
    for i in 0..covering(n) {
        let u = plain_two::<CODE>(fresh.key[i], fresh.index[i], false, batches, dimension::FILM);
        let ray = camera.plain_ray(fresh.x[i], fresh.y[i], u);
        fresh.origin.set(i, ray.origin);
        fresh.direction.set(i, ray.direction);
        fresh.t_max[i] = ray.t_max;
    }
}

stage! {
    /// A pair of numbers for decision `which` of each path, of a plain sampler.
    pub(super) fn draw_two(w: &mut Wave, which: u32, batches: Batches) {
        match batches.code() {
            TABLED => draw_two_by::<TABLED>(w, which, batches),
            COMPUTED => draw_two_by::<COMPUTED>(w, which, batches),
            TABLED_FORKED => draw_two_by::<TABLED_FORKED>(w, which, batches),
            _ => draw_two_by::<COMPUTED_FORKED>(w, which, batches),
        }
    }
}

#[inline(always)]
fn draw_two_by<const CODE: u32>(w: &mut Wave, which: u32, batches: Batches) {
    for i in 0..covering(w.n) {
        let forked = w.forked[i] == YES;
        let u = plain_two::<CODE>(w.key[i], w.index[i], forked, batches, dimension::at(w.depth[i], which));
        (w.u[0][i], w.u[1][i]) = (u.x, u.y);
    }
}

stage! {
    /// A number for decision `which` of each path, of a plain sampler.
    pub(super) fn draw_one(w: &mut Wave, which: u32, batches: Batches) {
        match batches.code() {
            TABLED => draw_one_by::<TABLED>(w, which, batches),
            COMPUTED => draw_one_by::<COMPUTED>(w, which, batches),
            TABLED_FORKED => draw_one_by::<TABLED_FORKED>(w, which, batches),
            _ => draw_one_by::<COMPUTED_FORKED>(w, which, batches),
        }
    }
}

#[inline(always)]
fn draw_one_by<const CODE: u32>(w: &mut Wave, which: u32, batches: Batches) {
    for i in 0..covering(w.n) {
        let forked = w.forked[i] == YES;
        w.u_one[i] = plain_one::<CODE>(w.key[i], w.index[i], forked, batches, dimension::at(w.depth[i], which));
    }
}

stage! {
    /// Further samples of one decision: as [`Stream::split`](crate::sampler::Stream::split) of the streams with `keys`.
    pub(super) fn split_keys(w: &mut Wave, keys: &Lane<u64>, k: u32) {
        for i in 0..covering(w.n) {
            w.key[i] = split_key(keys[i], k);
        }
    }
}

stage! {
    /// Which paths gather light: those alive whose next scattering is counted.
    pub(super) fn gather(w: &mut Wave, least: u32, most: u32) {
        for i in 0..covering(w.n) {
            let next = w.depth[i] + 1;
            w.gathers[i] = w.alive[i] & Flag::from((least <= next) & (next <= most));
        }
    }
}

stage! {
    /// A point on a rectangle for each path, uniform over the solid angle. `infinite` marks those for which
    /// that cannot be done.
    pub(super) fn rectangle_light(w: &mut Wave, lamp: &Lamp) {
        let lamp = *lamp;
        for i in 0..covering(w.n) {
            let p = w.p.at(i);
            let sample = lamp.sample(p, Vec2::new(w.u[0][i], w.u[1][i]));
            w.wi.set(i, sample.wi);
            w.light.set(i, sample.point);
            w.light_error.set(i, sample.point_error);
            w.light_ng.set(i, sample.ng);
            w.light_radiance.set(i, sample.radiance);
            w.light_pdf[i] = sample.pdf;
            w.lit[i] = Flag::from(sample.valid & sample.precise);
            w.infinite[i] = Flag::from(sample.valid & !sample.precise);
        }
    }
}

stage! {
    /// One of a few spheres for each path that gathers light, by the numbers in `u_one` and `u`; `rounds` are their bits for
    /// rays that end before them.
    pub(super) fn choose_ball(w: &mut Wave, few: &FewBalls, rounds: [u32; 4]) {
        let (few, rounds) = (*few, rounds.map(f32::from_bits));
        for i in 0..covering(w.n) {
            let u = Vec2::new(w.u[0][i], w.u[1][i]);
            let (child, chosen, some) = few.pick(w.p.at(i), w.n_reflecting.at(i), w.u_one[i], u);
            let ball = few.ball(child, chosen);
            let gathers = Flag::from(w.scatters[i] as u32 != Scatters::Delta as u32) & w.gathers[i];
            w.ball[i] = Flag::from(some) & gathers;
            w.ball_center.set(i, ball.center);
            w.ball_radius[i] = ball.radius;
            w.ball_round[i] = of_child(rounds, child).to_bits();
            w.lamp_two_sided[i] = Flag::from(ball.two_sided);
            w.lamp_chosen[i] = chosen;
            w.light_radiance.set(i, ball.radiance);
            w.lit[i] = NO;
        }
    }
}

stage! {
    /// A point on its sphere for each path that has one. `infinite` marks those for which that cannot be done.
    pub(super) fn ball_light(w: &mut Wave) {
        for i in 0..covering(w.n) {
            let ball = Ball {
                center: w.ball_center.at(i),
                radius: w.ball_radius[i],
                emitter: 0,
                two_sided: w.lamp_two_sided[i] == YES,
                radiance: w.light_radiance.at(i),
                chosen: w.lamp_chosen[i],
            };
            let is_ball = w.ball[i] == YES;
            let sample = ball.sample(w.p.at(i), Vec2::new(w.u[0][i], w.u[1][i]));
            light_where(w, i, is_ball, &sample);
        }
    }
}

stage! {
    /// The same of one sphere for every path that gathers light.
    pub(super) fn same_ball_light(w: &mut Wave, ball: &Ball, round: u32) {
        let ball = *ball;
        for i in 0..covering(w.n) {
            let sample = ball.sample(w.p.at(i), Vec2::new(w.u[0][i], w.u[1][i]));
            let gathers = Flag::from(w.scatters[i] as u32 != Scatters::Delta as u32) & w.gathers[i];
            w.wi.set(i, sample.wi);
            w.light.set(i, sample.point);
            w.light_error.set(i, sample.point_error);
            w.light_ng.set(i, sample.ng);
            w.light_radiance.set(i, sample.radiance);
            w.light_pdf[i] = sample.pdf;
            w.lit[i] = Flag::from(sample.valid & sample.precise) & gathers;
            w.infinite[i] = Flag::from(!sample.precise) & gathers;
            w.ball_radius[i] = ball.radius;
            w.ball_round[i] = round;
        }
    }
}

stage! {
    /// A point on its triangle for each path that has one.
    pub(super) fn shard_light(w: &mut Wave) {
        for i in 0..covering(w.n) {
            let shard = Shard {
                p: [w.shard_corners[0].at(i), w.shard_corners[1].at(i), w.shard_corners[2].at(i)],
                two_sided: w.lamp_two_sided[i] == YES,
                radiance: w.light_radiance.at(i),
                chosen: w.lamp_chosen[i],
            };
            let is_shard = w.shard[i] == YES;
            let sample = shard.sample(w.p.at(i), Vec2::new(w.u[0][i], w.u[1][i]));
            light_where(w, i, is_shard, &sample);
        }
    }
}

/// Take `sample` for lane `i` if `is_its`; its radiance is there already.
#[inline(always)]
fn light_where(w: &mut Wave, i: usize, is_its: bool, sample: &LampSample) {
    w.wi.set(i, select3(is_its, sample.wi, w.wi.at(i)));
    w.light.set(i, select3(is_its, sample.point, w.light.at(i)));
    w.light_error.set(i, select3(is_its, sample.point_error, w.light_error.at(i)));
    w.light_ng.set(i, select3(is_its, sample.ng, w.light_ng.at(i)));
    w.light_pdf[i] = select(is_its, sample.pdf, w.light_pdf[i]);
    w.lit[i] = Flag::from(is_its & sample.valid & sample.precise | !is_its & (w.lit[i] == YES));
    w.infinite[i] = Flag::from(is_its & !sample.precise | !is_its & (w.infinite[i] == YES));
}

stage! {
    /// The facets of rough metal that reflect light samples to where each path came from; lanes of other materials are
    /// left alone. Where there are none, nothing is lit.
    pub(super) fn direct_facets(w: &mut Wave) {
        for i in 0..covering(w.n) {
            let rough = w.scatters[i] as u32 == Scatters::Facets as u32;
            let frame = Frame { t: w.tangent.at(i), b: w.bitangent.at(i), n: w.ng.at(i) };
            let (light_wi, wo) = (w.wi.at(i), w.wo.at(i));
            let wi = frame.to_local(light_wi);
            let transmission = (wi.z > 0.0) != (wo.z > 0.0);
            let passes = (light_wi.dot(frame.n) > 0.0) != (w.front[i] == YES);
            let back = (w.two_sided[i] == YES) & (wo.z < 0.0) & (wi.z < 0.0);
            let above = (wo.z > 0.0) & (wi.z > 0.0) | back;
            let up = |v: Rgb| Rgb::new(v.x, v.y, select(back, -v.z, v.z));
            let facets = Facets::between(&Ggx::with_alphas([w.alphas[0][i], w.alphas[1][i]]), up(wo), up(wi));
            w.facet_cos[i] = facets.cos;
            w.facet_value[i] = facets.value;
            w.facet_pdf[i] = facets.pdf;
            let some = (transmission == passes) & above & facets.some;
            w.lit[i] = Flag::from((w.lit[i] == YES) & (!rough | some));
        }
    }
}

stage! {
    /// What light samples bring by way of Lambert's law; a hit takes `light_samples` of each light that it samples.
    pub(super) fn direct_diffuse(w: &mut Wave, mis: bool, light_samples: f32) {
        if w.aims {
            direct_diffuse_by::<true>(w, mis, light_samples);
        } else {
            direct_diffuse_by::<false>(w, mis, light_samples);
        }
    }
}

#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "a lane of several arrays")]
fn direct_diffuse_by<const AIMED: bool>(w: &mut Wave, mis: bool, light_samples: f32) {
    for i in 0..covering(w.n) {
        let diffuse = w.scatters[i] as u32 == Scatters::Diffuse as u32;
        let frame = Frame { t: w.tangent.at(i), b: w.bitangent.at(i), n: w.ng.at(i) };
        let (light_wi, wo_z) = (w.wi.at(i), w.wo.at(i).z);
        let wi = frame.to_local(light_wi);
        let transmission = (wi.z > 0.0) != (wo_z > 0.0);
        let passes = (light_wi.dot(frame.n) > 0.0) != (w.front[i] == YES);
        let above = (wo_z > 0.0) & (wi.z > 0.0) | (w.two_sided[i] == YES) & (wo_z < 0.0) & (wi.z < 0.0);
        let scatter_pdf = wi.z.abs() * INV_PI;
        let f_cos = w.reflectance.at(i) * scatter_pdf;
        let scatter_pdf = if AIMED { w.aim.cones(i).density(light_wi, scatter_pdf) } else { scatter_pdf };
        let (signed, pdf) = (w.light_pdf[i], w.light_pdf[i].abs());
        let weight = select(mis & (signed > 0.0), power_heuristic(light_samples * pdf, w.ways[i] * scatter_pdf), 1.0);
        let brings = f_cos * w.light_radiance.at(i) * (weight / pdf);
        let some = (brings.x != 0.0) | (brings.y != 0.0) | (brings.z != 0.0);
        let lit = (w.gathers[i] & w.lit[i] == YES) & (!diffuse | (transmission == passes) & above & some);
        w.lit[i] = Flag::from(lit);
        w.brings.set(i, brings);
    }
}

stage! {
    /// Rays from the surface to the light.
    pub(super) fn shadow_rays(w: &mut Wave, lamp: Spared, lamp_size2: f32) {
        for i in 0..covering(w.n) {
            let (p, error, ng) = (w.p.at(i), w.p_error.at(i), w.ng.at(i));
            let ray = spawn_to(p, error, ng, w.light.at(i), w.light_error.at(i), w.light_ng.at(i));
            w.shadow_origin.set(i, ray.origin);
            w.shadow_direction.set(i, ray.direction);
            w.shadow_t_max[i] = ray.t_max;
            // Neither the plane left behind nor that of the lamp ahead, which the ray ends before, or the sphere.
            let d = ray.direction;
            let (length2, from, to) = (d.length_squared(), d.dot(ng), d.dot(w.light_ng.at(i)));
            let leaves = u32::from(from * from > FLAT * length2).wrapping_neg();
            let reaches = u32::from((to * to > FLAT * length2) & (length2 > lamp_size2)).wrapping_neg();
            for k in 0..2 {
                w.shadow_spared[k][i] = w.own[k][i] & leaves | lamp[k] & reaches;
            }
            let radius = w.ball_radius[i];
            let parted = (to < 0.0) & (to * to > FLAT * length2) & (length2 > radius * radius);
            w.shadow_ended[i] = w.ball_round[i] & u32::from(parted).wrapping_neg();
        }
    }
}

stage! {
    /// Add what light samples bring where nothing is in between.
    pub(super) fn add_light(w: &mut Wave) {
        for i in 0..covering(w.n) {
            let arrives = (w.lit[i] == YES) & (w.occluded[i] == NO);
            let radiance = w.radiance.at(i);
            let sum = radiance + w.throughput.at(i) * w.brings.at(i);
            w.radiance.set(i, select3(arrives, sum, radiance));
        }
    }
}

stage! {
    /// Sum up what light samples bring where nothing is in between.
    pub(super) fn sum_light(w: &mut Wave) {
        for i in 0..covering(w.n) {
            let arrives = (w.lit[i] == YES) & (w.occluded[i] == NO);
            let sum = w.sum.at(i);
            w.sum.set(i, select3(arrives, sum + w.brings.at(i), sum));
        }
    }
}

stage! {
    /// Add the sum, `count` rounds over all lights that are sampled.
    pub(super) fn add_sum(w: &mut Wave, count: f32) {
        for i in 0..covering(w.n) {
            let (sum, radiance) = (w.sum.at(i), w.radiance.at(i));
            let some = (sum.x != 0.0) | (sum.y != 0.0) | (sum.z != 0.0);
            w.radiance.set(i, select3(some, radiance + w.throughput.at(i) * (sum / count), radiance));
        }
    }
}

stage! {
    /// A direction by Lambert's law for each path. Lanes of other materials are left alone. A path whose scatterings
    /// would be `last` ends.
    pub(super) fn scatter_diffuse(w: &mut Wave, came: Came, last: u32) {
        if w.aims {
            scatter_diffuse_by::<true>(w, came, last);
        } else {
            scatter_diffuse_by::<false>(w, came, last);
        }
    }
}

#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "a lane of several arrays")]
fn scatter_diffuse_by<const AIMED: bool>(w: &mut Wave, came: Came, last: u32) {
    for i in 0..covering(w.n) {
        let diffuse = (w.scatters[i] as u32 == Scatters::Diffuse as u32) & (w.alive[i] == YES);
        let wo_z = w.wo.at(i).z;
        let back = wo_z < 0.0;
        let scatters = (wo_z > 0.0) | back & (w.two_sided[i] == YES);
        let ng = w.ng.at(i);
        let frame = Frame { t: w.tangent.at(i), b: w.bitangent.at(i), n: ng };
        let (u, reflectance, throughput) = (Vec2::new(w.u[0][i], w.u[1][i]), w.reflectance.at(i), w.throughput.at(i));
        let (wi, pdf, weight) = if AIMED {
            let cones = w.aim.cones(i);
            let (aimed, direction, u) = cones.choose(u);
            let mut local = cosine_hemisphere(u);
            let above = select(aimed, select(back, -1.0, 1.0) * frame.to_local(direction).z, local.z);
            local.z = select(back, -local.z, local.z);
            let wi = select3(aimed, direction, frame.to_world(local));
            let (scatter_pdf, some) = (above * INV_PI, above > 0.0);
            let pdf = cones.density(wi, scatter_pdf);
            let weight = select3(some, reflectance * scatter_pdf / pdf, Rgb::ZERO);
            w.eta2[i] *= select(diffuse & some, pdf / scatter_pdf, 1.0);
            (wi, w.ways[i] * pdf, weight)
        } else {
            let mut local = cosine_hemisphere(u);
            let pdf = w.ways[i] * (local.z * INV_PI);
            local.z = select(back, -local.z, local.z);
            (frame.to_world(local), pdf, reflectance)
        };
        let agrees = (wi.dot(ng) > 0.0) == (w.front[i] == YES);
        let scattered = throughput * weight;
        let nothing = (scattered.x == 0.0) & (scattered.y == 0.0) & (scattered.z == 0.0);
        let ended = diffuse & !(scatters & agrees & !nothing & (w.depth[i] + 1 != last));
        w.wi.set(i, wi);
        w.throughput.set(i, select3(diffuse, scattered, throughput));
        w.pdf[i] = select(diffuse, pdf, w.pdf[i]);
        w.ended[i] = Flag::from(ended);
        w.came[i] = came;
    }
}

stage! {
    /// The direction to which a facet of rough metal reflects each path; lanes of other materials are left alone.
    pub(super) fn scatter_facets(w: &mut Wave) {
        for i in 0..covering(w.n) {
            let rough = w.scatters[i] as u32 == Scatters::Facets as u32;
            let wo = w.wo.at(i);
            let back = wo.z < 0.0;
            let scatters = (wo.z > 0.0) | back & (w.two_sided[i] == YES);
            let above = Rgb::new(wo.x, wo.y, wo.z.abs());
            let ggx = Ggx::with_alphas([w.alphas[0][i], w.alphas[1][i]]);
            let (mut local, facets) = Facets::drawn(&ggx, above, Vec2::new(w.u[0][i], w.u[1][i]));
            local.z = select(back, -local.z, local.z);
            let wi = Frame { t: w.tangent.at(i), b: w.bitangent.at(i), n: w.ng.at(i) }.to_world(local);
            w.wi.set(i, select3(rough, wi, w.wi.at(i)));
            w.facet_cos[i] = facets.cos;
            w.facet_value[i] = facets.value;
            w.facet_pdf[i] = select(scatters & facets.some, facets.pdf, -1.0);
        }
    }
}

stage! {
    /// Roulette by throughput below `weight`, with numbers of a plain sampler.
    pub(super) fn roulette(w: &mut Wave, after: u32, weight: f32, batches: Batches) {
        match batches.code() {
            TABLED => roulette_by::<TABLED>(w, after, weight, batches),
            COMPUTED => roulette_by::<COMPUTED>(w, after, weight, batches),
            TABLED_FORKED => roulette_by::<TABLED_FORKED>(w, after, weight, batches),
            _ => roulette_by::<COMPUTED_FORKED>(w, after, weight, batches),
        }
    }
}

#[inline(always)]
fn roulette_by<const CODE: u32>(w: &mut Wave, after: u32, weight: f32, batches: Batches) {
    for i in 0..covering(w.n) {
        let throughput = w.throughput.at(i);
        let left = throughput * w.eta2[i];
        let (xy, z) = (select(left.x > left.y, left.x, left.y), left.z);
        let q = select(xy > z, xy, z) / weight;
        let dimension = dimension::at(w.depth[i], dimension::ROULETTE);
        let u = plain_one::<CODE>(w.key[i], w.index[i], w.forked[i] == YES, batches, dimension);
        let plays = (w.alive[i] == YES) & (w.depth[i] + 1 > after) & (q < 1.0);
        w.ended[i] = Flag::from(plays & (u >= q));
        w.throughput.set(i, select3(plays, throughput / q, throughput));
    }
}

stage! {
    /// Rays along the directions chosen, from the surface.
    pub(super) fn spawn_rays(w: &mut Wave) {
        for i in 0..covering(w.n) {
            w.depth[i] += 1;
            w.ways[i] = select(w.forked[i] == YES, 1.0, w.ways[i]);
            let ray = spawn(w.p.at(i), w.p_error.at(i), w.ng.at(i), w.wi.at(i));
            w.origin.set(i, ray.origin);
            w.direction.set(i, ray.direction);
            w.t_max[i] = ray.t_max;
            let (wi, ng) = (w.wi.at(i), w.ng.at(i));
            let cosine = wi.dot(ng);
            let leaves = u32::from(cosine * cosine > FLAT * wi.length_squared()).wrapping_neg();
            w.spared[0][i] = w.own[0][i] & leaves;
            w.spared[1][i] = w.own[1][i] & leaves;
            w.from.set(i, w.p.at(i));
            w.from_n.set(i, w.n_reflecting.at(i));
        }
    }
}

stage! {
    /// Shadow rays from all starts of a group to `count` ends at once, and the densities of those.
    pub(super) fn join(w: &mut Wave, count: usize) {
        for k in 0..AT_ONCE {
            let (finder, end, _) = w.group.ends[k];
            let used = k < count;
            for j in 0..MEMBERS {
                let i = k * MEMBERS + j;
                let g = &w.group;
                let start = Joint { p: g.p.at(i), p_error: g.p_error.at(i), ng: g.ng.at(i), n: g.n.at(i) };
                let density = density(&start, &end);
                let some = (density > 0.0) & (g.starts[i] == YES) & used;
                let ray = spawn_to(start.p, start.p_error, start.ng, end.p, end.p_error, end.ng);
                let d = ray.direction;
                let cosine = d.dot(start.ng);
                let leaves = u32::from(cosine * cosine > FLAT * d.length_squared()).wrapping_neg();
                let spared = [g.own[0][i] & leaves, g.own[1][i] & leaves];
                w.density[i] = select(some, density, 0.0);
                w.lit[i] = Flag::from(some & (j as u32 != finder));
                w.shadow_origin.set(i, ray.origin);
                w.shadow_direction.set(i, d);
                w.shadow_t_max[i] = ray.t_max;
                (w.shadow_spared[0][i], w.shadow_spared[1][i]) = (spared[0], spared[1]);
            }
        }
    }
}

stage! {
    /// Give all members of a group their parts of what was found at `count` ends.
    pub(super) fn give(w: &mut Wave, count: usize) {
        for k in 0..count.min(AT_ONCE) {
            let (finder, _, light) = w.group.ends[k];
            let mut seen = [0.0; MEMBERS];
            for j in 0..MEMBERS {
                let i = k * MEMBERS + j;
                let open = (j as u32 == finder) | (w.lit[i] == YES) & (w.occluded[i] == NO);
                seen[j] = select(open, w.density[i], 0.0);
            }
            let (total, told) = total(&seen, finder as usize);
            for j in 0..MEMBERS {
                let i = k * MEMBERS + j;
                let alone = select(j as u32 == finder, 1.0, 0.0);
                let part = select(told, seen[j] / total, alone);
                let sum = w.group.sum.at(i);
                w.group.sum.set(i, sum + w.group.weight.at(i) * (light * part));
            }
        }
    }
}
