//! Rays of the kinds that rendering traces, from one picture: those of the camera, those that leave what they hit
//! in a random direction, and those from there to a light; the latter two in the order of the pixels and shuffled.

use tracer::{
    geometry::{Accel, Counters, Hit, Ray, offset::offset_origin},
    math::Vec3,
};

use crate::stability::random::Random;

/// Rays of one kind.
#[derive(Debug, Clone)]
pub struct RaySet {
    /// What they are, in words.
    pub name: &'static str,
    /// Whether any hit will do, or the nearest is wanted.
    pub any: bool,
    /// The rays.
    pub rays: Vec<Ray>,
}

/// What the rays are made of.
pub struct Maker<'a> {
    /// What they meet.
    pub accel: &'a Accel,
    /// The camera's rays, in the order of rendering.
    pub primary: Vec<Ray>,
    /// Rays of each other set.
    pub count: usize,
    /// How far off a surface rays start that leave it, beyond the error of the point.
    pub lift: f32,
}

/// A place that was hit, and the normal that faces where the ray came from.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Just off the surface.
    pub p: Vec3,
    /// Of unit length.
    pub n: Vec3,
}

impl Maker<'_> {
    /// All sets. `light` makes a shadow ray from a place to a light, where there is one to be seen from there, out of
    /// three numbers in 0..1.
    #[must_use]
    pub fn sets(self, light: &dyn Fn(&Place, [f64; 3]) -> Option<Ray>) -> Vec<RaySet> {
        let mut random = Random::new(42);
        let shadows = |places: &[Place], random: &mut Random| -> Vec<Ray> {
            places.iter().filter_map(|place| light(place, std::array::from_fn(|_| random.uniform()))).collect()
        };
        let places = spread(&self.places(&self.primary), self.count);
        let diffuse: Vec<Ray> = places.iter().map(|place| diffuse(place, &mut random)).collect();
        let shadow = shadows(&places, &mut random);
        let mut shuffled = diffuse.clone();
        for i in (1..shuffled.len()).rev() {
            shuffled.swap(i, (random.uniform() * (i + 1) as f64) as usize);
        }
        let second = spread(&self.places(&shuffled), self.count);
        let second = shadows(&second, &mut random);
        vec![
            RaySet { name: "primary", any: false, rays: self.primary },
            RaySet { name: "diffuse", any: false, rays: diffuse },
            RaySet { name: "diffuse, shuffled", any: false, rays: shuffled },
            RaySet { name: "shadow", any: true, rays: shadow },
            RaySet { name: "shadow, shuffled", any: true, rays: second },
        ]
    }

    /// Where rays hit.
    fn places(&self, rays: &[Ray]) -> Vec<Place> {
        let mut counters = Counters::default();
        let hit = |ray: &Ray| Some((*ray, self.accel.closest(ray, &mut counters)?));
        rays.iter().filter_map(hit).map(|(ray, hit)| self.place(&ray, &hit)).collect()
    }

    fn place(&self, ray: &Ray, hit: &Hit) -> Place {
        let at = self.accel.surface(ray, hit);
        let n = if at.ng.dot(ray.direction) > 0.0 { -at.ng } else { at.ng };
        Place { p: offset_origin(at.p, at.p_error, n, n) + n * self.lift, n }
    }
}

/// `count` of the places, evenly spread, in their order; none of none.
fn spread(places: &[Place], count: usize) -> Vec<Place> {
    let all = if places.is_empty() { 0 } else { count };
    (0..all).map(|i| places[i * places.len() / count]).collect()
}

/// A ray in a direction with the density of the cosine.
fn diffuse(place: &Place, random: &mut Random) -> Ray {
    let z = 1.0 - 2.0 * random.uniform();
    let (sin, cos) = (std::f64::consts::TAU * random.uniform()).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    let sphere = Vec3::new((r * cos) as f32, (r * sin) as f32, z as f32);
    // A point of the unit sphere about the tip of the normal; a little less, so that it is never zero.
    Ray::new(place.p, (place.n + sphere * 0.999).normalize())
}
