//! The scene as rendering needs it: shapes with their surfaces, materials, lights, camera, and the facts
//! that choose the kernel.
//!
//! [`Draft::compile`] makes it from a scene file standing at one frame; [`Draft::build`] adds the
//! acceleration structure. Transforms are applied in f64 and rounded to f32 once. This module knows
//! nothing of paths or samples.

mod aims;
mod compile;
mod mesh;
mod record;
mod surface;
mod values;

use std::sync::{Arc, OnceLock};

use common::method::{self, Direct, Method};

use crate::{
    camera::Camera,
    geometry::{Accel, BuildMethod, Counters, Hit, InstructionSet, Options, Ray, Spared, TriangleTest, World},
    light::{Lamp, Lights},
    material::{Flat, Material},
    math::{DAffine3, Rgb, Vec2, Vec3},
    special::{Special, Without},
};

pub(crate) use aims::Aims;
pub use common::plan::Facts;
pub use record::Record;
use surface::Surface;
pub use surface::{NO_EMITTER, Point};

/// A scene without its acceleration structure.
#[derive(Debug)]
pub struct Draft {
    world: World,
    scene: Parts,
    lights: Lights,
    options: Options,
    warnings: Vec<String>,
}

/// A scene ready to render.
#[derive(Debug)]
pub struct Scene {
    accel: Arc<Accel>,
    parts: Arc<Parts>,
    lights: Lights,
    /// Where the world needs no tree, its primitives.
    records: Arc<[Record]>,
    /// And of each emitter there that is a sphere, its bit in [`Rays::ended`](crate::geometry::Rays); other emitters have
    /// none, and the last ones may be missing.
    rounds: Arc<[u32]>,
    /// Surfaces with deltas; and what vertices aim at, once a method has asked for it.
    objects: Arc<aims::Objects>,
    aims: Arc<OnceLock<Aims>>,
    without: Without,
}

/// All of a scene but where its surfaces are and how its lights are sampled.
#[derive(Debug)]
struct Parts {
    camera: Camera,
    materials: Vec<Material>,
    /// Of each material, what is the same all over it.
    flats: Vec<Flat>,
    /// Surfaces of the world's own shapes, then those of each object in turn.
    surfaces: Vec<Surface>,
    /// Of each instance: where its object's surfaces begin, and its linear maps.
    instances: Vec<Placement>,
    /// Of each emitter, its surface and primitive; empty where no emission varies over a surface or is masked.
    emitters: Vec<(u32, u32)>,
    facts: Facts,
}

/// An instance, as shading needs it.
#[derive(Debug, Clone, Copy)]
struct Placement {
    first_surface: u32,
    /// Columns of the map of directions.
    linear: [Vec3; 3],
    /// Columns of the map of normals: the inverse's transpose, up to its length.
    normal: [Vec3; 3],
}

impl Placement {
    fn new(first_surface: u32, to_world: DAffine3) -> Self {
        let columns = |m: glam::DMat3| [m.x_axis, m.y_axis, m.z_axis].map(|c| c.as_vec3());
        let m = to_world.matrix3;
        Self { first_surface, linear: columns(m), normal: columns(m.inverse().transpose()) }
    }
}

fn apply(columns: &[Vec3; 3], v: Vec3) -> Vec3 {
    columns[0] * v.x + columns[1] * v.y + columns[2] * v.z
}

impl Draft {
    /// What was dropped or assumed, a sentence each.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Where the surfaces are, and how their acceleration structure is to be built.
    #[must_use]
    pub fn world(&self) -> (&World, Options) {
        (&self.world, self.options)
    }

    /// Build the acceleration structure. The specialisations in `without` are left unused.
    #[must_use]
    pub fn build(mut self, without: Without) -> Scene {
        let leaves = |special| without.leaves(special);
        self.options.few &= !leaves(Special::Few);
        self.options.quads &= !leaves(Special::Quads);
        match (leaves(Special::Avx512), leaves(Special::Avx2), self.options.instructions) {
            (_, true, InstructionSet::Avx512 | InstructionSet::Avx2) => {
                self.options.instructions = InstructionSet::Sse2
            }
            (true, false, InstructionSet::Avx512) => self.options.instructions = InstructionSet::Avx2,
            _ => {}
        }
        let mut parts = self.scene;
        if leaves(Special::Lambert) {
            parts.flats.iter_mut().for_each(|flat| flat.diffuse = None);
        }
        if leaves(Special::Facets) {
            parts.flats.iter_mut().for_each(|flat| flat.facets = None);
        }
        let objects = Arc::new(aims::Objects::of(&self.world, &parts));
        let accel = Accel::build_with(self.world, self.options);
        let records = record::of(&accel, &parts);
        let rounds = record::rounds(&accel, &records).into();
        let (accel, parts, records) = (Arc::new(accel), Arc::new(parts), records.into());
        Scene { accel, parts, lights: self.lights, records, rounds, objects, aims: Arc::default(), without }
    }
}

fn geometry_options(method: &Method) -> Options {
    let test = match method.triangle {
        method::TriangleTest::Watertight => TriangleTest::Watertight,
        method::TriangleTest::MoellerTrumbore => TriangleTest::MoellerTrumbore,
    };
    let split = match method.bvh {
        method::Bvh::Sah => BuildMethod::Sah,
        method::Bvh::MeanCentroid => BuildMethod::MeanCentroid,
        method::Bvh::Midpoint => BuildMethod::Midpoint,
    };
    Options { test, method: split, ..Options::default() }
}

impl Scene {
    /// The camera.
    #[inline]
    #[must_use]
    pub fn camera(&self) -> &Camera {
        &self.parts.camera
    }

    /// The lights.
    #[inline]
    #[must_use]
    pub fn lights(&self) -> &Lights {
        &self.lights
    }

    /// The same scene for `method`, which may differ from the one it was compiled for in how lights are chosen
    /// and sampled and how paths go; `None` where more than that depends on it. Geometry and materials are
    /// shared.
    #[must_use]
    pub fn with_method(&self, old: &Method, method: &Method) -> Option<Scene> {
        let geometry = |m: &Method| (m.triangle, m.bvh, m.fresnel);
        // A picture that is sampled beside BSDFs leaves to them what is dim (`ImageEnvironment::compensated`).
        let beside = |m: &Method| matches!(m.direct, Direct::Mis | Direct::Auto);
        let fits = geometry(old) == geometry(method) && (!self.lights.has_picture() || beside(old) == beside(method));
        fits.then(|| Scene {
            accel: Arc::clone(&self.accel),
            parts: Arc::clone(&self.parts),
            lights: self.lights.with_method(method),
            records: Arc::clone(&self.records),
            rounds: Arc::clone(&self.rounds),
            objects: Arc::clone(&self.objects),
            aims: Arc::clone(&self.aims),
            without: self.without,
        })
    }

    /// The same scene with more specialisations left unused; `None` where it must be built anew for that.
    #[must_use]
    pub fn leaving(&self, without: Without) -> Option<Scene> {
        let built = [Special::Few, Special::Quads, Special::Lambert, Special::Facets, Special::Avx512, Special::Avx2];
        let fits = self.without == Without::NOTHING && !built.iter().any(|special| without.leaves(*special));
        fits.then(|| Scene {
            accel: Arc::clone(&self.accel),
            parts: Arc::clone(&self.parts),
            lights: self.lights.clone(),
            records: Arc::clone(&self.records),
            rounds: Arc::clone(&self.rounds),
            objects: Arc::clone(&self.objects),
            aims: Arc::clone(&self.aims),
            without,
        })
    }

    /// Specialisations that are left unused.
    #[must_use]
    pub fn without(&self) -> Without {
        self.without
    }

    /// What the scene needs.
    #[inline]
    #[must_use]
    pub fn facts(&self) -> &Facts {
        &self.parts.facts
    }

    /// Whether Lambert's law with one colour is the whole of any material.
    #[must_use]
    pub fn has_lambert(&self) -> bool {
        self.parts.flats.iter().any(|flat| flat.diffuse.is_some())
    }

    /// Whether rough metal of one tint is the whole of any material.
    #[must_use]
    pub fn has_facets(&self) -> bool {
        self.parts.flats.iter().any(|flat| flat.facets.is_some())
    }

    /// What vertices aim at.
    pub(crate) fn aims(&self) -> &Aims {
        self.aims.get_or_init(|| Aims::of(self))
    }

    /// Where the surfaces are.
    #[inline]
    #[must_use]
    pub fn accel(&self) -> &Accel {
        &self.accel
    }

    /// The nearest surface that `ray` meets.
    #[inline]
    pub fn closest(&self, ray: &Ray, counters: &mut Counters) -> Option<Hit> {
        self.accel.closest(ray, counters)
    }

    /// Whether `ray` meets any surface.
    #[inline]
    pub fn occluded(&self, ray: &Ray, counters: &mut Counters) -> bool {
        self.accel.occluded(ray, counters)
    }

    /// The material of a surface.
    #[inline]
    #[must_use]
    pub fn material(&self, point: &Point) -> &Material {
        &self.parts.materials[point.material as usize]
    }

    /// The material with this number.
    #[inline]
    #[must_use]
    pub fn material_at(&self, index: u32) -> &Material {
        &self.parts.materials[index as usize]
    }

    /// Where the world needs no tree, the primitive with this number.
    #[inline]
    #[must_use]
    pub fn record(&self, primitive: usize) -> &Record {
        &self.records[primitive]
    }

    /// The triangles of a lamp that is the only light, where the world has no tree, and the square of its longest side.
    pub(crate) fn lamp_spared(&self, lamp: &Lamp) -> (Spared, f32) {
        let shine = self.records.iter().enumerate().filter(|(_, record)| record.emitter == lamp.emitter());
        let bits = shine.fold([0; 2], |[low, high], (id, _)| {
            let spared = self.accel.spared(id);
            [low | spared[0], high | spared[1]]
        });
        (bits, lamp.size2())
    }

    /// Where the world has no tree, the bit of an emitter that is a sphere for rays that [end before
    /// it](Accel::round).
    #[inline(always)]
    pub(crate) fn round(&self, emitter: u32) -> u32 {
        self.rounds.get(emitter as usize).copied().unwrap_or(0)
    }

    /// The same of any hit that is on no instance, with the corners of the triangle that was hit.
    #[inline]
    #[must_use]
    pub fn record_of(&self, hit: &Hit, corners: Option<[Vec3; 3]>) -> Record {
        Record::new(&self.parts, hit.shape, hit.primitive, corners)
    }

    /// Everything that shading needs of a hit.
    #[inline]
    #[must_use]
    pub fn point(&self, ray: &Ray, hit: &Hit) -> Point {
        let at = self.accel.surface(ray, hit);
        let placement = (hit.instance != Hit::NO_INSTANCE).then(|| &self.parts.instances[hit.instance as usize]);
        let index = hit.shape + placement.map_or(0, |p| p.first_surface);
        let surface = &self.parts.surfaces[index as usize];
        let mut point = Point {
            p: at.p,
            p_error: at.p_error,
            ng: at.ng,
            ns: at.ng,
            uv: Vec2::ZERO,
            dpdu: Vec3::ZERO,
            dpdv: Vec3::ZERO,
            material: surface.material,
            emitter: surface.emitter(hit.primitive),
            surface: index,
        };
        surface.interpolate(hit, placement, &mut point);
        point
    }

    /// Radiance that a surface gives at `point`, from its front or its back.
    #[inline]
    #[must_use]
    pub fn emitted(&self, point: &Point, front: bool) -> Rgb {
        let constant = self.lights().emitted(point.emitter, front);
        if self.parts.emitters.is_empty() || constant == Rgb::ZERO {
            return constant;
        }
        match &self.parts.surfaces[point.surface as usize].emission {
            Some(texture) => texture.at(point.uv),
            None => constant,
        }
    }

    /// Radiance of a light sample; it differs from the light's own where emission varies over the surface, and
    /// where a mask lets only a share of the surface be there: a ray that hits it meets that share by chance.
    #[inline]
    #[must_use]
    pub fn sampled_radiance(&self, sample: &crate::light::LightSample) -> Rgb {
        let Some(&(surface, primitive)) = sample.emitter.and_then(|e| self.parts.emitters.get(e as usize)) else {
            return sample.radiance;
        };
        let surface = &self.parts.surfaces[surface as usize];
        let material = &self.parts.materials[surface.material as usize];
        if surface.emission.is_none() && !material.has_opacity() {
            return sample.radiance;
        }
        let uv = surface.emitter_uv(primitive, sample);
        let radiance = surface.emission.as_ref().map_or(sample.radiance, |texture| texture.at(uv));
        if material.has_opacity() { radiance * material.opacity(uv) } else { radiance }
    }
}
