//! The soak itself: scenes by methods, shared out to threads, every sample looked at.

use std::{
    collections::BTreeMap,
    path::Path,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
};

use tracer::math::Rgb;

use super::methods::{self, method, words};
use crate::{
    args::{JobOptions, TargetOptions},
    bundle::Bundle,
    error::Failure,
    request,
};

/// Longest edge of an image: what it shows is not of interest, and long rows of pixels are alike.
const LONGEST_EDGE: u32 = 128;
/// Samples of a pixel at a time, so that all of the frame is seen early.
const ROUND: u32 = 64;

/// A scene to be soaked.
pub struct Subject {
    /// Its name in what is printed.
    pub name: String,
    /// The scene and its files.
    pub bundle: Bundle,
    /// Whether it was made here: then it is lit by every method's sum, or something is wrong.
    pub made: bool,
    /// Its share of the samples beside others'.
    pub share: f64,
}

/// What was seen of samples.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tally {
    /// Samples looked at.
    pub samples: u64,
    /// Samples that brought light.
    pub lit: u64,
    /// Samples with a value that is not finite.
    pub not_finite: u64,
    /// Samples with a finite value below 0, and none that is not finite.
    pub negative: u64,
    /// How to see the first bad one again.
    pub replay: Option<String>,
}

impl Tally {
    /// Look at one sample; `replay` names it.
    #[inline]
    pub fn look(&mut self, radiance: Rgb, replay: impl FnOnce() -> String) {
        self.samples += 1;
        // A NaN fails both comparisons.
        if radiance.min_element() >= 0.0 && radiance.is_finite() {
            self.lit += u64::from(radiance.max_element() > 0.0);
            return;
        }
        if radiance.is_finite() {
            self.negative += 1;
        } else {
            self.not_finite += 1;
        }
        self.replay.get_or_insert_with(replay);
    }

    /// Samples that no picture may hold.
    #[must_use]
    pub fn bad(&self) -> u64 {
        self.not_finite + self.negative
    }

    fn add(&mut self, other: Self) {
        self.samples += other.samples;
        self.lit += other.lit;
        self.not_finite += other.not_finite;
        self.negative += other.negative;
        self.replay = self.replay.take().or(other.replay);
    }
}

/// Take every subject through every method, `samples` samples or more altogether, and tell each subject's tally to
/// `done`, in order.
///
/// # Errors
/// A scene that cannot be rendered, or a tally that falls short of what was planned.
pub fn run(
    subjects: &[Subject],
    samples: u64,
    threads: usize,
    done: &(dyn Fn(&Subject, &Tally) -> Result<(), Failure> + Sync),
) -> Result<Tally, Failure> {
    let shares: f64 = subjects.iter().map(|subject| subject.share).sum();
    let cases: Vec<(usize, usize)> =
        (0..subjects.len()).flat_map(|scene| (0..methods::COUNT).map(move |i| (scene, i))).collect();
    let next = AtomicUsize::new(0);
    let progress = Mutex::new(Progress::default());
    let failure = Mutex::new(None);
    let work = || {
        while let Some(&(scene, i)) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
            let subject = &subjects[scene];
            let share = samples as f64 * subject.share / (shares * methods::COUNT as f64);
            let ended = case(subject, method(scene, i), share.ceil() as u64)
                .and_then(|tally| lock(&progress).add(subjects, scene, tally, done));
            if let Err(error) = ended {
                lock(&failure).get_or_insert(error);
                next.store(cases.len(), Ordering::Relaxed);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(work);
        }
    });
    if let Some(failure) = failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(failure);
    }
    let progress = progress.into_inner().unwrap_or_else(PoisonError::into_inner);
    // What was counted is what was looked at: a soak that did less than it was asked to has proved nothing.
    if progress.told != subjects.len() || progress.total.samples < samples {
        let (told, seen) = (progress.told, progress.total.samples);
        let all = subjects.len();
        return Err(Failure::Work(format!("{seen} samples of {told} scenes, where {samples} of {all} were asked for")));
    }
    Ok(progress.total)
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Scenes by the methods they have been through.
#[derive(Default)]
struct Progress {
    /// Of each scene under way: methods done, and their sum.
    open: BTreeMap<usize, (usize, Tally)>,
    /// Scenes told of.
    told: usize,
    total: Tally,
}

impl Progress {
    fn add(
        &mut self,
        subjects: &[Subject],
        scene: usize,
        tally: Tally,
        done: &dyn Fn(&Subject, &Tally) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let (methods, sum) = self.open.entry(scene).or_default();
        *methods += 1;
        sum.add(tally);
        while let Some((methods::COUNT, tally)) = self.open.get(&self.told).cloned() {
            let subject = &subjects[self.told];
            done(subject, &tally)?;
            if subject.made && tally.lit == 0 {
                return Err(Failure::Work(format!("{}: no light in {} samples", subject.name, tally.samples)));
            }
            self.total.add(tally);
            self.open.remove(&self.told);
            self.told += 1;
        }
        Ok(())
    }
}

/// One scene by one method.
fn case(subject: &Subject, options: JobOptions, samples: u64) -> Result<Tally, Failure> {
    let mut bundle = subject.bundle.clone();
    let [w, h] = reduced([bundle.scene.film.width, bundle.scene.film.height]);
    let pixels = u64::from(w) * u64::from(h);
    let each = u32::try_from(samples.div_ceil(pixels).clamp(1, common::job::MAX_SAMPLES.into()));
    let each = each.map_err(|_| Failure::Input(format!("--samples: {samples} are too many of one scene")))?;
    let target = TargetOptions { samples: Some(each), ..TargetOptions::default() };
    let options = JobOptions { resolution: Some([w, h]), target, ..options };
    let request = request::of(&options, &bundle)?;
    let settings = request::settings(&request, &bundle)?;
    let prepared = bundle.load(&request)?.build();
    let replay = |x: u32, y: u32, number: u32| replay(&bundle.path, &options, [x, y], number);
    let mut tally = Tally::default();
    // One sample a row is rendered again, alone: a replay that shows another sample than the image holds is of no use.
    let mut again = Vec::new();
    for first in (0..each).step_by(ROUND as usize) {
        let last = each.min(first + ROUND);
        for y in 0..h {
            prepared.samples(&settings, y, first..last, |x, number, radiance| {
                tally.look(radiance, || replay(x, y, number));
                if number == 0 && x == y % w {
                    again.push(([x, y], radiance));
                }
            });
        }
    }
    for (pixel, radiance) in again {
        let alone = prepared.sample(&settings, pixel, 0).radiance;
        if alone.to_array().map(f32::to_bits) != radiance.to_array().map(f32::to_bits) {
            let command = replay(pixel[0], pixel[1], 0);
            return Err(Failure::Work(format!("{alone} alone, {radiance} in its image: {command}")));
        }
    }
    if tally.samples != pixels * u64::from(each) {
        return Err(Failure::Work(format!("{}: {} samples of {pixels} x {each}", subject.name, tally.samples)));
    }
    Ok(tally)
}

/// The command that renders one sample again, alone.
fn replay(scene: &Path, options: &JobOptions, [x, y]: [u32; 2], number: u32) -> String {
    format!("tessera render {} {} --pixel {x},{y} --sample {number}", scene.display(), words(options))
}

/// A resolution of the same shape whose longer edge is at most [`LONGEST_EDGE`].
fn reduced([w, h]: [u32; 2]) -> [u32; 2] {
    let longest = w.max(h);
    if longest <= LONGEST_EDGE {
        return [w, h];
    }
    [w, h].map(|edge| (edge * LONGEST_EDGE).div_ceil(longest))
}
