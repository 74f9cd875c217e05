//! The whole scene: a tree over the world's shapes and the instances, and a tree for each object.
//!
//! A ray that reaches an instance is taken into the object's space in `f64` and rounded once; its
//! parameter means the same in both. Points on instances carry that rounding in their error bound
//! ([`super::surface`]), so that a ray that leaves such a point does not meet its own surface there either.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use glam::{DAffine3, DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::{
    Bounds, BuildMethod, Counters, Hit, InstructionSet, Ray, Shape, SurfacePoint, TriangleTest, Width, World,
    bvh::{
        Kind, MAX_PRIMITIVES, Recipe, Ref, Tree,
        traverse::{Items, Nearest, Traverse},
    },
    disk,
    few::{self, Few, FewRays, Found, Rays, Spared},
    pages,
    simd::{Portable, Proof},
    sphere, surface, textbook,
    triangle::{self, RayFrame},
};
use crate::lanes::{Flag, Lane, NO};

/// How to build and how to ask.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Ray against triangle.
    pub test: TriangleTest,
    /// How trees are split.
    pub method: BuildMethod,
    /// How many children their nodes have.
    pub width: Width,
    /// Which instructions to use, of those that the processor has; else the fastest that it has.
    pub instructions: InstructionSet,
    /// Whether many rays at once are held against few primitives without a tree.
    pub few: bool,
    /// Whether then two triangles that make a flat quadrilateral are one.
    pub quads: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            test: TriangleTest::default(),
            method: BuildMethod::default(),
            width: Width::default(),
            instructions: InstructionSet::detect(),
            few: true,
            quads: true,
        }
    }
}

/// What was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Triangles that can be hit, each object's once.
    pub triangles: usize,
    /// Spheres and disks that can be hit, each object's once.
    pub others: usize,
    /// Instances that can be hit.
    pub instances: usize,
    /// What cannot be hit and was left out: triangles with coordinates that are not finite, corners in a line
    /// or positions that are not there; spheres and disks without a finite size above 0; instances of nothing,
    /// or by a map that has no inverse.
    pub dropped: usize,
    /// Nodes of all trees.
    pub nodes: usize,
    /// Depth of the deepest tree, in nodes.
    pub depth: usize,
    /// Bytes of all trees; the shapes themselves come on top.
    pub bytes: usize,
}

/// A scene that rays can be traced through. Immutable; shared between threads.
#[derive(Debug)]
pub struct Accel {
    world: Group,
    objects: Vec<Group>,
    /// By number of the instance, those that are dropped too.
    instances: Vec<Placed>,
    bounds: Bounds,
    stats: Stats,
    test: TriangleTest,
    instructions: InstructionSet,
    proof: Proof,
    /// The world, where it holds so little that it needs no tree.
    few: Option<Few>,
    /// And then of each primitive's number, its shape and its number there.
    few_places: Vec<(u32, u32)>,
}

/// Shapes under one tree. Primitives are numbered through all of them.
#[derive(Debug)]
struct Group {
    shapes: Vec<Shape>,
    /// Number of each shape's first primitive; at the end, the number of all.
    first: Vec<u32>,
    tree: Tree,
    dropped: usize,
}

#[derive(Debug)]
struct Placed {
    object: u32,
    to_world: DAffine3,
    to_object: DAffine3,
    /// Takes normals to the world.
    normals: DMat3,
}

impl Accel {
    /// Build with the default method, for the fastest instructions there are.
    #[must_use]
    pub fn build(world: World, test: TriangleTest) -> Self {
        Self::build_with(world, Options { test, ..Options::default() })
    }

    /// Build. Uses the threads of the current rayon pool; the result does not depend on their number.
    #[must_use]
    pub fn build_with(world: World, options: Options) -> Self {
        let Options { test, method, width, instructions, few, quads } = options;
        let (instructions, proof) = [instructions, InstructionSet::detect()]
            .into_iter()
            .find_map(|i| Some((i, i.prove()?)))
            .unwrap_or((InstructionSet::Portable, Proof::Portable(Portable)));
        let recipe = Recipe { method, width, proof };
        let objects: Vec<Group> =
            world.objects.into_par_iter().map(|o| Group::build(o.shapes, recipe, Vec::new())).collect();
        let mut placements = Vec::new();
        let mut dropped = 0;
        let mut instances = Vec::with_capacity(world.instances.len());
        for (k, instance) in world.instances.iter().enumerate() {
            let to_world = instance.to_world;
            let to_object = to_world.inverse();
            let bounds = objects.get(instance.object as usize).and_then(|o| o.tree.bounds);
            let placed = bounds.and_then(|b| {
                // Rays are rounded in object space, relative to how far the origin of that space is away.
                let rounding = 8.0 * f64::from(f32::EPSILON);
                let b = b.transformed(&to_world, rounding);
                (to_object.is_finite() && b.lo.is_finite() && b.hi.is_finite()).then_some(b)
            });
            match placed {
                Some(bounds) => placements.push((k as u32, bounds)),
                None => dropped += 1,
            }
            let normals = to_object.matrix3.transpose();
            instances.push(Placed { object: instance.object, to_world, to_object, normals });
        }
        let world = Group::build(world.shapes, recipe, placements);

        let mut stats = Stats { dropped, instances: instances.len() - dropped, ..Stats::default() };
        for group in objects.iter().chain([&world]) {
            stats.dropped += group.dropped;
            let others = group.shapes.iter().filter(|s| !matches!(s, Shape::Mesh(_)) && s.bounds().is_some()).count();
            stats.others += others;
            stats.triangles += (group.primitives() as usize).saturating_sub(group.dropped + others);
            stats.nodes += group.tree.node_count();
            stats.depth = stats.depth.max(group.tree.depth);
            stats.bytes += group.tree.bytes();
        }
        let bounds = world.tree.bounds.unwrap_or(Bounds::EMPTY);
        let few = few && test == TriangleTest::Watertight && instances.is_empty();
        let few = few.then(|| world.few(quads)).flatten();
        let places = few.as_ref().map_or(0, |_| world.primitives());
        let few_places = (0..places).map(|id| world.locate(id)).collect();
        Self { world, objects, instances, bounds, stats, test, instructions, proof, few, few_places }
    }

    /// Whether [`Accel::closest_of`] and [`Accel::occluded_of`] serve this world: it holds few primitives.
    #[must_use]
    pub fn is_small(&self) -> bool {
        self.few.is_some()
    }

    /// The nearest hit of each active ray, as [`Accel::closest`] finds it ([`Accel::found`] says which); `false` where
    /// this is not served.
    pub(crate) fn closest_of(
        &self,
        work: &mut FewRays,
        rays: &Rays,
        found: &mut Found,
        counters: &mut Counters,
    ) -> bool {
        let Some(few) = &self.few else { return false };
        counters.rays += rays.count();
        work.closest(few, rays, found, counters);
        for i in work.near_others(rays) {
            for id in few.others(work, i) {
                counters.primitive_tests += 1;
                let open = Ray { t_max: found.t[i].next_up(), ..rays.at(i) };
                if let Some(t) = self.world.other(id, &open) {
                    found.offer(i, id, t, 0.0, 0.0);
                }
            }
        }
        true
    }

    /// The hit of lane `i` that [`Accel::closest_of`] found.
    #[inline]
    pub(crate) fn found(&self, found: &Found, i: usize) -> Option<Hit> {
        let &(shape, primitive) = self.few_places.get(found.primitive(i)?)?;
        let instance = Hit::NO_INSTANCE;
        Some(Hit { t: found.t[i], instance, shape, primitive, b1: found.b1[i], b2: found.b2[i] })
    }

    /// Where [`Accel::is_small`], the bits in [`Rays::spared`] for rays that leave primitive `id` from well within (every
    /// barycentric above 1/64) at a cosine of at least 1/16.
    #[inline(always)]
    pub(crate) fn spared(&self, id: usize) -> Spared {
        self.few.as_ref().map_or([0; 2], |few| few.spared(id as u32))
    }

    /// Where [`Accel::is_small`], the bit of the sphere `id` in [`Rays::ended`] for rays that end before it: those of
    /// [`super::spawn_to`] to a point on the near side of it, at a cosine of at least 1/16 and from no nearer than its
    /// radius. The plane that touches the sphere there parts it from the whole ray: the ray's end is on the plane's outer side
    /// up to the rounding of the normal's length, a few [`f32::EPSILON`] of the radius, and the ray stops 8 of these of its length before.
    pub(crate) fn round(&self, id: usize) -> u32 {
        self.few.as_ref().map_or(0, |few| few.round(id as u32))
    }

    /// Where [`Accel::is_small`], shape and primitive of each primitive's number.
    pub(crate) fn places(&self) -> &[(u32, u32)] {
        &self.few_places
    }

    /// Whether each active ray meets anything, as [`Accel::occluded`] finds; `false` where this is not served.
    pub(crate) fn occluded_of(
        &self,
        work: &mut FewRays,
        rays: &Rays,
        occluded: &mut Lane<Flag>,
        counters: &mut Counters,
    ) -> bool {
        let Some(few) = &self.few else { return false };
        counters.rays += rays.count();
        work.occluded(few, rays, occluded, counters);
        for i in work.near_others(rays) {
            for id in few.others(work, i) {
                if occluded[i] == NO {
                    counters.primitive_tests += 1;
                    let open = Ray { t_max: rays.t_max[i].next_up(), ..rays.at(i) };
                    let t = self.world.other(id, &open);
                    occluded[i] = Flag::from(t.is_some_and(|t| t < rays.t_max[i]));
                }
            }
        }
        true
    }

    /// The nearest hit of a ray. Not inlined, here and below: what is compiled in this crate is as fast for every caller.
    #[inline(never)]
    #[must_use]
    pub fn closest(&self, ray: &Ray, counters: &mut Counters) -> Option<Hit> {
        counters.rays += 1;
        let mut nearest = Nearest::none(ray.t_max);
        self.dispatch::<false>(ray, &mut nearest, counters);
        nearest.found.then(|| self.hit(&nearest))
    }

    /// Whether anything is hit: `closest(..).is_some()`, sooner.
    #[inline(never)]
    #[must_use]
    pub fn occluded(&self, ray: &Ray, counters: &mut Counters) -> bool {
        counters.rays += 1;
        self.dispatch::<true>(ray, &mut Nearest::none(ray.t_max), counters)
    }

    #[inline(always)]
    fn dispatch<const ANY: bool>(&self, ray: &Ray, nearest: &mut Nearest, counters: &mut Counters) -> bool {
        match self.proof {
            #[cfg(target_arch = "x86_64")]
            Proof::Avx512(isa) => self.trace::<_, ANY>(isa, &self.world, 0, ray, nearest, counters),
            #[cfg(target_arch = "x86_64")]
            Proof::Avx2(isa) => self.trace::<_, ANY>(isa, &self.world, 0, ray, nearest, counters),
            #[cfg(target_arch = "x86_64")]
            Proof::Sse2(isa) => self.trace::<_, ANY>(isa, &self.world, 0, ray, nearest, counters),
            Proof::Portable(isa) => self.trace::<_, ANY>(isa, &self.world, 0, ray, nearest, counters),
        }
    }

    #[inline(always)]
    fn trace<I: Traverse, const ANY: bool>(
        &self,
        isa: I,
        group: &Group,
        rank: u32,
        ray: &Ray,
        nearest: &mut Nearest,
        counters: &mut Counters,
    ) -> bool {
        let items = GroupItems { accel: self, group, rank };
        match self.test {
            TriangleTest::Watertight => isa.trace::<ANY, false>(&group.tree, rank, &items, ray, nearest, counters),
            TriangleTest::MoellerTrumbore => isa.trace::<ANY, true>(&group.tree, rank, &items, ray, nearest, counters),
        }
    }

    #[inline(always)]
    fn hit(&self, nearest: &Nearest) -> Hit {
        let group = match self.instances.get((nearest.rank as usize).wrapping_sub(1)) {
            Some(placed) => &self.objects[placed.object as usize],
            None => &self.world,
        };
        let (shape, primitive) = group.locate(nearest.id);
        Hit {
            t: nearest.t,
            // The world's rank 0 becomes `Hit::NO_INSTANCE`.
            instance: nearest.rank.wrapping_sub(1),
            shape,
            primitive,
            b1: nearest.b1,
            b2: nearest.b2,
        }
    }

    /// The point of a hit that `closest` gave for this ray.
    #[must_use]
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> SurfacePoint {
        let weights = (hit.b1, hit.b2);
        let point = match self.instances.get(hit.instance as usize) {
            Some(placed) => self.objects.get(placed.object as usize).and_then(|group| {
                let shape = group.shapes.get(hit.shape as usize)?;
                let map = Some((&placed.to_world, &placed.normals));
                surface::of_hit(shape, hit.primitive, weights, &placed.take(ray, ray.t_max), hit.t, map)
            }),
            None => {
                let shape = self.world.shapes.get(hit.shape as usize);
                shape.and_then(|shape| surface::of_hit(shape, hit.primitive, weights, ray, hit.t, None))
            }
        };
        // Not a hit of this scene: the point on the ray is the best answer there is.
        point.unwrap_or_else(|| SurfacePoint { p: ray.at(hit.t), p_error: Vec3::ZERO, ng: -ray.direction })
    }

    /// The corners of the triangle that was hit, where it is one of the world itself.
    #[inline]
    #[must_use]
    pub fn world_triangle(&self, hit: &Hit) -> Option<[Vec3; 3]> {
        match self.world.shapes.get(hit.shape as usize)? {
            Shape::Mesh(mesh) if hit.instance == Hit::NO_INSTANCE => mesh.corners(hit.primitive as usize),
            _ => None,
        }
    }

    /// Bounds of the world; empty for an empty one.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// What was built.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.stats
    }

    /// Bytes of all trees.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.stats.bytes
    }

    /// Primitives and instances that can never be hit and were left out.
    #[must_use]
    pub fn dropped(&self) -> usize {
        self.stats.dropped
    }

    /// The instructions that are used.
    #[must_use]
    pub fn instructions(&self) -> InstructionSet {
        self.instructions
    }

    /// The world's shapes, as given.
    #[must_use]
    pub fn shapes(&self) -> &[Shape] {
        &self.world.shapes
    }

    /// An object's shapes, as given.
    #[must_use]
    pub fn object_shapes(&self, object: u32) -> Option<&[Shape]> {
        self.objects.get(object as usize).map(|group| &*group.shapes)
    }

    /// The nearest hit by testing every primitive of every instance: no tree, no vectors. The reference
    /// for tests, and the "before" of a chart.
    #[must_use]
    pub fn closest_by_brute_force(&self, ray: &Ray, counters: &mut Counters) -> Option<Hit> {
        counters.rays += 1;
        let mut nearest = Nearest::none(ray.t_max);
        self.world.try_all(0, self.test, ray, &mut nearest, counters);
        for (k, placed) in self.instances.iter().enumerate() {
            let Some(object) = self.objects.get(placed.object as usize) else { continue };
            let ray = placed.take(ray, nearest.t);
            object.try_all(k as u32 + 1, self.test, &ray, &mut nearest, counters);
        }
        nearest.found.then(|| self.hit(&nearest))
    }

    /// The trees' bits.
    #[cfg(test)]
    pub(super) fn tree_bits(&self) -> Vec<Vec<u32>> {
        self.objects.iter().chain([&self.world]).map(|group| group.tree.bits()).collect()
    }
}

impl Placed {
    /// A ray in object space; its parameter is the same.
    #[inline]
    fn take(&self, ray: &Ray, t_max: f32) -> Ray {
        let origin = self.to_object.transform_point3(ray.origin.as_dvec3()).as_vec3();
        let direction = self.to_object.transform_vector3(ray.direction.as_dvec3()).as_vec3();
        Ray { origin, direction, t_max }
    }
}

impl Shape {
    /// Bounds of a sphere or disk that can be hit; None for one that cannot, and for meshes.
    fn bounds(&self) -> Option<Bounds> {
        let (center, half, radius) = match *self {
            Self::Mesh(_) => return None,
            Self::Sphere { center, radius } => (center, DVec3::splat(f64::from(radius)), radius),
            Self::Disk { center, normal, radius } => {
                let n = normal.as_dvec3().try_normalize()?;
                let across = (DVec3::ONE - n * n).max(DVec3::ZERO);
                let half = DVec3::new(across.x.sqrt(), across.y.sqrt(), across.z.sqrt());
                (center, (half + 1e-7) * f64::from(radius), radius)
            }
        };
        let center = center.as_dvec3();
        let bounds = Bounds::around(center - half, center + half);
        (radius > 0.0 && bounds.lo.is_finite() && bounds.hi.is_finite()).then_some(bounds)
    }
}

impl Group {
    fn build(shapes: Vec<Shape>, recipe: Recipe, placements: Vec<(u32, Bounds)>) -> Self {
        let mut first = Vec::with_capacity(shapes.len() + 1);
        let mut count = 0usize;
        let mut refs: Vec<Ref> = Vec::new();
        let mut dropped = 0;
        for shape in &shapes {
            first.push(count as u32);
            let room = MAX_PRIMITIVES - count;
            match shape {
                Shape::Mesh(mesh) => {
                    let n = mesh.triangles.len().min(room);
                    // Hardly ever is one left out: all are made in place, and the list is made shorter only then.
                    let bad = AtomicBool::new(false);
                    let each = (0..n).into_par_iter().map(|k| {
                        let corners = mesh.corners(k).filter(|&corners| triangle::is_usable(corners));
                        corners.map_or_else(
                            || {
                                bad.store(true, Relaxed);
                                Ref::NONE
                            },
                            |corners| Ref::new(&Bounds::of(&corners), (count + k) as u32, Kind::Triangle),
                        )
                    });
                    let mut good = pages::collect(each);
                    if bad.into_inner() {
                        good.retain(Ref::is_some);
                    }
                    dropped += mesh.triangles.len() - good.len();
                    if refs.is_empty() {
                        refs = good;
                    } else {
                        refs.extend(good);
                    }
                    count += n;
                }
                other => {
                    match other.bounds().filter(|_| room > 0) {
                        Some(bounds) => refs.push(Ref::new(&bounds, count as u32, Kind::Item)),
                        None => dropped += 1,
                    }
                    count += room.min(1);
                }
            }
        }
        first.push(count as u32);
        refs.extend(placements.iter().map(|(k, bounds)| Ref::new(bounds, count as u32 + k, Kind::Item)));
        let corners = |id: u32| {
            let shape = first.partition_point(|&f| f <= id) - 1;
            match &shapes[shape] {
                Shape::Mesh(mesh) => mesh.corners((id - first[shape]) as usize).unwrap_or_default(),
                _ => Default::default(),
            }
            .map(|p| p.to_array())
        };
        let tree = Tree::build(refs, recipe, corners);
        Self { shapes, first, tree, dropped }
    }

    /// Its primitives, where they are few and in no instance.
    fn few(&self, quads: bool) -> Option<Few> {
        if self.primitives() as usize > few::MOST_TRIANGLES + few::MOST_OTHERS {
            return None;
        }
        let (mut triangles, mut others) = (Vec::new(), Vec::new());
        for (shape, &first) in self.shapes.iter().zip(&self.first) {
            match shape {
                Shape::Mesh(mesh) => triangles.extend((0..mesh.triangles.len()).filter_map(|k| {
                    let corners = mesh.corners(k).filter(|&c| triangle::is_usable(c))?;
                    Some((first + k as u32, corners.map(|p| p.to_array())))
                })),
                &Shape::Sphere { center, radius } | &Shape::Disk { center, radius, .. } => {
                    others.extend(shape.bounds().map(|_| (first, [center.x, center.y, center.z, radius])));
                }
            }
        }
        Few::new(triangles, others, quads)
    }

    /// How many numbers are given to primitives, dropped ones too. Instances are numbered from here.
    fn primitives(&self) -> u32 {
        self.first[self.shapes.len()]
    }

    /// Shape, and primitive in it, of a number below `primitives`.
    fn locate(&self, id: u32) -> (u32, u32) {
        let shape = match self.shapes.len() {
            1 => 0,
            // Shapes without primitives share their first number with the next one: the last of them has it.
            _ => self.first.partition_point(|&f| f <= id) - 1,
        };
        (shape as u32, id - self.first[shape])
    }

    /// A sphere or disk by its number.
    fn other(&self, id: u32, ray: &Ray) -> Option<f32> {
        match self.shapes[self.locate(id).0 as usize] {
            Shape::Sphere { center, radius } => sphere::intersect(center, radius, ray),
            Shape::Disk { center, normal, radius } => disk::intersect(center, normal, radius, ray),
            Shape::Mesh(_) => None,
        }
        .map(|t| t as f32)
    }

    fn try_all(&self, rank: u32, test: TriangleTest, ray: &Ray, nearest: &mut Nearest, counters: &mut Counters) {
        let Some(frame) = RayFrame::new(ray) else { return };
        for (shape, &first) in self.shapes.iter().zip(&self.first) {
            let Shape::Mesh(mesh) = shape else {
                counters.primitive_tests += 1;
                // A parameter that equals the nearest one must still be told.
                let open = Ray { t_max: nearest.t.next_up(), ..*ray };
                if shape.bounds().is_some()
                    && let Some(t) = self.other(first, &open)
                {
                    nearest.offer(rank, first, t, 0.0, 0.0);
                }
                continue;
            };
            for k in 0..mesh.triangles.len() {
                let Some(corners) = mesh.corners(k).filter(|&c| triangle::is_usable(c)) else { continue };
                counters.primitive_tests += 1;
                let corners = corners.map(|p| p.to_array());
                let hit = match test {
                    TriangleTest::Watertight => frame.intersect(corners),
                    TriangleTest::MoellerTrumbore => {
                        textbook::moeller_trumbore(ray.origin.into(), ray.direction.into(), corners)
                    }
                };
                if let Some(hit) = hit {
                    nearest.offer(rank, first + k as u32, hit.t, hit.b1, hit.b2);
                }
            }
        }
    }
}

impl super::TriangleMesh {
    /// A triangle's corners; None where it, or a position it names, is not there.
    #[must_use]
    pub fn corners(&self, triangle: usize) -> Option<[Vec3; 3]> {
        let [a, b, c] = *self.triangles.get(triangle)?;
        let at = |k: u32| self.positions.get(k as usize).copied();
        Some([at(a)?, at(b)?, at(c)?])
    }
}

struct GroupItems<'a> {
    accel: &'a Accel,
    group: &'a Group,
    rank: u32,
}

impl Items for GroupItems<'_> {
    #[inline(never)]
    fn intersect<I: Traverse, const ANY: bool>(
        &self,
        isa: I,
        item: u32,
        ray: &Ray,
        nearest: &mut Nearest,
        counters: &mut Counters,
    ) -> bool {
        let Some(instance) = item.checked_sub(self.group.primitives()) else {
            let open = Ray { t_max: nearest.t.next_up(), ..*ray };
            return self.group.other(item, &open).is_some_and(|t| nearest.offer(self.rank, item, t, 0.0, 0.0));
        };
        let placed = &self.accel.instances[instance as usize];
        let ray = placed.take(ray, nearest.t);
        // Objects hold no instances, so this goes no deeper.
        let object = &self.accel.objects[placed.object as usize];
        self.accel.trace::<I, ANY>(isa, object, instance + 1, &ray, nearest, counters)
    }
}
