//! Light: which light a hit samples, where on it, and with what density.
//!
//! Every density is per solid angle as seen from the reference point and includes the choice of the
//! light. What a sample carries and what is computed later for a scattered ray that found the same
//! emitter come from the same functions. This module knows nothing of rays, materials or textures: an
//! emitter is a primitive in world space and has one radiance.

mod alias;
mod ball;
mod choice;
mod cone;
mod delta;
mod emitter;
mod environment;
mod few_balls;
mod lamp;
mod many;
mod shard;
mod sphere_cone;
mod spherical_rectangle;
mod spherical_triangle;
pub mod textbook;
mod tree;

use std::sync::{Arc, OnceLock};

use common::method::{LightPick, LightSampling, Method};

pub use alias::AliasTable;
pub(crate) use ball::Ball;
pub use delta::DeltaLight;
pub use emitter::{Emitter, EmitterSample, Stratum};
pub use environment::{Environment, ImageEnvironment};
pub(crate) use few_balls::{FewBalls, of_child};
pub use lamp::{Lamp, LampSample};
pub(crate) use many::{AtOnce, Drawn};
pub(crate) use shard::Shard;
pub use tree::group_importance;

use self::choice::TreeChoice;
use crate::math::{Rgb, Vec2, Vec3, select};

/// Who asks for light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    /// Where.
    pub p: Vec3,
    /// The unit shading normal on the side that `p` reflects from, where it only reflects: light from
    /// behind is then of no use. 0 in volumes and on surfaces that transmit.
    pub n: Vec3,
}

/// Light from one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightSample {
    /// Unit vector towards the light.
    pub wi: Vec3,
    /// The point that it comes from; 0 where that is infinitely far away.
    pub point: Vec3,
    /// Bound of the point's error.
    pub point_error: Vec3,
    /// Unit geometric normal of the emitter's front at the point; 0 where there is no surface.
    pub ng: Vec3,
    /// Distance of the point; infinite for environments and directional lights.
    pub distance: f32,
    /// Radiance, shadows left out; for lights without a surface the irradiance on a surface that faces them.
    pub radiance: Rgb,
    /// Density per solid angle, the choice of the light included; of `delta` lights that choice alone.
    pub pdf: f32,
    /// Whether no ray can hit the light: its sample is the only way to find it.
    pub delta: bool,
    /// The emitter, of light from a surface.
    pub emitter: Option<u32>,
    /// Where on the emitter: barycentrics (b1, b2) of a triangle, multiples of the edges of a rectangle.
    pub coordinates: Vec2,
}

/// Emitters with one radiance: an emissive mesh, sphere, quad or disk. It counts as one light.
#[derive(Debug, Clone)]
pub struct AreaLight {
    /// Its primitives.
    pub emitters: Vec<Emitter>,
    /// Radiance.
    pub radiance: Rgb,
    /// Whether the back shines too.
    pub two_sided: bool,
}

/// All light of a scene.
#[derive(Debug, Clone, Default)]
pub struct LightSources {
    /// Surfaces. Their primitives are numbered through in this order: the numbers of emitters.
    pub areas: Vec<AreaLight>,
    /// Lights without a surface.
    pub deltas: Vec<DeltaLight>,
    /// What rays that leave the scene meet.
    pub environment: Option<Environment>,
    /// Radius of a sphere around all that can be lit: weighs light from infinitely far away.
    pub scene_radius: f32,
}

/// The lights of a scene, ready to be sampled. Lights are numbered: areas, then deltas, then the environment.
///
/// All but the last two is the same for every method, and shared.
#[derive(Debug, Clone)]
pub struct Lights {
    emitters: Arc<[Primitive]>,
    areas: Arc<[Area]>,
    deltas: Arc<[DeltaLight]>,
    environment: Option<Arc<Environment>>,
    /// Power of each light, W.
    powers: Arc<[f64]>,
    /// Lights with any power.
    live: Arc<[u32]>,
    /// The light tree, once a method has asked for it.
    tree: Arc<OnceLock<Arc<TreeChoice>>>,
    choice: Choice,
    sampling: LightSampling,
}

#[derive(Debug, Clone)]
struct Primitive {
    shape: Emitter,
    area: u32,
}

#[derive(Debug, Clone)]
struct Area {
    first: u32,
    /// Chooses a primitive in proportion to its area.
    table: AliasTable,
    radiance: Rgb,
    two_sided: bool,
}

#[derive(Debug, Clone)]
enum Choice {
    /// Every live light.
    All,
    /// One light, the same chances everywhere.
    Table(AliasTable),
    /// One emitter or light, chances by place.
    Tree(Arc<TreeChoice>),
}

/// What gives light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    Emitter(u32),
    Delta(u32),
    Environment,
}

impl Lights {
    /// Prepare the lights for `method`. Where it leaves the choice open, a lone light without parts is
    /// taken as it is, and the light tree chooses among several.
    #[must_use]
    pub fn build(sources: LightSources, method: &Method) -> Self {
        let LightSources { areas: sources, deltas, environment, scene_radius } = sources;
        let (mut emitters, mut areas, mut powers) = (Vec::new(), Vec::new(), Vec::new());
        for source in sources {
            let sizes: Vec<f64> = source.emitters.iter().map(Emitter::area).collect();
            let sides = if source.two_sided { 2.0 } else { 1.0 };
            let total: f64 = sizes.iter().filter(|size| size.is_finite()).sum();
            powers.push(sides * std::f64::consts::PI * total * delta::mean(source.radiance));
            let area = areas.len() as u32;
            areas.push(Area {
                first: emitters.len() as u32,
                table: AliasTable::new(&sizes),
                radiance: source.radiance,
                two_sided: source.two_sided,
            });
            emitters.extend(source.emitters.into_iter().map(|shape| Primitive { shape, area }));
        }
        // Nothing but its ratio to other lights depends on the radius.
        let radius = if scene_radius > 0.0 { f64::from(scene_radius) } else { 1.0 };
        powers.extend(deltas.iter().map(|light| light.power(radius)));
        powers.extend(environment.iter().map(|environment| environment.power(radius)));
        let is_live = |&i: &u32| powers[i as usize] > 0.0 && powers[i as usize].is_finite();
        let lights = Self {
            live: (0..powers.len() as u32).filter(is_live).collect(),
            emitters: emitters.into(),
            areas: areas.into(),
            deltas: deltas.into(),
            environment: environment.map(Arc::new),
            powers: powers.into(),
            tree: Arc::default(),
            choice: Choice::All,
            sampling: LightSampling::SolidAngle,
        };
        lights.with_method(method)
    }

    /// The same lights for another method. What both need is shared, the light tree too.
    #[must_use]
    pub fn with_method(&self, method: &Method) -> Self {
        let Self { emitters, areas, deltas, powers, live, .. } = self;
        let pick = method.light_pick.unwrap_or_else(|| {
            let is_simple = live.len() <= 1 && areas.iter().all(|area| area.table.len() <= 1);
            if is_simple { LightPick::One } else { LightPick::Tree }
        });
        let choice = match pick {
            LightPick::All => Choice::All,
            LightPick::One => {
                let equal: Vec<f64> =
                    powers.iter().map(|&p| if p > 0.0 && p.is_finite() { 1.0 } else { 0.0 }).collect();
                Choice::Table(AliasTable::new(&equal))
            }
            LightPick::Power => Choice::Table(AliasTable::new(powers)),
            LightPick::Tree => {
                let build = || Arc::new(TreeChoice::new(emitters, areas, deltas, live));
                Choice::Tree(Arc::clone(self.tree.get_or_init(build)))
            }
        };
        let sampling = method.light_sampling.unwrap_or(LightSampling::SolidAngle);
        Self { choice, sampling, ..self.clone() }
    }

    /// Whether a picture surrounds the scene.
    #[must_use]
    pub fn has_picture(&self) -> bool {
        matches!(self.environment.as_deref(), Some(Environment::Image(_)))
    }

    /// Number of the first emitter of the area light `index`; its primitives follow in order.
    #[must_use]
    pub fn first_emitter(&self, index: usize) -> Option<u32> {
        self.areas.get(index).map(|area| area.first)
    }

    /// How many lights there are; a mesh, whatever its number of triangles, is one.
    #[must_use]
    pub fn count(&self) -> usize {
        self.areas.len() + self.deltas.len() + usize::from(self.environment.is_some())
    }

    /// At most how many samples [`Lights::for_each`] gives.
    #[must_use]
    pub fn samples_at_once(&self) -> u32 {
        if matches!(self.choice, Choice::All) { self.live.len() as u32 } else { 1 }
    }

    /// The only light there is, where it is one rectangle sampled by solid angle.
    #[must_use]
    pub fn lone_rectangle(&self) -> Option<Lamp> {
        let (Choice::Table(_), [light]) = (&self.choice, &self.live[..]) else { return None };
        let area = self.areas.get(*light as usize)?;
        if area.table.len() != 1 || self.sampling != LightSampling::SolidAngle {
            return None;
        }
        Lamp::new(area.first, &self.emitters[area.first as usize].shape, area.radiance, area.two_sided)
    }

    /// Whether nothing shines.
    #[must_use]
    pub fn is_dark(&self) -> bool {
        self.live.is_empty()
    }

    /// Light for one hit: one sample of every light under `--light-pick all`, else one sample of one light.
    /// `draw` gives the numbers of a sample: the choice of the light, and the place on it. `visit` is
    /// called for each sample that may bring light. Add up `radiance x BSDF / pdf`; with `stratum.count`
    /// such rounds a hit, divide the sum by their number.
    #[inline]
    pub fn for_each(
        &self,
        reference: &Reference,
        stratum: Stratum,
        mut draw: impl FnMut() -> (f32, Vec2),
        mut visit: impl FnMut(LightSample),
    ) {
        match &self.choice {
            Choice::Tree(tree) => {
                let (pick, u) = draw();
                if let Some((source, probability)) = tree.pick(reference, alias::lengthen(pick, u))
                    && let Some(sample) = self.sample_source(source, probability, reference, u, stratum)
                {
                    visit(sample);
                }
            }
            Choice::All => {
                for &light in self.live.iter() {
                    let (pick, u) = draw();
                    if let Some(sample) = self.sample_light(light, 1.0, alias::lengthen(pick, u), reference, u, stratum)
                    {
                        visit(sample);
                    }
                }
            }
            Choice::Table(table) => {
                let (pick, u) = draw();
                if let Some((light, probability, rest)) = table.pick(alias::lengthen(pick, u))
                    && let Some(sample) = self.sample_light(light, probability, rest, reference, u, stratum)
                {
                    visit(sample);
                }
            }
        }
    }

    /// One sample of one light; `None` where it brings none. Under `--light-pick all` it is of a light
    /// chosen with equal chances, and [`Lights::for_each`] is what goes with [`Lights::pdf`].
    #[inline]
    #[must_use]
    pub fn sample(&self, reference: &Reference, pick: f32, u: Vec2) -> Option<LightSample> {
        let mut found = None;
        if let Choice::All = self.choice {
            let count = self.live.len();
            let scaled = alias::lengthen(pick, u) * count as f64;
            let index = (scaled as usize).min(count.checked_sub(1)?);
            return self.sample_light(
                self.live[index],
                1.0 / count as f32,
                scaled - index as f64,
                reference,
                u,
                Stratum::ONLY,
            );
        }
        self.for_each(reference, Stratum::ONLY, || (pick, u), |sample| found = Some(sample));
        found
    }

    /// Density per solid angle, choice included, with which light sampling at `reference` chooses `point`
    /// on `emitter`: for the weight of a scattered ray that hit it there.
    #[inline]
    #[must_use]
    pub fn pdf(&self, reference: &Reference, emitter: u32, point: Vec3) -> f32 {
        let Some(primitive) = self.emitters.get(emitter as usize) else { return 0.0 };
        let area = &self.areas[primitive.area as usize];
        if !area.two_sided && !primitive.shape.front_faces(reference.p) {
            return 0.0;
        }
        let within = || area.table.probability(emitter - area.first);
        let chosen = match &self.choice {
            Choice::All => within(),
            Choice::Table(table) => table.probability(primitive.area) * within(),
            Choice::Tree(tree) => tree.probability(reference, Source::Emitter(emitter)),
        };
        if chosen > 0.0 { with_choice(chosen, primitive.shape.pdf(self.sampling, reference.p, point)) } else { 0.0 }
    }

    /// The same for a scattered ray that left the scene along the unit vector `wi`.
    #[inline]
    #[must_use]
    pub fn environment_pdf(&self, reference: &Reference, wi: Vec3) -> f32 {
        let Some(environment) = &self.environment else { return 0.0 };
        let chosen = match &self.choice {
            Choice::All => 1.0,
            Choice::Table(table) => table.probability((self.areas.len() + self.deltas.len()) as u32),
            Choice::Tree(tree) => tree.probability(reference, Source::Environment),
        };
        if chosen > 0.0 { with_choice(chosen, environment.pdf(reference.n, wi)) } else { 0.0 }
    }

    /// Radiance that arrives from outside the scene along the unit vector `wi`.
    #[inline]
    #[must_use]
    pub fn environment(&self, wi: Vec3) -> Rgb {
        self.environment.as_ref().map_or(Rgb::ZERO, |environment| environment.radiance(wi))
    }

    /// Radiance that leaves `emitter` from its front or its back.
    #[inline]
    #[must_use]
    pub fn emitted(&self, emitter: u32, front: bool) -> Rgb {
        let Some(primitive) = self.emitters.get(emitter as usize) else { return Rgb::ZERO };
        let area = &self.areas[primitive.area as usize];
        if front || area.two_sided { area.radiance } else { Rgb::ZERO }
    }

    /// A sample of the light with this number, which was chosen with probability `chosen`; `rest` chooses
    /// within it.
    #[inline]
    fn sample_light(
        &self,
        light: u32,
        chosen: f32,
        rest: f64,
        reference: &Reference,
        u: Vec2,
        stratum: Stratum,
    ) -> Option<LightSample> {
        let (source, chosen) = self.source(light, chosen, rest)?;
        self.sample_source(source, chosen, reference, u, stratum)
    }

    /// What `rest` chooses of the light with this number, which was chosen with probability `chosen`; and the probability of
    /// both.
    #[inline]
    fn source(&self, light: u32, chosen: f32, rest: f64) -> Option<(Source, f32)> {
        let index = light as usize;
        if let Some(area) = self.areas.get(index) {
            let (primitive, probability, _) = area.table.pick(rest)?;
            return Some((Source::Emitter(area.first + primitive), chosen * probability));
        }
        let delta = index - self.areas.len();
        Some((if delta < self.deltas.len() { Source::Delta(delta as u32) } else { Source::Environment }, chosen))
    }

    /// A sample of what was chosen with probability `chosen`.
    #[inline]
    fn sample_source(
        &self,
        source: Source,
        chosen: f32,
        reference: &Reference,
        u: Vec2,
        stratum: Stratum,
    ) -> Option<LightSample> {
        match source {
            Source::Emitter(emitter) => {
                let primitive = &self.emitters[emitter as usize];
                let area = &self.areas[primitive.area as usize];
                let shape = &primitive.shape;
                if !area.two_sided && !shape.front_faces(reference.p) {
                    return None;
                }
                let sample = shape.sample(self.sampling, reference.p, u, stratum)?;
                // The far side of a sphere, or its outside seen from within.
                let is_round = matches!(shape, Emitter::Sphere { .. });
                if is_round && !area.two_sided && sample.ng.dot(sample.wi) >= 0.0 {
                    return None;
                }
                Some(LightSample {
                    wi: sample.wi,
                    point: sample.point,
                    point_error: sample.point_error,
                    ng: sample.ng,
                    distance: sample.distance,
                    radiance: area.radiance,
                    pdf: with_choice(chosen, sample.pdf),
                    delta: false,
                    emitter: Some(emitter),
                    coordinates: sample.coordinates,
                })
            }
            Source::Delta(index) => {
                let arrival = self.deltas[index as usize].at(reference.p)?;
                Some(LightSample {
                    wi: arrival.wi,
                    point: arrival.position,
                    point_error: Vec3::ZERO,
                    ng: Vec3::ZERO,
                    distance: arrival.distance,
                    radiance: arrival.irradiance,
                    pdf: chosen,
                    delta: true,
                    emitter: None,
                    coordinates: Vec2::ZERO,
                })
            }
            Source::Environment => {
                let environment = self.environment.as_ref()?;
                let wi = environment.sample(reference.n, u);
                let pdf = with_choice(chosen, environment.pdf(reference.n, wi));
                let radiance = environment.radiance(wi);
                (pdf > 0.0 && radiance.max_element() > 0.0).then_some(LightSample {
                    wi,
                    point: Vec3::ZERO,
                    point_error: Vec3::ZERO,
                    ng: Vec3::ZERO,
                    distance: f32::INFINITY,
                    radiance,
                    pdf,
                    delta: false,
                    emitter: None,
                    coordinates: Vec2::ZERO,
                })
            }
        }
    }
}

/// The density of a place on a light times the probability of the light: finite, and above 0 if the
/// density is.
#[inline(always)]
fn with_choice(chosen: f32, pdf: f32) -> f32 {
    let product = chosen * pdf;
    let product = select(product > f32::MIN_POSITIVE, product, f32::MIN_POSITIVE);
    select(pdf > 0.0, select(product < f32::MAX, product, f32::MAX), 0.0)
}

#[cfg(test)]
mod tests;
