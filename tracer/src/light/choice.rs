//! Which light, by place: a light tree for what is at finite distance, and beside it what is not.

use super::{
    Area, Emitter, Primitive, Reference, Source,
    cone::Cone,
    delta::{self, DeltaLight},
    tree::{self, LightBounds, LightTree, Root, Walk},
};
use crate::{
    lanes::{Proven, WIDTH},
    math::Vec3,
};

/// The tree, environment and directional lights: each of these is as likely as the whole tree.
#[derive(Debug, Clone)]
pub(super) struct TreeChoice {
    tree: Option<LightTree>,
    /// What the tree's lights are.
    sources: Vec<Source>,
    /// The tree's number of every emitter and of every light without a surface; `NOT_IN_TREE` for those
    /// that give no light or are infinitely far away.
    emitter_leaves: Vec<u32>,
    delta_leaves: Vec<u32>,
    infinite: Vec<Source>,
    /// Probability of the tree, and of each light beside it.
    share: f32,
}

const NOT_IN_TREE: u32 = u32::MAX;

/// What is chosen first.
enum Part {
    Beside(Source),
    /// With what is left of the number.
    Tree(f64),
}

impl TreeChoice {
    /// `live` are the numbers of the lights that have any power.
    pub(super) fn new(primitives: &[Primitive], areas: &[Area], deltas: &[DeltaLight], live: &[u32]) -> Self {
        let mut bounds = Vec::new();
        let mut sources = Vec::new();
        let mut emitter_leaves = vec![NOT_IN_TREE; primitives.len()];
        let mut delta_leaves = vec![NOT_IN_TREE; deltas.len()];
        let mut infinite = Vec::new();
        let is_live = |light: usize| live.binary_search(&(light as u32)).is_ok();
        for (i, primitive) in primitives.iter().enumerate() {
            let area = &areas[primitive.area as usize];
            if is_live(primitive.area as usize)
                && let Some(light) = emitter_bounds(&primitive.shape, area)
            {
                emitter_leaves[i] = bounds.len() as u32;
                bounds.push(light);
                sources.push(Source::Emitter(i as u32));
            }
        }
        for (i, light) in deltas.iter().enumerate().filter(|(i, _)| is_live(areas.len() + i)) {
            match delta_bounds(light) {
                Some(light) => {
                    delta_leaves[i] = bounds.len() as u32;
                    bounds.push(light);
                    sources.push(Source::Delta(i as u32));
                }
                None => infinite.push(Source::Delta(i as u32)),
            }
        }
        if is_live(areas.len() + deltas.len()) {
            infinite.push(Source::Environment);
        }
        let tree = LightTree::new(&bounds);
        let parts = infinite.len() + usize::from(tree.is_some());
        let share = if parts > 0 { 1.0 / parts as f32 } else { 0.0 };
        Self { tree, sources, emitter_leaves, delta_leaves, infinite, share }
    }

    /// The light that `u` chooses for `reference`, and its probability.
    #[inline]
    pub(super) fn pick(&self, reference: &Reference, u: f64) -> Option<(Source, f32)> {
        match self.part(u) {
            Part::Beside(source) => Some((source, self.share)),
            Part::Tree(within) => {
                let (light, probability) = self.tree.as_ref()?.sample(reference.p, reference.n, within)?;
                Some((self.sources[light as usize], self.share * probability))
            }
        }
    }

    /// The tree's root and what its children are, where those are all there is to choose from; a missing child is any.
    pub(super) fn root(&self) -> Option<(Root, [Source; 4])> {
        let (root, lights) = self.tree.as_ref().filter(|_| self.infinite.is_empty())?.root()?;
        Some((root, lights.map(|light| self.sources[light as usize])))
    }

    /// [`TreeChoice::pick`] for up to [`WIDTH`] references at once: `query` gives that of a place, with its number, and
    /// `chosen` takes what was chosen for it, all after `soon` has been told of all.
    pub(super) fn pick_all(
        &self,
        proven: Proven,
        n: usize,
        mut query: impl FnMut(usize) -> (Reference, f64),
        soon: impl Fn(Source),
        mut chosen: impl FnMut(usize, Option<(Source, f32)>),
    ) {
        let mut walks = [Walk::NONE; WIDTH];
        let mut found = [None; WIDTH];
        let n = n.min(WIDTH);
        for i in 0..n {
            let (reference, u) = query(i);
            match self.part(u) {
                Part::Beside(source) => found[i] = Some((source, self.share)),
                Part::Tree(within) => walks[i] = Walk::new(reference.p, reference.n, within),
            }
        }
        if let Some(tree) = &self.tree {
            tree::sample_all(proven, tree, &mut walks[..n]);
        }
        for (walk, found) in walks.iter().zip(&mut found).take(n) {
            if let Some((light, probability)) = walk.found {
                *found = Some((self.sources[light as usize], self.share * probability));
            }
            if let Some((source, _)) = *found {
                soon(source);
            }
        }
        for (i, &found) in found.iter().enumerate().take(n) {
            chosen(i, found);
        }
    }

    /// The tree or a light beside it, as `u` chooses.
    #[inline(always)]
    fn part(&self, u: f64) -> Part {
        let parts = self.infinite.len() + usize::from(self.tree.is_some());
        let scaled = u * parts as f64;
        match self.infinite.get(scaled as usize) {
            Some(&source) => Part::Beside(source),
            None => Part::Tree((scaled - self.infinite.len() as f64).clamp(0.0, 1.0 - f64::EPSILON)),
        }
    }

    /// Probability with which [`TreeChoice::pick`] chooses `source`.
    #[inline]
    pub(super) fn probability(&self, reference: &Reference, source: Source) -> f32 {
        let leaf = match source {
            Source::Emitter(emitter) => self.emitter_leaves[emitter as usize],
            Source::Delta(delta) => self.delta_leaves[delta as usize],
            // The last of those beside the tree.
            Source::Environment if self.infinite.last() == Some(&source) => return self.share,
            Source::Environment => NOT_IN_TREE,
        };
        match &self.tree {
            Some(tree) if leaf != NOT_IN_TREE => self.share * tree.probability(reference.p, reference.n, leaf),
            _ => 0.0,
        }
    }
}

/// Bounds of an emitter; `None` where it has no area, or none that is finite.
fn emitter_bounds(shape: &Emitter, area: &Area) -> Option<LightBounds> {
    let (low, high, normal) = match *shape {
        Emitter::Triangle { p: [a, b, c] } => {
            (a.min(b).min(c), a.max(b).max(c), (b.as_dvec3() - a.as_dvec3()).cross(c.as_dvec3() - a.as_dvec3()))
        }
        Emitter::Rectangle { corner, edge_u, edge_v } => {
            let (low, high) = (
                corner + edge_u.min(Vec3::ZERO) + edge_v.min(Vec3::ZERO),
                corner + edge_u.max(Vec3::ZERO) + edge_v.max(Vec3::ZERO),
            );
            (low, high, edge_u.as_dvec3().cross(edge_v.as_dvec3()))
        }
        Emitter::Sphere { center, radius } => (center - radius, center + radius, Vec3::Z.as_dvec3()),
        Emitter::Disk { center, normal, radius } => {
            // A disk reaches radius x sqrt(1 - n^2) along each axis.
            let reach = (Vec3::ONE - normal * normal).max(Vec3::ZERO).map(f32::sqrt) * radius;
            (center - reach, center + reach, normal.as_dvec3())
        }
    };
    let size = shape.area();
    let cone = match shape {
        Emitter::Sphere { .. } => Cone::FULL,
        _ => Cone { axis: normal.try_normalize()?.as_vec3(), spread: 0.0 },
    };
    // Radiance x the largest area that is seen at once.
    let seen = if matches!(shape, Emitter::Sphere { .. }) { 0.25 * size } else { size };
    let intensity = seen * delta::mean(area.radiance);
    (intensity > 0.0 && intensity.is_finite() && low.is_finite() && high.is_finite()).then_some(LightBounds {
        low,
        high,
        cone,
        two_sided: area.two_sided,
        intensity,
    })
}

/// Bounds of a light without a surface; `None` where it is infinitely far away.
fn delta_bounds(light: &DeltaLight) -> Option<LightBounds> {
    let (at, cone, intensity) = match *light {
        DeltaLight::Point { position, intensity } => (position, Cone::FULL, intensity),
        DeltaLight::Spot { position, axis, intensity, cos_cutoff, .. } => {
            (position, Cone::from_cosine(axis, cos_cutoff), intensity)
        }
        DeltaLight::Directional { .. } => return None,
    };
    Some(LightBounds { low: at, high: at, cone, two_sided: false, intensity: delta::mean(intensity) })
}
