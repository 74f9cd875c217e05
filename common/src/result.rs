//! The result of a unit as bytes: a small header, then plain arrays, little-endian, before compression.
//!
//! A pixel is 20 bytes, its mean as three f32 and the roots of its two sums of squares as two (roots keep the
//! range of radiance). Counts are sent once where they are the same for all pixels. A first pass adds 28 bytes of
//! features; where some pixels are known exactly, a byte each says which. The bytes are a pure function of the unit but for the trailing statistics.

use crate::{
    film::{Features, Film, Moments},
    tile::Rect,
};

/// Begins every result.
const MAGIC: [u8; 4] = *b"TSR2";
const HEADER: usize = 4 + 4 + 16;
const STATISTICS: usize = 10 * 8;
const PER_PIXEL_COUNTS: u32 = 1;
const WITH_FEATURES: u32 = 2;
const WITH_KNOWN: u32 = 4;

/// Work counted and time spent on a unit. Only the counts are reproducible.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct UnitStatistics {
    /// Camera samples taken.
    pub samples: u64,
    /// Rays traced, of all kinds.
    pub rays: u64,
    /// Bounding-box tests.
    pub node_tests: u64,
    /// Triangle and other primitive tests.
    pub primitive_tests: u64,
    /// Samples that were not finite and were left out.
    pub rejected: u64,
    /// Luminance that a clamp took away, summed over samples.
    pub clamped: f64,
    /// Processor time, seconds.
    pub cpu_seconds: f64,
    /// Time from the first to the last sample, seconds.
    pub wall_seconds: f64,
    /// Time to fetch and decode the scene, seconds; 0 but for the first unit after it was loaded.
    pub load_seconds: f64,
    /// Time to build its acceleration structure, seconds; 0 likewise.
    pub build_seconds: f64,
}

impl UnitStatistics {
    /// Add the counts and times of `other`.
    pub fn add(&mut self, other: &UnitStatistics) {
        self.samples += other.samples;
        self.rays += other.rays;
        self.node_tests += other.node_tests;
        self.primitive_tests += other.primitive_tests;
        self.rejected += other.rejected;
        self.clamped += other.clamped;
        self.cpu_seconds += other.cpu_seconds;
        self.wall_seconds += other.wall_seconds;
        self.load_seconds += other.load_seconds;
        self.build_seconds += other.build_seconds;
    }
}

/// What a worker hands in for a unit.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitResult {
    /// The pixels it covers.
    pub rect: Rect,
    /// Their moments, and features when the unit was of the first pass.
    pub film: Film,
    /// What it cost.
    pub statistics: UnitStatistics,
}

/// Why bytes are not a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum BadResult {
    /// Not a result of this version.
    #[error("not a unit result of this version")]
    Magic,
    /// More or fewer bytes than the header says.
    #[error("the result is cut short or has bytes left over")]
    Length,
    /// The rectangle is not the unit's.
    #[error("the result covers another rectangle than the unit")]
    Rect,
    /// A number is NaN or infinite, or a count contradicts the values.
    #[error("the result holds a value that is not finite or a count that cannot be")]
    Value,
}

/// Largest size of a result for `pixels` pixels before compression, bytes.
#[must_use]
pub fn max_encoded_len(pixels: usize) -> usize {
    HEADER + STATISTICS + pixels * (20 + 8 + 28 + 1)
}

impl UnitResult {
    /// The values as they arrive at the other side: rounded to f32 as the encoding does.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let moments = &self.film.moments;
        let counts = moments.first().map_or((0, 0), |m| (m.samples, m.batches));
        let uniform = moments.iter().all(|m| (m.samples, m.batches) == counts);
        let mut flags = 0;
        if !uniform {
            flags |= PER_PIXEL_COUNTS;
        }
        if !self.film.features.is_empty() {
            flags |= WITH_FEATURES;
        }
        let known = moments.iter().any(|m| m.known);
        if known {
            flags |= WITH_KNOWN;
        }
        let mut out = Vec::with_capacity(max_encoded_len(moments.len()));
        out.extend(MAGIC);
        out.extend(u32::to_le_bytes(flags));
        for n in [self.rect.x, self.rect.y, self.rect.w, self.rect.h] {
            out.extend(n.to_le_bytes());
        }
        // One array after the other, not pixel by pixel: like values compress better side by side.
        let counted = if uniform { &moments[..moments.len().min(1)] } else { moments };
        counted.iter().for_each(|m| out.extend(m.samples.to_le_bytes()));
        counted.iter().for_each(|m| out.extend(m.batches.to_le_bytes()));
        for channel in 0..3 {
            moments.iter().for_each(|m| out.extend((m.mean[channel] as f32).to_le_bytes()));
        }
        moments.iter().for_each(|m| out.extend((m.m2.sqrt() as f32).to_le_bytes()));
        moments.iter().for_each(|m| out.extend((m.within.sqrt() as f32).to_le_bytes()));
        for channel in 0..7 {
            self.film.features.iter().for_each(|f| out.extend(feature(f, channel).to_le_bytes()));
        }
        if known {
            out.extend(moments.iter().map(|m| u8::from(m.known)));
        }
        let s = &self.statistics;
        for n in [s.samples, s.rays, s.node_tests, s.primitive_tests, s.rejected] {
            out.extend(n.to_le_bytes());
        }
        for x in [s.clamped, s.cpu_seconds, s.wall_seconds, s.load_seconds, s.build_seconds] {
            out.extend(x.to_le_bytes());
        }
        out
    }

    /// Read a result for the unit that covers `rect`. Anything malformed is an error, never a panic.
    ///
    /// # Errors
    /// See [`BadResult`].
    pub fn decode(bytes: &[u8], rect: Rect) -> Result<UnitResult, BadResult> {
        let mut input = Input(bytes);
        if input.take::<4>()? != MAGIC {
            return Err(BadResult::Magic);
        }
        let flags = input.u32()?;
        if flags & !(PER_PIXEL_COUNTS | WITH_FEATURES | WITH_KNOWN) != 0 {
            return Err(BadResult::Magic);
        }
        let found = Rect { x: input.u32()?, y: input.u32()?, w: input.u32()?, h: input.u32()? };
        if found != rect || rect.area() == 0 {
            return Err(BadResult::Rect);
        }
        let pixels = rect.area();
        let counted = if flags & PER_PIXEL_COUNTS == 0 { 1 } else { pixels };
        let features = if flags & WITH_FEATURES == 0 { 0 } else { pixels };
        let known = if flags & WITH_KNOWN == 0 { 0 } else { pixels };
        if bytes.len() != HEADER + 8 * counted + 20 * pixels + 28 * features + known + STATISTICS {
            return Err(BadResult::Length);
        }
        let mut film =
            Film { moments: vec![Moments::default(); pixels], features: vec![Features::default(); features] };
        let mut column = |set: fn(&mut Moments, u32)| -> Result<(), BadResult> {
            for i in 0..counted {
                let value = input.u32()?;
                let end = if counted == 1 { pixels } else { i + 1 };
                film.moments[i..end].iter_mut().for_each(|m| set(m, value));
            }
            Ok(())
        };
        column(|m, value| m.samples = value)?;
        column(|m, value| m.batches = value)?;
        for channel in 0..3 {
            for m in &mut film.moments {
                m.mean[channel] = f64::from(input.f32()?);
            }
        }
        for m in &mut film.moments {
            let root = f64::from(input.f32()?);
            m.m2 = root * root;
            if root < 0.0 || m.batches > m.samples || (m.batches == 0) != (m.samples == 0) {
                return Err(BadResult::Value);
            }
        }
        for m in &mut film.moments {
            let root = f64::from(input.f32()?);
            m.within = root * root;
            if root < 0.0 {
                return Err(BadResult::Value);
            }
        }
        for channel in 0..7 {
            for f in &mut film.features {
                *feature_mut(f, channel) = input.f32()?;
            }
        }
        for m in &mut film.moments[..known] {
            m.known = match input.take()? {
                [0] => false,
                [1] => true,
                _ => return Err(BadResult::Value),
            };
        }
        let statistics = UnitStatistics {
            samples: input.u64()?,
            rays: input.u64()?,
            node_tests: input.u64()?,
            primitive_tests: input.u64()?,
            rejected: input.u64()?,
            clamped: input.f64()?,
            cpu_seconds: input.f64()?,
            wall_seconds: input.f64()?,
            load_seconds: input.f64()?,
            build_seconds: input.f64()?,
        };
        Ok(UnitResult { rect, film, statistics })
    }
}

fn feature(f: &Features, channel: usize) -> f32 {
    match channel {
        0..3 => f.albedo[channel],
        3..6 => f.normal[channel - 3],
        _ => f.depth,
    }
}

fn feature_mut(f: &mut Features, channel: usize) -> &mut f32 {
    match channel {
        0..3 => &mut f.albedo[channel],
        3..6 => &mut f.normal[channel - 3],
        _ => &mut f.depth,
    }
}

/// Bytes still to be read.
struct Input<'a>(&'a [u8]);

impl Input<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], BadResult> {
        let (head, rest) = self.0.split_first_chunk::<N>().ok_or(BadResult::Length)?;
        self.0 = rest;
        Ok(*head)
    }

    fn u32(&mut self) -> Result<u32, BadResult> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, BadResult> {
        self.take().map(u64::from_le_bytes)
    }

    fn f32(&mut self) -> Result<f32, BadResult> {
        let value = self.take().map(f32::from_le_bytes)?;
        if value.is_finite() { Ok(value) } else { Err(BadResult::Value) }
    }

    fn f64(&mut self) -> Result<f64, BadResult> {
        let value = self.take().map(f64::from_le_bytes)?;
        if value.is_finite() { Ok(value) } else { Err(BadResult::Value) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn result(w: u32, h: u32, uneven: bool, features: bool) -> UnitResult {
        let rect = Rect { x: 8, y: 16, w, h };
        let moments = (0..rect.area() as u32)
            .map(|i| Moments {
                samples: if uneven { 32 + i } else { 32 },
                batches: 2,
                mean: [0.5, f64::from(i), 2.0],
                m2: 0.25,
                within: 2.25,
                known: uneven && i % 2 == 0,
                stopped: false,
            })
            .collect();
        let feature = Features { albedo: [0.1, 0.2, 0.3], normal: [0.0, 1.0, 0.0], depth: 7.0 };
        let features = if features { vec![feature; rect.area()] } else { Vec::new() };
        let statistics = UnitStatistics {
            samples: 9,
            rays: 8,
            cpu_seconds: 0.5,
            load_seconds: 0.25,
            build_seconds: 0.125,
            ..Default::default()
        };
        UnitResult { rect, film: Film { moments, features }, statistics }
    }

    #[test]
    fn bytes_round_trip_and_even_counts_are_sent_once() {
        for (uneven, features) in [(false, false), (true, false), (false, true), (true, true)] {
            let result = result(4, 3, uneven, features);
            let bytes = result.encode();
            assert!(bytes.len() <= max_encoded_len(12));
            assert_eq!(UnitResult::decode(&bytes, result.rect), Ok(result));
        }
        let pixels = 64 * 64;
        assert_eq!(result(64, 64, false, false).encode().len(), HEADER + 8 + 20 * pixels + STATISTICS);
    }

    #[test]
    fn malformed_bytes_are_errors() {
        let result = result(4, 3, true, true);
        let bytes = result.encode();
        for cut in 0..bytes.len() {
            assert!(UnitResult::decode(&bytes[..cut], result.rect).is_err(), "cut at {cut}");
        }
        let longer = [&bytes[..], &[0]].concat();
        assert_eq!(UnitResult::decode(&longer, result.rect), Err(BadResult::Length));
        let elsewhere = Rect { x: 0, ..result.rect };
        assert_eq!(UnitResult::decode(&bytes, elsewhere), Err(BadResult::Rect));
        for bad in [f32::NAN, f32::INFINITY] {
            let mut spoilt = bytes.clone();
            spoilt[HEADER + 8 * 12..][..4].copy_from_slice(&bad.to_le_bytes());
            assert_eq!(UnitResult::decode(&spoilt, result.rect), Err(BadResult::Value));
        }
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..400), w in 0u32..5, h in 0u32..5) {
            let mut bytes = bytes;
            if bytes.len() >= 24 {
                bytes[..4].copy_from_slice(&MAGIC);
                bytes[5..8].fill(0);
                bytes[8..24].fill(0);
                bytes[16] = w as u8;
                bytes[20] = h as u8;
            }
            let _ = UnitResult::decode(&bytes, Rect::frame(w, h));
        }
    }
}
