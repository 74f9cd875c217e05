//! Where light comes from that mirrors and smooth glass send on, by place: what vertices aim at ([`crate::aim`]).
//!
//! Light is followed from lamps to surfaces with deltas, and on by way of deltas alone to the first surface that scatters. A grid
//! over the places where it lands remembers, for each surface that it came from, a sphere around the points where it left that. The
//! spheres need neither hold all such points nor be known well: directions outside are left to the BSDF. The numbers are the same in every run,
//! whatever method asked.

use std::collections::BTreeMap;

use common::method::{Method, Sampler as Kind};

use super::{Parts, Scene};
use crate::{
    aim::{MOST, SHARE, Target, Targets},
    geometry::{Bounds, Counters, Ray, Shape, World, spawn},
    light::{Reference, Stratum},
    math::{DVec3, Frame, Vec3, luminance, uniform_sphere},
    sampler::{Sampler, Stream},
};

/// Light paths.
const PATHS: u32 = 1 << 15;
/// Longest way by deltas.
const LONGEST: u32 = 12;
/// Cells along the longest edge of the grid.
const CELLS: f32 = 16.0;
/// Part of the landings that may lie outside of the grid at either end of each axis: far strays would make it coarse.
const STRAYS: f64 = 0.02;
/// Fewest light paths that make a target.
const LEAST: u32 = 2;
/// Radius of a target over the root mean square of distances from its centre; that of points evenly over a disk is the square
/// root of 2.
const REACH: f64 = 1.7;

/// Surfaces with deltas: spheres around them.
#[derive(Debug, Default)]
pub(super) struct Objects(Vec<(Vec3, f32)>);

impl Objects {
    /// Those of a world whose shapes have the surfaces of `parts`.
    pub(super) fn of(world: &World, parts: &Parts) -> Self {
        let bounds = |shape: &Shape| match shape {
            Shape::Mesh(mesh) => {
                mesh.triangles.iter().flatten().fold(Bounds::EMPTY, |all, &v| all.include(mesh.positions[v as usize]))
            }
            Shape::Sphere { center, radius } | Shape::Disk { center, radius, .. } => {
                Bounds { lo: *center - Vec3::splat(*radius), hi: *center + Vec3::splat(*radius) }
            }
        };
        let delta = |surface: usize| parts.materials[parts.surfaces[surface].material as usize].has_delta();
        let mut all = Vec::new();
        let mut add = |sphere: (Vec3, f32)| {
            if sphere.1 > 0.0 && sphere.1.is_finite() && sphere.0.is_finite() {
                all.push(sphere);
            }
        };
        for (i, shape) in world.shapes.iter().enumerate().filter(|(i, _)| delta(*i)) {
            match shape {
                Shape::Sphere { center, radius } => add((*center, *radius)),
                _ => add(bounds(&world.shapes[i]).bounding_sphere()),
            }
        }
        for (instance, placement) in world.instances.iter().zip(&parts.instances) {
            let shapes = &world.objects[instance.object as usize].shapes;
            for (i, shape) in shapes.iter().enumerate() {
                if delta(placement.first_surface as usize + i) {
                    add(bounds(shape).transformed(&instance.to_world, 0.0).bounding_sphere());
                }
            }
        }
        Self(all)
    }
}

/// Light that landed.
struct Landing {
    p: Vec3,
    /// Where it left the last delta.
    from: Vec3,
    /// Of what it left: surface, instance, and whether that was the first delta on its way.
    by: (u32, u32, bool),
    power: f64,
}

/// The grid.
#[derive(Debug, Default)]
pub(crate) struct Aims {
    low: Vec3,
    /// Cells per unit of length.
    scale: f32,
    size: [u32; 3],
    /// Of each cell, the number of its targets.
    cells: Vec<u32>,
    /// Number 0 is none.
    targets: Vec<Targets>,
}

impl Aims {
    /// What a vertex at `p` aims at.
    #[inline(always)]
    pub(crate) fn at(&self, p: Vec3) -> &Targets {
        &self.targets[self.cell(p).map_or(0, |cell| self.cells[cell] as usize)]
    }

    #[inline(always)]
    fn cell(&self, p: Vec3) -> Option<usize> {
        let at = (p - self.low) * self.scale;
        let within = at.x >= 0.0 && at.y >= 0.0 && at.z >= 0.0;
        // `as` saturates.
        let [x, y, z] = [at.x as u32, at.y as u32, at.z as u32];
        let within = within && x < self.size[0] && y < self.size[1] && z < self.size[2];
        within.then(|| ((z * self.size[1] + y) * self.size[0] + x) as usize)
    }

    /// Follow light through `scene`.
    pub(super) fn of(scene: &Scene) -> Self {
        let landings = scene.landings();
        let none = Self { targets: vec![[Target::NONE; MOST]], ..Self::default() };
        if landings.is_empty() {
            return none;
        }
        let mut aims = Self { cells: Vec::new(), ..none }.over(&landings);
        let mut found: BTreeMap<(usize, (u32, u32, bool)), Sums> = BTreeMap::new();
        for landing in &landings {
            if let Some(cell) = aims.cell(landing.p) {
                found.entry((cell, landing.by)).or_default().add(landing);
            }
        }
        aims.cells = vec![0; aims.size.iter().product::<u32>() as usize];
        let mut of_cell: BTreeMap<usize, Vec<Sums>> = BTreeMap::new();
        for ((cell, _), sums) in found {
            if sums.paths >= LEAST {
                of_cell.entry(cell).or_default().push(sums);
            }
        }
        for (cell, mut all) in of_cell {
            all.sort_by(|a, b| b.power.total_cmp(&a.power));
            all.truncate(MOST);
            // By roots: of two sources with the same spread, that is what leaves the least variance.
            let total: f64 = all.iter().map(|sums| sums.power.sqrt()).sum();
            let mut targets = [Target::NONE; MOST];
            for (target, sums) in targets.iter_mut().zip(&all) {
                let share = f64::from(SHARE) * sums.power.sqrt() / total;
                if share.is_finite() {
                    *target = Target { share: share as f32, ..sums.sphere(0.1 / aims.scale) };
                }
            }
            aims.cells[cell] = aims.targets.len() as u32;
            aims.targets.push(targets);
        }
        aims
    }

    /// The grid over nearly all of them.
    fn over(self, landings: &[Landing]) -> Self {
        let strays = (landings.len() as f64 * STRAYS) as usize;
        let along = |axis: usize| {
            let mut all: Vec<f32> = landings.iter().map(|landing| landing.p[axis]).collect();
            all.sort_by(f32::total_cmp);
            (all[strays], all[all.len() - 1 - strays])
        };
        let ends = [along(0), along(1), along(2)];
        let low = Vec3::from_array(ends.map(|(low, _)| low));
        let extent = Vec3::from_array(ends.map(|(low, high)| high - low));
        let longest = extent.max_element();
        let edge = if longest > 0.0 && longest.is_finite() { longest / CELLS } else { 1.0 };
        // Walls along the axes should not stand between two cells.
        let size = (extent / edge).to_array().map(|cells| (cells as u32).min(CELLS as u32) + 2);
        Self { low: low - Vec3::splat(0.37 * edge), scale: 1.0 / edge, size, ..self }
    }
}

/// Sums over light that landed.
#[derive(Default)]
struct Sums {
    paths: u32,
    power: f64,
    from: DVec3,
    squares: f64,
}

impl Sums {
    fn add(&mut self, landing: &Landing) {
        let from = landing.from.as_dvec3();
        self.paths += 1;
        self.power += landing.power;
        self.from += from * landing.power;
        self.squares += from.length_squared() * landing.power;
    }

    /// A sphere around nearly all of the points, no smaller than `least`.
    fn sphere(&self, least: f32) -> Target {
        let center = self.from / self.power;
        let spread = (self.squares / self.power - center.length_squared()).max(0.0).sqrt();
        Target { center: center.as_vec3(), radius: (REACH * spread) as f32 + least, share: 0.0 }
    }
}

impl Scene {
    /// Light that reaches scattering surfaces by way of deltas.
    fn landings(&self) -> Vec<Landing> {
        let mut landings = Vec::new();
        if self.objects.0.is_empty() || self.lights().is_dark() {
            return landings;
        }
        // Not the method's own: what is aimed at must not depend on who asked first.
        let lights = self.lights().with_method(&Method::default());
        let sampler = Sampler::new(Kind::Independent, 0x6169_6D73, 1, 1);
        let mut counters = Counters::default();
        for i in 0..PATHS {
            let stream = sampler.stream(i, 0, 0);
            let (center, radius) =
                self.objects.0[(u64::from(i) * self.objects.0.len() as u64 / u64::from(PATHS)) as usize];
            // Somewhere in the ball around the surface; light on its way there meets the surface or not.
            let depth = stream.one(0);
            let target = center + uniform_sphere(stream.two(1)) * (radius * depth.sqrt());
            let reference = Reference { p: target, n: Vec3::ZERO };
            let draw = || (stream.one(2), stream.two(3));
            lights.for_each(&reference, Stratum { index: 0, count: 1 }, draw, |light| {
                // No ray finds what gives light without a surface.
                if light.delta {
                    return;
                }
                let ray = if light.distance.is_finite() {
                    spawn(light.point, light.point_error, light.ng, -light.wi)
                } else {
                    let away = 4.0 * (self.accel.bounds().diagonal().length() + radius);
                    Ray { origin: target + light.wi * away, direction: -light.wi, t_max: f32::INFINITY }
                };
                let power = f64::from(luminance(light.radiance) / light.pdf) * f64::from(radius * radius);
                if power > 0.0 && power.is_finite() {
                    landings.extend(self.landing(ray, power, &stream, &mut counters));
                }
            });
        }
        landings
    }

    /// Where light along `ray` lands, if it meets a delta first.
    fn landing(&self, mut ray: Ray, power: f64, stream: &Stream, counters: &mut Counters) -> Option<Landing> {
        let mut last = None;
        for step in 0..LONGEST {
            let hit = self.closest(&ray, counters)?;
            let point = self.point(&ray, &hit);
            let material = self.material(&point);
            let to_eye = -ray.direction.normalize();
            let front = to_eye.dot(point.ng) > 0.0;
            let mut frame = material.frame(point.uv, point.ns, point.dpdu, point.dpdv);
            if (to_eye.dot(frame.n) > 0.0) != front {
                frame = Frame::from_normal_tangent(point.ng, frame.t);
            }
            let bsdf = material.bsdf(point.uv);
            let (lobe, u) = (stream.one(8 + 2 * step), stream.two(9 + 2 * step));
            let sample = bsdf.sample(frame.to_local(to_eye), lobe, u).filter(|sample| sample.delta);
            let Some(sample) = sample else {
                let (from, by) = last.filter(|_| !bsdf.is_delta())?;
                return Some(Landing { p: point.p, from, by, power });
            };
            last = Some((point.p, (point.surface, hit.instance, step == 0)));
            ray = spawn(point.p, point.p_error, point.ng, frame.to_world(sample.wi));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use common::scene::SceneFile;
    use serde_json::json;

    use super::*;
    use crate::testing::prepare;

    /// A lamp, a mirror that lies below it, and a ceiling that the mirror throws the lamp's image at.
    fn scene(mirror: &str) -> SceneFile {
        let scene = json!({
            "tessera": 1, "camera": { "position": [0, 1, 6], "target": [0, 1, 0] },
            "materials": { "mirror": { "type": "mirror" }, "wall": { "type": "diffuse" } },
            "shapes": [
                { "type": "disk", "material": mirror, "center": [0, 0, 0], "normal": [0, 1, 0], "radius": 1 },
                { "type": "sphere", "center": [0, 2, 0], "radius": 0.1, "emission": 30 },
                { "type": "quad", "material": "wall", "vertices": [[-4, 4, -4], [4, 4, -4], [4, 4, 4], [-4, 4, 4]] }
            ]
        });
        SceneFile::parse(scene.to_string().as_bytes()).unwrap()
    }

    #[test]
    fn vertices_aim_at_where_the_lamp_is_seen() {
        let prepared = prepare(&scene("mirror"), &Method::default());
        let aims = prepared.scene().aims();
        for x in [-1.5f32, -0.6, 0.0, 0.5, 1.2] {
            let p = Vec3::new(x, 4.0, 0.3);
            // The lamp's image is at (0, -2, 0): a third of the way from there to the ceiling is the mirror.
            let expected = p.with_y(0.0) / 3.0;
            let [first, second, _] = *aims.at(p);
            assert!((first.share - SHARE).abs() < 1e-6 && second.share == 0.0, "{first:?} {second:?}");
            assert!(first.center.distance(expected) < first.radius, "{p}: {first:?}");
            assert!(first.radius < 0.5, "{p}: {first:?}");
        }
        assert_eq!(aims.at(Vec3::new(40.0, 4.0, 0.0)), &[Target::NONE; MOST], "no light lands there");
        let none = prepare(&scene("wall"), &Method::default());
        assert_eq!(none.scene().aims().at(Vec3::new(0.0, 4.0, 0.0)), &[Target::NONE; MOST]);
    }

    #[test]
    fn what_is_aimed_at_depends_on_no_method() {
        let prepared = prepare(&scene("mirror"), &Method::default());
        let other = Method { light_pick: Some(common::method::LightPick::One), light_samples: 4, ..Method::default() };
        let changed = prepared.with_method(&Method::default(), &other).unwrap();
        let compiled = prepare(&scene("mirror"), &other);
        let targets = |prepared: &crate::Prepared| prepared.scene().aims().targets.clone();
        assert_eq!(targets(&changed), targets(&compiled));
        assert_eq!(targets(&prepared), targets(&compiled));
        assert!(targets(&prepared).len() > 30);
    }
}
