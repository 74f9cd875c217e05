//! Boxes in four lanes, and the bins of the surface area heuristic.

use super::Ref;

/// Bins along each axis.
pub(super) const BINS: usize = 16;

/// A box; the fourth lane is not used.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
pub(super) struct Box4 {
    pub lo: [f32; 4],
    pub hi: [f32; 4],
}

#[inline(always)]
fn min4(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
}

#[inline(always)]
fn max4(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] })
}

impl Box4 {
    pub const EMPTY: Self = Self { lo: [f32::INFINITY; 4], hi: [f32::NEG_INFINITY; 4] };

    #[inline(always)]
    pub fn join(&mut self, other: &Self) {
        self.lo = min4(self.lo, other.lo);
        self.hi = max4(self.hi, other.hi);
    }

    #[inline(always)]
    pub fn include(&mut self, p: [f32; 4]) {
        self.lo = min4(self.lo, p);
        self.hi = max4(self.hi, p);
    }

    /// Half the area of the surface, in units of `1 / scale`: the scale keeps boxes of any size within
    /// the range of `f32`. Zero for the empty box.
    #[inline(always)]
    pub fn half_area(&self, scale: f32) -> f32 {
        let d: [f32; 3] = std::array::from_fn(|i| (self.hi[i] - self.lo[i]).max(0.0) * scale);
        d[0] * d[1] + d[1] * d[2] + d[2] * d[0]
    }
}

/// Twice the centroid. The fourth lane is a number's bits, and means nothing. Coordinates past 1.7e38
/// overflow here; such nodes are halved by count.
#[inline(always)]
pub(super) fn centroid(r: &Ref) -> [f32; 4] {
    let b = r.bounds();
    std::array::from_fn(|i| b.lo[i] + b.hi[i])
}

/// From centroids to bins.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mapping {
    lo: [f32; 4],
    scale: [f32; 4],
}

impl Mapping {
    pub fn new(centroids: &Box4) -> Self {
        let scale = std::array::from_fn(|i| {
            let extent = centroids.hi[i] - centroids.lo[i];
            let scale = BINS as f32 * 0.9999 / extent;
            // Coincident centroids, and extents so small that the scale overflows, cannot be binned.
            if i < 3 && extent > 0.0 && scale.is_finite() { scale } else { 0.0 }
        });
        Self { lo: centroids.lo, scale }
    }

    #[inline(always)]
    pub fn splits(&self, axis: usize) -> bool {
        self.scale[axis] > 0.0
    }

    #[inline(always)]
    pub fn bins(&self, r: &Ref) -> [usize; 3] {
        let c = centroid(r);
        std::array::from_fn(|i| (((c[i] - self.lo[i]) * self.scale[i]) as i32) as usize & (BINS - 1))
    }
}

/// What fell into each bin of each axis.
#[derive(Clone)]
pub(super) struct Bins {
    pub bounds: [[Box4; BINS]; 3],
    pub count: [[u32; BINS]; 3],
}

/// Where to split.
#[derive(Clone, Copy, Debug)]
pub(super) struct Split {
    /// Area times packs, of both sides.
    pub cost: f32,
    pub axis: usize,
    /// The first bin of the right side.
    pub bin: usize,
}

impl Bins {
    pub const EMPTY: Self = Self { bounds: [[Box4::EMPTY; BINS]; 3], count: [[0; BINS]; 3] };

    #[inline(always)]
    pub fn fill(&mut self, refs: &[Ref], mapping: &Mapping) {
        for r in refs {
            for (axis, bin) in mapping.bins(r).into_iter().enumerate() {
                self.bounds[axis][bin].join(r.bounds());
                self.count[axis][bin] += 1;
            }
        }
    }

    pub fn merge(mut self, other: &Self) -> Self {
        for axis in 0..3 {
            for k in 0..BINS {
                self.bounds[axis][k].join(&other.bounds[axis][k]);
                self.count[axis][k] += other.count[axis][k];
            }
        }
        self
    }

    /// The cheapest split with something on both sides.
    pub fn best(&self, mapping: &Mapping, scale: f32, packs: impl Fn(u32) -> f32) -> Option<Split> {
        let mut best: Option<Split> = None;
        for axis in (0..3).filter(|&a| mapping.splits(a)) {
            let (bounds, count) = (&self.bounds[axis], &self.count[axis]);
            let mut right = [0.0; BINS];
            let mut right_count = [0; BINS];
            let (mut join, mut n) = (Box4::EMPTY, 0);
            for k in (1..BINS).rev() {
                join.join(&bounds[k]);
                n += count[k];
                right[k] = join.half_area(scale) * packs(n);
                right_count[k] = n;
            }
            let (mut join, mut n) = (Box4::EMPTY, 0);
            for k in 1..BINS {
                join.join(&bounds[k - 1]);
                n += count[k - 1];
                if n == 0 || right_count[k] == 0 {
                    continue;
                }
                let cost = join.half_area(scale) * packs(n) + right[k];
                if best.is_none_or(|b| cost < b.cost) {
                    best = Some(Split { cost, axis, bin: k });
                }
            }
        }
        best
    }
}
