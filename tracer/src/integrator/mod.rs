//! The path tracer proper: one sample of one pixel, under every choice of [`Method`].
//!
//! A path starts at the camera and is lengthened by sampling BSDFs; at every vertex light is gathered as
//! the method says. All estimators count light by the number of scatterings on its way: 0 is emission
//! seen directly, 1 direct light. Each number of scatterings is counted by exactly one combination of
//! estimators whose weights sum to 1.
//!
//! Radiance is carried against the light's direction, so shading normals need no correction factor here:
//! f cos is evaluated with the shading normal, which is what the interpolation means. (Particles traced
//! from lights would need one: Veach 1997, section 5.3.) Light may not pass through a surface that only
//! its shading normal lets it pass: a direction counts only where the geometric normal agrees with the
//! shading normal about the side.
//!
//! Nothing is allocated per sample. This module knows nothing of units, images, threads or files.

mod direct;
mod probe;
mod reuse;
mod roulette;
mod wave;

#[cfg(test)]
mod tests;

use common::method::{Aim, Direct, Method, Only, Reuse, Roulette};

use crate::{
    aim::Cones,
    bsdf::{Bsdf, BsdfSample},
    geometry::{Counters, Hit, Ray, Spared, spawn},
    light::{Lamp, Reference},
    math::{Frame, Rgb, Vec2, Vec3, select},
    sampler::Stream,
    scene::{Aims, NO_EMITTER, Point, Scene},
    special::{Special, Without},
};

pub use probe::{End, Probe, Vertex};
pub use reuse::{MEMBERS, Together};
use reuse::{Share, Shares, Sharing};
pub use roulette::survival;
pub use wave::{Compiled, FirstHit, REQUESTS, Traced, WIDTH, Wave};

/// What one sample found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Radiance that arrives at the camera.
    pub radiance: Rgb,
    /// Whether nothing was estimated: the ray missed the scene, or ended on a light that scatters nothing.
    pub known: bool,
}

/// A scene under a method, ready to be sampled.
#[derive(Debug, Clone, Copy)]
pub struct Integrator<'a> {
    scene: &'a Scene,
    /// Most scatterings.
    max_depth: u32,
    /// Fewest and most scatterings of light that counts.
    counted: (u32, u32),
    direct: Strategy,
    light_samples: u32,
    /// In how many ways a path goes on from its first vertex that is no delta.
    splits: u32,
    /// Whether paths of neighbouring pixels share what they find.
    reuse: bool,
    /// What vertices aim at, if they do.
    aims: Option<&'a Aims>,
    roulette: Roulette,
    /// Whether no hit has shading normals, textures, an instance or an opacity mask.
    plain: bool,
    /// Whether masks are looked for.
    masks: bool,
    /// Whether mirrors or smooth glass are.
    deltas: bool,
    /// The only light there is, where it is a rectangle.
    lamp: Option<Lamp>,
    /// The lamp's triangles in a scene without a tree, and the square of its longest side.
    lamp_spared: (Spared, f32),
    without: Without,
}

/// How direct light is estimated; [`Direct`] with `auto` decided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Strategy {
    Bsdf,
    Hemisphere,
    Light,
    Mis,
}

impl Strategy {
    /// Whether light that a scattered ray runs into counts.
    fn rays_find_light(self) -> bool {
        matches!(self, Strategy::Bsdf | Strategy::Mis)
    }

    /// Whether light is sampled at vertices.
    fn samples_lights(self) -> bool {
        matches!(self, Strategy::Light | Strategy::Mis)
    }
}

/// Numbers of decisions ([`Stream`]'s dimensions): two for the camera, then eight a vertex.
mod dimension {
    pub const FILM: u32 = 0;
    pub const LENS: u32 = 1;
    const FIRST: u32 = 2;
    const PER_VERTEX: u32 = 8;
    pub const LIGHT_CHOICE: u32 = 0;
    pub const LIGHT: u32 = 1;
    pub const LOBE: u32 = 2;
    pub const DIRECTION: u32 = 3;
    pub const ROULETTE: u32 = 4;
    pub const OPACITY: u32 = 5;
    pub const HEMISPHERE_OPACITY: u32 = 6;

    /// Decision `which` at the vertex after `depth` scatterings.
    #[inline]
    pub fn at(depth: u32, which: u32) -> u32 {
        FIRST + depth * PER_VERTEX + which
    }
}

/// How the path came to its present vertex: what emission found there counts for.
#[derive(Debug, Clone, Copy)]
enum Arrival {
    /// From the camera, or along a delta: only this way finds it.
    Only,
    /// Along a direction of this density, times the number of such directions, from where light was also sampled.
    Sampled { pdf: f32, from: Reference },
    /// From where light was estimated in full.
    Counted,
}

/// A path on its way.
#[derive(Debug, Clone, Copy)]
struct Walk {
    ray: Ray,
    radiance: Rgb,
    throughput: Rgb,
    /// Product of (n_t / n_i)^2 over refractions: what radiance was compressed by, roulette must not see. Nor that directions
    /// which are aimed carry less.
    eta2: f32,
    arrival: Arrival,
    depth: u32,
    known: bool,
    sharing: Sharing,
}

/// A vertex of a path with its local frame.
struct Shading {
    point: Point,
    frame: Frame,
    bsdf: Bsdf,
    /// Towards the vertex before, unit, in the local frame.
    wo: Vec3,
    /// Whether `wo` is on the geometric front.
    front: bool,
    reference: Reference,
    /// What is aimed at, if the material is no delta.
    cones: Option<Cones>,
}

/// A direction to go on in.
struct Drawn {
    sample: BsdfSample,
    /// The same in the world.
    wi: Vec3,
    /// Its density over that which the BSDF alone would give it.
    denser: f32,
}

impl<'a> Integrator<'a> {
    /// Sample `scene` as `method` says. The scene must have been compiled for the same method.
    #[must_use]
    pub fn new(scene: &'a Scene, method: &Method) -> Self {
        let facts = scene.facts();
        let without = scene.without();
        let masks = facts.opacity || without.leaves(Special::Opacity);
        let counted = match method.only {
            None => (0, u32::MAX),
            Some(Only::Direct) => (1, 1),
            Some(Only::Indirect) => (2, u32::MAX),
        };
        Self {
            scene,
            max_depth: method.max_depth.min(counted.1),
            counted,
            direct: match method.direct {
                Direct::Bsdf => Strategy::Bsdf,
                Direct::Hemisphere => Strategy::Hemisphere,
                Direct::Light => Strategy::Light,
                // Light that no ray can hit leaves nothing to weigh.
                Direct::Mis | Direct::Auto if facts.light_can_be_hit() => Strategy::Mis,
                Direct::Mis | Direct::Auto => Strategy::Light,
            },
            light_samples: method.light_samples,
            splits: method.splits.max(1),
            // Densities of starts are those of Lambert's law (`Method::validate` refuses both).
            reuse: method.reuse == Reuse::Paths && method.aim == Aim::Off && !facts.opacity,
            aims: (method.aim == Aim::Delta).then(|| scene.aims()),
            roulette: method.roulette,
            plain: !facts.attributes() && !masks,
            masks,
            deltas: facts.delta || without.leaves(Special::NoDeltas),
            lamp: scene.lights().lone_rectangle().filter(|_| !without.leaves(Special::Lamp)),
            lamp_spared: scene
                .lights()
                .lone_rectangle()
                .filter(|_| !without.leaves(Special::Planes))
                .map_or(([0; 2], 0.0), |lamp| scene.lamp_spared(&lamp)),
            without,
        }
    }

    /// Whether paths go on in several ways.
    #[must_use]
    pub fn splits(&self) -> bool {
        self.splits > 1
    }

    /// One sample of the pixel at column `x`, row `y`.
    #[inline]
    #[must_use]
    pub fn sample(&self, x: u32, y: u32, stream: &Stream, counters: &mut Counters) -> Sample {
        self.path(x, y, stream, counters, None, None)
    }

    /// The same sample, told to `probe` vertex by vertex.
    #[must_use]
    pub fn probed(&self, x: u32, y: u32, stream: &Stream, counters: &mut Counters, probe: &mut dyn Probe) -> Sample {
        self.path(x, y, stream, counters, Some(probe), None)
    }

    fn path(
        &self,
        x: u32,
        y: u32,
        stream: &Stream,
        counters: &mut Counters,
        mut probe: Option<&mut dyn Probe>,
        mut shares: Option<&mut Shares>,
    ) -> Sample {
        let camera = self.scene.camera();
        let lens = camera.has_lens() || self.without.leaves(Special::Pinhole);
        let u_lens = if lens { stream.two(dimension::LENS) } else { Vec2::ZERO };
        let ray = camera.ray(x, y, stream.two(dimension::FILM), u_lens);
        let mut walk = Walk {
            ray: Ray { origin: ray.origin, direction: ray.direction, t_max: ray.t_max },
            radiance: Rgb::ZERO,
            throughput: Rgb::ONE,
            eta2: 1.0,
            arrival: Arrival::Only,
            depth: 0,
            known: false,
            sharing: Sharing::No,
        };
        let mut stream = *stream;
        let end = loop {
            let share = shares.as_deref_mut().map(|shares| &mut shares.of_ways[0]);
            let shading = match self.arrive(&mut walk, &stream, self.splits, counters, &mut probe, share) {
                Ok(shading) => shading,
                Err(end) => break end,
            };
            if self.splits > 1 && !shading.bsdf.is_delta() {
                break self.split(&mut walk, &shading, &stream, counters, &mut probe, shares.as_deref_mut());
            }
            if let Some(shares) = &mut shares
                && self.start(&mut walk, &shading, &mut shares.of_ways[0])
            {
                stream = shares.rest;
            }
            if let Err(end) = self.scatter(&mut walk, &shading, &stream, 1) {
                break end;
            }
        };
        if let (Some(shares), Sharing::Ended) = (shares, walk.sharing) {
            walk.radiance = shares.of_ways[0].close(walk.radiance);
        }
        if let Some(probe) = probe {
            probe.end(end, walk.radiance);
        }
        Sample { radiance: walk.radiance, known: walk.known }
    }

    /// Go on from a vertex in several ways; each brings its share.
    fn split(
        &self,
        walk: &mut Walk,
        shading: &Shading,
        stream: &Stream,
        counters: &mut Counters,
        probe: &mut Option<&mut dyn Probe>,
        mut shares: Option<&mut Shares>,
    ) -> End {
        let stream = shares.as_ref().map_or(*stream, |shares| shares.rest);
        let mut last = End::Depth;
        let mut sum = Rgb::ZERO;
        walk.known = true;
        for k in 0..self.splits {
            let stream = stream.fork(k, self.splits);
            let mut branch = Walk { radiance: Rgb::ZERO, known: false, ..*walk };
            let mut share = shares.as_deref_mut().map(|shares| &mut shares.of_ways[k as usize]);
            if let Some(share) = &mut share {
                self.start(&mut branch, shading, share);
            }
            let mut scattered = self.scatter(&mut branch, shading, &stream, self.splits);
            last = loop {
                if let Err(end) = scattered {
                    break end;
                }
                scattered = match self.arrive(&mut branch, &stream, 1, counters, probe, share.as_deref_mut()) {
                    Ok(shading) => self.scatter(&mut branch, &shading, &stream, 1),
                    Err(end) => Err(end),
                };
            };
            if let (Some(share), Sharing::Ended) = (share, branch.sharing) {
                branch.radiance = share.close(branch.radiance);
            }
            sum += branch.radiance;
            if let Some(probe) = probe.as_deref_mut() {
                probe.way(branch.radiance);
            }
            walk.known &= branch.known;
        }
        walk.radiance += sum / self.splits as f32;
        last
    }

    /// Follow the ray to its vertex and gather light there; `Err` where the path ends. `splits` is in how many ways it
    /// would go on if this were no delta.
    #[inline(always)]
    fn arrive(
        &self,
        walk: &mut Walk,
        stream: &Stream,
        splits: u32,
        counters: &mut Counters,
        probe: &mut Option<&mut dyn Probe>,
        share: Option<&mut Share>,
    ) -> Result<Shading, End> {
        let depth = walk.depth;
        let opacity = dimension::at(depth, dimension::OPACITY);
        let Some(hit) = self.visible(&mut walk.ray, stream, opacity, counters) else {
            walk.known = depth == 0 && !self.scene.facts().opacity;
            if self.counts(depth) && self.scene.facts().environment {
                let wi = walk.ray.direction.normalize();
                let weight = self.weight(&walk.arrival, |from| self.scene.lights().environment_pdf(from, wi));
                walk.radiance += walk.throughput * (self.scene.lights().environment(wi) * weight);
            }
            return Err(End::Escaped);
        };
        let point = self.scene.point(&walk.ray, &hit);
        if point.emitter != NO_EMITTER && self.counts(depth) {
            walk.radiance += walk.throughput * self.found(&point, &walk.ray, &walk.arrival);
        }
        let to_eye = -walk.ray.direction.normalize();
        let shading = self.shade(point, to_eye);
        if let Some(probe) = probe.as_deref_mut() {
            probe.vertex(&Vertex::new(depth, &shading, hit, walk.throughput, walk.radiance, self.scene));
        }
        if depth >= self.max_depth {
            walk.known = depth == 0 && !self.scene.facts().opacity;
            return Err(End::Depth);
        }
        if let (Some(share), Sharing::Started) = (share, walk.sharing) {
            walk.sharing = Sharing::No;
            if let Some((end, _)) = self.joint(&shading) {
                walk.sharing = Sharing::Ended;
                walk.throughput = share.arrive(end, walk.radiance, walk.throughput);
                walk.radiance = Rgb::ZERO;
            }
        }
        counters.vertices += 1;
        walk.radiance += walk.throughput * self.direct(&shading, depth, splits, stream, counters);
        Ok(shading)
    }

    /// Choose where the path goes on from a vertex, one of `splits` ways; `Err` where it ends.
    #[inline(always)]
    fn scatter(&self, walk: &mut Walk, shading: &Shading, stream: &Stream, splits: u32) -> Result<(), End> {
        // The next segment is worth tracing if the path may go on from its end, or if light that its
        // end gives is counted there.
        let (depth, next) = (walk.depth, walk.depth + 1);
        let delta_only = next == self.max_depth && !self.direct.rays_find_light();
        if delta_only && !self.deltas {
            return Err(End::Depth);
        }
        let u_lobe = stream.one(dimension::at(depth, dimension::LOBE));
        let u = stream.two(dimension::at(depth, dimension::DIRECTION));
        let black = || depth == 0 && !self.scene.facts().opacity && shading.bsdf.albedo() == Rgb::ZERO;
        let drawn = draw(&shading.bsdf, shading.wo, &shading.frame, shading.cones.as_ref(), u_lobe, u);
        let Some(Drawn { sample, wi, denser }) = drawn else {
            walk.known = black();
            return Err(End::Absorbed);
        };
        let leaves_front = (wi.dot(shading.point.ng) > 0.0) != sample.transmission;
        if leaves_front != shading.front {
            return Err(End::Shading);
        }
        walk.throughput *= sample.weight;
        walk.eta2 *= sample.eta * sample.eta * denser;
        if walk.throughput == Rgb::ZERO {
            walk.known = black();
            return Err(End::Absorbed);
        }
        if delta_only && !sample.delta {
            return Err(End::Depth);
        }
        if let Some(q) = survival(self.roulette, next, walk.throughput * walk.eta2) {
            if stream.one(dimension::at(depth, dimension::ROULETTE)) >= q {
                return Err(End::Roulette);
            }
            walk.throughput /= q;
        }
        walk.arrival = match self.direct {
            _ if sample.delta => Arrival::Only,
            Strategy::Bsdf => Arrival::Only,
            Strategy::Mis => Arrival::Sampled { pdf: splits as f32 * sample.pdf, from: shading.reference },
            Strategy::Light | Strategy::Hemisphere => Arrival::Counted,
        };
        walk.ray = spawn(shading.point.p, shading.point.p_error, shading.point.ng, wi);
        walk.depth = next;
        Ok(())
    }

    /// Whether light of `scatterings` belongs to the picture.
    #[inline]
    fn counts(&self, scatterings: u32) -> bool {
        (self.counted.0..=self.counted.1).contains(&scatterings)
    }

    /// The nearest surface that meets light at all: masks are passed at random. `ray` becomes the one that
    /// hit.
    #[inline]
    fn visible(&self, ray: &mut Ray, stream: &Stream, dimension: u32, counters: &mut Counters) -> Option<Hit> {
        let hit = self.scene.closest(ray, counters)?;
        if self.masks { self.behind_masks(hit, ray, stream, dimension, counters) } else { Some(hit) }
    }

    #[inline(never)]
    fn behind_masks(
        &self,
        mut hit: Hit,
        ray: &mut Ray,
        stream: &Stream,
        dimension: u32,
        counters: &mut Counters,
    ) -> Option<Hit> {
        /// A ray through more layers than this is lost.
        const MAX_LAYERS: u32 = 4096;
        for layer in 0..MAX_LAYERS {
            let point = self.scene.point(ray, &hit);
            let opacity = self.scene.material(&point).opacity(point.uv);
            if opacity >= 1.0 || stream.split(layer).one(dimension) < opacity {
                return Some(hit);
            }
            let t_max = ray.t_max - hit.t;
            *ray = Ray { t_max, ..spawn(point.p, point.p_error, point.ng, ray.direction) };
            hit = self.scene.closest(ray, counters)?;
        }
        None
    }

    /// Radiance of an emitter that a ray met, as far as it counts there.
    #[inline]
    fn found(&self, point: &Point, ray: &Ray, arrival: &Arrival) -> Rgb {
        if matches!(arrival, Arrival::Counted) {
            return Rgb::ZERO;
        }
        let emitted = self.scene.emitted(point, ray.direction.dot(point.ng) < 0.0);
        if emitted == Rgb::ZERO {
            return Rgb::ZERO;
        }
        emitted * self.weight(arrival, |from| self.scene.lights().pdf(from, point.emitter, point.p))
    }

    /// Weight of light that a scattered ray found, where light sampling finds it with density `light_pdf`.
    #[inline]
    fn weight(&self, arrival: &Arrival, light_pdf: impl FnOnce(&Reference) -> f32) -> f32 {
        match arrival {
            Arrival::Only => 1.0,
            Arrival::Counted => 0.0,
            Arrival::Sampled { pdf, from } => power_heuristic(*pdf, self.light_samples as f32 * light_pdf(from)),
        }
    }

    /// The local frame, BSDF and light reference of a vertex seen from the unit direction `to_eye`.
    #[inline]
    fn shade(&self, point: Point, to_eye: Vec3) -> Shading {
        let material = self.scene.material(&point);
        let mut frame = material.frame(point.uv, point.ns, point.dpdu, point.dpdv);
        let front = to_eye.dot(point.ng) > 0.0;
        // An interpolated normal that faces away from the eye, at silhouettes, would show the wrong side.
        if (to_eye.dot(frame.n) > 0.0) != front {
            frame = Frame::from_normal_tangent(point.ng, frame.t);
        }
        let bsdf = material.bsdf(point.uv);
        let n = match (material.is_transmissive(), front) {
            (true, _) => Vec3::ZERO,
            (false, true) => frame.n,
            (false, false) => -frame.n,
        };
        let cones = self.aims.filter(|_| !bsdf.is_delta()).map(|aims| Cones::seen_from(aims.at(point.p), point.p, n));
        let reference = Reference { p: point.p, n };
        Shading { wo: frame.to_local(to_eye), reference, point, frame, bsdf, front, cones }
    }
}

/// A direction in which a path goes on from a surface with this BSDF: of what is drawn by the BSDF, and of what is aimed.
/// `None`: the path ends.
#[inline(always)]
fn draw(bsdf: &Bsdf, wo: Vec3, frame: &Frame, cones: Option<&Cones>, u_lobe: f32, u: Vec2) -> Option<Drawn> {
    let Some(cones) = cones else {
        let sample = bsdf.sample(wo, u_lobe, u)?;
        return Some(Drawn { sample, wi: frame.to_world(sample.wi), denser: 1.0 });
    };
    let (aimed, direction, u) = cones.choose(u);
    let (mut sample, f_cos, wi) = if aimed {
        let wi = frame.to_local(direction);
        let eval = bsdf.evaluate(wo, wi);
        if eval.f_cos == Rgb::ZERO {
            return None;
        }
        let transmission = (wi.z > 0.0) != (wo.z > 0.0);
        let sample = BsdfSample { wi, weight: Rgb::ZERO, pdf: eval.pdf, delta: false, transmission, eta: 1.0 };
        (sample, eval.f_cos, direction)
    } else {
        let sample = bsdf.sample(wo, u_lobe, u)?;
        (sample, sample.weight * sample.pdf, frame.to_world(sample.wi))
    };
    let density = cones.density(wi, sample.pdf);
    // Densities of the sharpest lobes may leave what f32 holds.
    let whole = density > 0.0 && density.is_finite() && f_cos.is_finite();
    if aimed && !whole {
        return None;
    }
    if sample.delta || !whole {
        // Only the BSDF draws it.
        let rest = cones.rest();
        sample.weight /= rest;
        return Some(Drawn { sample, wi, denser: rest });
    }
    let denser = select(sample.pdf > 0.0, density / sample.pdf, 1.0);
    (sample.weight, sample.pdf) = (f_cos / density, density);
    Some(Drawn { sample, wi, denser })
}

/// Weight of a sample of density `a` beside another way of density `b` (Veach 1995, exponent 2), by their
/// ratio: squares of large densities overflow, and the usual form then gives 0 or NaN.
#[inline(always)]
#[must_use]
pub fn power_heuristic(a: f32, b: f32) -> f32 {
    let r = b / a;
    select(a > 0.0, 1.0 / (1.0 + r * r), 0.0)
}
