//! Boxes in eight lanes, and the bins of the surface area heuristic.

#[cfg(target_arch = "x86_64")]
use super::super::simd::{Avx2, Avx512};
use super::{
    super::simd::{Boxes, Isa, Lanes, Proof, Row},
    Ref,
};
use crate::lanes::stage;

/// Most bins along an axis.
pub(super) const BINS: usize = 16;

/// A box: its smallest coordinates, and its largest ones with the other sign, so that joining two boxes is one
/// minimum. The fourth lane of either half is free.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Box8(pub [f32; 8]);

#[inline(always)]
fn min8(a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
    std::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
}

impl Box8 {
    pub const EMPTY: Self = Self([f32::INFINITY; 8]);

    #[inline(always)]
    pub fn join(&mut self, other: &Self) {
        self.0 = min8(self.0, other.0);
    }

    #[inline(always)]
    fn load<I: Isa>(&self, isa: I) -> I::F {
        isa.load(&Row(self.0))
    }

    pub fn lo(&self) -> [f32; 3] {
        [self.0[0], self.0[1], self.0[2]]
    }

    pub fn hi(&self) -> [f32; 3] {
        [-self.0[4], -self.0[5], -self.0[6]]
    }

    /// How likely a ray meets the box, up to a factor. The box must not be empty.
    #[inline(always)]
    pub fn reach(&self, measure: &Measure) -> f32 {
        let b = &self.0;
        let d: [f32; 3] = std::array::from_fn(|i| -(b[i] + b[i + 4]) * measure.scale);
        d[0] * d[1] + d[1] * d[2] + d[2] * d[0] + INSIDE * (d[0] * d[1] * d[2])
    }
}

/// Rays from elsewhere meet a box as often as its surface is large; those that begin or end in it always do, and they are
/// as many as its volume says. This weighs the latter: with it walls get leaves of their own, and the air between them none.
const INSIDE: f32 = 3.0;

/// What boxes are measured by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measure {
    /// Makes the extent of the whole 1: that keeps boxes of any size within the range of `f32`.
    pub scale: f32,
    /// Added to the reach of each pack: what its memory is worth.
    pub memory: f32,
}

impl Measure {
    /// Cost of the packs of `n` triangles in a box of this reach.
    #[inline(always)]
    pub fn packs(&self, reach: f32, n: u32) -> f32 {
        (reach + self.memory) * n.div_ceil(super::build::PACK as u32) as f32
    }
}

/// Twice the centroid, as a box. The fourth lanes mean nothing. Coordinates past 1.7e38 overflow here; such nodes are
/// halved by count.
#[inline(always)]
pub(super) fn centroid(r: &Ref) -> Box8 {
    let b = &r.bounds().0;
    Box8(std::array::from_fn(|i| if i < 4 { b[i] - b[i + 4] } else { b[i] - b[i - 4] }))
}

/// From centroids to bins.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mapping {
    lo: Row<4>,
    scale: Row<4>,
    /// How many bins.
    bins: usize,
}

/// Added to a small number it rounds that to sixteenths, and leaves the whole part in the bits from [`PLACE`] on.
const MAGIC: f32 = 524_288.0;
const PLACE: u32 = 4;

impl Mapping {
    /// For `n` references with these centroids.
    pub fn new(centroids: &Box8, n: usize) -> Self {
        // As many as there is something to tell apart.
        let bins = (8 + n / 8).min(BINS);
        let scale = std::array::from_fn(|i| {
            let extent = -centroids.0[i + 4] - centroids.0[i];
            // Less by what rounding may add.
            let scale = (bins as f32 - 0.0625) / extent;
            // Coincident centroids, and extents so small that the scale overflows, cannot be binned.
            if i < 3 && extent > 0.0 && scale.is_finite() { scale } else { 0.0 }
        });
        let c = &centroids.0;
        Self { lo: Row([c[0], c[1], c[2], 0.0]), scale: Row(scale), bins }
    }

    #[inline(always)]
    pub fn splits(&self, axis: usize) -> bool {
        self.scale.0[axis] > 0.0
    }

    /// The bin on each axis of a reference with this box.
    #[inline(always)]
    fn bins<I: Boxes<4>>(&self, isa: I, b: &Box8) -> [usize; 3] {
        let four = isa.boxes();
        let [lo, hi] = b.0.as_chunks().0 else { unreachable!("eight are two times four") };
        let centroid = four.load(&Row(*lo)).sub(four.load(&Row(*hi)));
        let place = centroid.sub(four.load(&self.lo)).mul(four.load(&self.scale)).add(four.splat(MAGIC));
        let mut places = Row([0.0; 4]);
        place.store(&mut places);
        let [x, y, z, _] = places.0.map(|k| (k.to_bits() >> PLACE) as usize & (BINS - 1));
        [x, y, z]
    }
}

/// What fell into each bin of each axis.
#[derive(Clone)]
pub(super) struct Bins {
    bounds: [[Box8; BINS]; 3],
    count: [[u32; BINS]; 3],
}

/// Where to split.
#[derive(Clone, Copy, Debug)]
pub(super) struct Split {
    pub axis: usize,
    /// The first bin of the right side.
    pub bin: usize,
    /// What either side holds.
    pub sides: [Box8; 2],
}

impl Bins {
    pub const EMPTY: Self = Self { bounds: [[Box8::EMPTY; BINS]; 3], count: [[0; BINS]; 3] };

    /// Of fewer than 2^23 references. They are counted in a lane that boxes do not use. The lanes are named one by one: what
    /// compilers make of `Box8::join` here stores under a mask, and such a bin cannot be loaded again soon.
    #[inline(always)]
    fn fill<I: Boxes<4>>(&mut self, isa: I, refs: &[Ref], mapping: &Mapping) {
        const FAR: f32 = f32::INFINITY;
        let mut bounds = [[Row([FAR, FAR, FAR, 0.0, FAR, FAR, FAR, 0.0]); BINS]; 3];
        // Less than any coordinate, more than any count.
        let tags = isa.load(&Row([-FAR, -FAR, -FAR, FAR, -FAR, -FAR, -FAR, FAR]));
        let one = isa.load(&Row([-0.0, -0.0, -0.0, 1.0, -0.0, -0.0, -0.0, 1.0]));
        for r in refs {
            let [x, y, z] = mapping.bins(isa, r.bounds());
            let b = r.bounds().load(isa).max(tags);
            for (axis, k) in [x, y, z].into_iter().enumerate() {
                let bin = &mut bounds[axis][k];
                isa.load(bin).min(b).add(one).store(bin);
            }
        }
        for (axis, bins) in bounds.iter().enumerate() {
            for (k, bin) in bins[..mapping.bins].iter().enumerate() {
                self.bounds[axis][k] = Box8(bin.0);
                // A whole number plus 2^23 is in the lowest bits.
                self.count[axis][k] = (bin.0[3] + 8_388_608.0).to_bits() & 0x7f_ffff;
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
    #[inline(always)]
    fn best(&self, mapping: &Mapping, measure: &Measure) -> Option<Split> {
        let mut best: Option<(f32, usize, usize)> = None;
        for axis in (0..3).filter(|&a| mapping.splits(a)) {
            let (bounds, count) = (&self.bounds[axis], &self.count[axis]);
            let mut right = [f32::INFINITY; BINS];
            let (mut join, mut n) = (Box8::EMPTY, 0);
            for k in (1..mapping.bins).rev() {
                join.join(&bounds[k]);
                n += count[k];
                // Nothing on this side: not a number, which is never the cheapest.
                right[k] = measure.packs(join.reach(measure), n);
            }
            let (mut join, mut n) = (Box8::EMPTY, 0);
            for k in 1..mapping.bins {
                join.join(&bounds[k - 1]);
                n += count[k - 1];
                let cost = measure.packs(join.reach(measure), n) + right[k];
                if cost < best.map_or(f32::INFINITY, |b| b.0) {
                    best = Some((cost, axis, k));
                }
            }
        }
        let (_, axis, bin) = best?;
        let mut sides = [Box8::EMPTY; 2];
        for (k, bounds) in self.bounds[axis][..mapping.bins].iter().enumerate() {
            sides[usize::from(k >= bin)].join(bounds);
        }
        Some(Split { axis, bin, sides })
    }
}

/// What falls into each bin, for each instruction set.
pub(super) fn fill(proof: Proof, bins: &mut Bins, refs: &[Ref], mapping: &Mapping) {
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2")]
    fn avx512(isa: Avx512, bins: &mut Bins, refs: &[Ref], mapping: &Mapping) {
        bins.fill(isa, refs, mapping)
    }
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn avx2(isa: Avx2, bins: &mut Bins, refs: &[Ref], mapping: &Mapping) {
        bins.fill(isa, refs, mapping)
    }
    match proof {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the value `isa` exists only where the processor has these instructions.
        Proof::Avx512(isa) => unsafe { avx512(isa, bins, refs, mapping) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        Proof::Avx2(isa) => unsafe { avx2(isa, bins, refs, mapping) },
        #[cfg(target_arch = "x86_64")]
        Proof::Sse2(isa) => bins.fill(isa, refs, mapping),
        Proof::Portable(isa) => bins.fill(isa, refs, mapping),
    }
}

stage! {
    /// Choose the cheapest split.
    pub(super) fn best(bins: &Bins, mapping: &Mapping, measure: &Measure, split: &mut Option<Split>) {
        *split = bins.best(mapping, measure);
    }
}

/// Left and right: how many references are on the left, and the centroids of either side.
pub(super) type Halves = (usize, [Box8; 2]);

/// Those that satisfy `left` first. No branch depends on the answer, which cannot be foretold.
#[inline(always)]
pub(super) fn partition(refs: &mut [Ref], left: impl Fn(&Ref) -> bool) -> Halves {
    let mut mid = 0;
    let mut centroids = [Box8::EMPTY; 2];
    for i in 0..refs.len() {
        let r = refs[i];
        let is_left = left(&r);
        refs[i] = refs[mid];
        refs[mid] = r;
        mid += usize::from(is_left);
        let c = centroid(&r);
        for (side, mine) in centroids.iter_mut().zip([is_left, !is_left]) {
            side.join(&Box8(c.0.map(|x| if mine { x } else { f32::INFINITY })));
        }
    }
    (mid, centroids)
}

/// References whose chunks have been partitioned, each with these halves, as one partition.
pub(super) fn gather(refs: &mut [Ref], chunk: usize, parts: &[Halves]) -> Halves {
    let mid = parts.iter().map(|part| part.0).sum();
    let starts = || parts.iter().enumerate().map(|(k, part)| (k * chunk, part.0));
    let end = refs.len();
    // As many of the right are too far left as of the left are too far right.
    let right = starts().flat_map(|(at, left)| at + left..(at + chunk).min(mid));
    let left = starts().flat_map(|(at, left)| at.max(mid)..(at + left).min(end));
    for (i, j) in right.zip(left) {
        refs.swap(i, j);
    }
    let mut centroids = [Box8::EMPTY; 2];
    for part in parts {
        for (all, one) in centroids.iter_mut().zip(&part.1) {
            all.join(one);
        }
    }
    (mid, centroids)
}

stage! {
    /// Those in bins below `bin` first.
    pub(super) fn partition_by_bin(refs: &mut [Ref], mapping: &Mapping, axis: usize, bin: usize, halves: &mut Halves) {
        let (lo, scale) = (mapping.lo.0[axis], mapping.scale.0[axis]);
        *halves = partition(refs, |r| {
            let b = &r.bounds().0;
            let k = ((b[axis] - b[axis + 4] - lo) * scale + MAGIC).to_bits() >> PLACE & (BINS as u32 - 1);
            k < bin as u32
        });
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::{
        super::{super::Bounds, build::Kind},
        *,
    };

    #[test]
    fn partitioned_chunks_become_one_partition() {
        let is_left = |r: &Ref| r.id().wrapping_mul(0x9e37_79b9) >> 31 == 0;
        for (n, chunk) in [(1, 4), (16, 4), (100, 16), (1000, 64)] {
            let at = |id| Vec3::splat((id * 7 % n) as f32);
            let mut refs: Vec<Ref> =
                (0..n).map(|id| Ref::new(&Bounds { lo: at(id), hi: at(id) + Vec3::ONE }, id, Kind::Triangle)).collect();
            let (count, expected) = partition(&mut refs.clone(), is_left);
            let parts: Vec<Halves> = refs.chunks_mut(chunk).map(|refs| partition(refs, is_left)).collect();
            let (mid, centroids) = gather(&mut refs, chunk, &parts);
            assert_eq!(mid, count);
            assert!(refs[..mid].iter().all(is_left) && !refs[mid..].iter().any(is_left));
            let mut ids: Vec<u32> = refs.iter().map(Ref::id).collect();
            ids.sort_unstable();
            assert!(ids.into_iter().eq(0..n));
            for (found, expected) in centroids.iter().zip(expected) {
                assert_eq!((found.lo(), found.hi()), (expected.lo(), expected.hi()));
            }
        }
    }
}
