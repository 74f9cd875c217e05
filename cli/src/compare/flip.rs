//! FLIP: how large a difference looks when one flips between two images on a display.
//!
//! Andersson, Nilsson, Akenine-Moeller, Oskarsson, Aastroem and Fairchild: "FLIP: A Difference Evaluator for
//! Alternating Images", HPG 2020, for images of low dynamic range. Colours are filtered by the eye's contrast
//! sensitivity at the distance they are seen from, compared in a Hunt-adjusted L*a*b* space by the HyAB metric,
//! and the difference is raised where edges or points differ. Values are from 0 (alike) to 1. Sections and
//! equations named below are the paper's.

use std::f64::consts::PI;

/// Pixels per degree of visual angle that the paper takes for usual: a 0.7 m wide display of 3840 pixels, seen
/// from 0.7 m.
pub const PIXELS_PER_DEGREE: f64 = 67.0;

/// Exponent of the colour difference (Section 4.1, q_c).
const COLOUR_EXPONENT: f64 = 0.7;
/// Share of the largest colour difference (p_c) that is mapped to [`KNEE_VALUE`] (p_t).
const KNEE: f64 = 0.4;
const KNEE_VALUE: f64 = 0.95;
/// Exponent of the feature difference (Section 4.2, q_f).
const FEATURE_EXPONENT: f64 = 0.5;
/// Width of the feature detectors in degrees of visual angle (w).
const FEATURE_WIDTH: f64 = 0.082;

/// Contrast sensitivity of each channel of YCxCz as a sum of Gaussians, pairs of amplitude and width (Table 1).
const SENSITIVITY: [&[(f64, f64)]; 3] = [&[(1.0, 0.0047)], &[(1.0, 0.0053)], &[(34.1, 0.04), (13.5, 0.025)]];

/// Linear sRGB to CIE XYZ (D65), as IEC 61966-2-1 has it, with the digits that its primaries give.
const RGB_TO_XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

type Triple = [f64; 3];

/// FLIP of each pixel of two images, row by row: linear RGB, `width` pixels wide, of one size. Values are taken
/// as a display shows them: clipped to 0..1, what is not a number as 0.
#[must_use]
pub fn flip(width: usize, image: &[[f32; 3]], reference: &[[f32; 3]], pixels_per_degree: f64) -> Vec<f64> {
    let space = Space::new();
    let shown = |pixels: &[[f32; 3]]| -> Vec<Triple> {
        pixels.iter().map(|rgb| rgb.map(|v| if v.is_nan() { 0.0 } else { f64::from(v.clamp(0.0, 1.0)) })).collect()
    };
    let sides = [shown(image), shown(reference)].map(|pixels| Seen::of(&space, width, &pixels, pixels_per_degree));
    let [image, reference] = &sides;
    let largest = hyab(space.hunt_lab([0.0, 1.0, 0.0]), space.hunt_lab([0.0, 0.0, 1.0])).powf(COLOUR_EXPONENT);
    let pixel = |i: usize| {
        let colour = spread(hyab(image.colour[i], reference.colour[i]).powf(COLOUR_EXPONENT), largest);
        let edge = (image.edge[i] - reference.edge[i]).abs();
        let point = (image.point[i] - reference.point[i]).abs();
        let feature = (edge.max(point) / 2f64.sqrt()).powf(FEATURE_EXPONENT);
        // Eq. 10.
        colour.powf(1.0 - feature)
    };
    (0..image.colour.len()).map(pixel).collect()
}

/// Colour differences up to a share of the largest take most of the scale (Eq. 6).
fn spread(difference: f64, largest: f64) -> f64 {
    let knee = KNEE * largest;
    if difference < knee {
        KNEE_VALUE / knee * difference
    } else {
        KNEE_VALUE + (difference - knee) / (largest - knee) * (1.0 - KNEE_VALUE)
    }
}

/// City-block in lightness, Euclidean in chroma (Abasi, Amani Tehran and Fairchild 2020).
fn hyab(a: Triple, b: Triple) -> f64 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// An image as the eye sees it.
struct Seen {
    /// Filtered, in Hunt-adjusted L*a*b*.
    colour: Vec<Triple>,
    /// Strength of edges and points in lightness.
    edge: Vec<f64>,
    point: Vec<f64>,
}

impl Seen {
    fn of(space: &Space, width: usize, pixels: &[Triple], pixels_per_degree: f64) -> Self {
        let opponent: Vec<Triple> = pixels.iter().map(|rgb| space.ycxcz(*rgb)).collect();
        let channel = |c: usize| -> Vec<f64> { opponent.iter().map(|pixel| pixel[c]).collect() };
        let filtered = [0, 1, 2].map(|c| by_sensitivity(&channel(c), width, SENSITIVITY[c], pixels_per_degree));
        let colour = (0..pixels.len()).map(|i| {
            let rgb = space.rgb_of_ycxcz([0, 1, 2].map(|c| filtered[c][i]));
            space.hunt_lab(rgb.map(|v| v.clamp(0.0, 1.0)))
        });
        let lightness: Vec<f64> = opponent.iter().map(|pixel| (pixel[0] + 16.0) / 116.0).collect();
        let (edge, point) = features(&lightness, width, pixels_per_degree);
        Self { colour: colour.collect(), edge, point }
    }
}

/// A channel filtered by a sum of Gaussians (Section 4.1.1). Each is a product of one across and one down; in the
/// frequency domain `(a, b)` is a exp(-b f^2).
fn by_sensitivity(channel: &[f64], width: usize, terms: &[(f64, f64)], pixels_per_degree: f64) -> Vec<f64> {
    // Three standard deviations of the widest of all.
    let widest = SENSITIVITY.iter().copied().flatten().fold(0.0, |widest: f64, term| widest.max(term.1));
    let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i32;
    let taps = |b: f64| -> Vec<f64> {
        (-radius..=radius)
            .map(|i| {
                let degrees = f64::from(i) / pixels_per_degree;
                (-PI * PI * degrees * degrees / b).exp()
            })
            .collect()
    };
    let kernels: Vec<(f64, Vec<f64>)> = terms.iter().map(|&(a, b)| (a * (PI / b).sqrt(), taps(b))).collect();
    let total: f64 = kernels.iter().map(|(a, taps)| a * taps.iter().sum::<f64>().powi(2)).sum();
    let mut sum = vec![0.0; channel.len()];
    for (a, taps) in kernels {
        for (sum, part) in sum.iter_mut().zip(separable(channel, width, &taps, &taps)) {
            *sum += a / total * part;
        }
    }
    sum
}

/// Strength of edges and of points: length of the gradient and of the second derivatives, by Gaussian derivatives
/// whose positive and negative taps sum to 1 and -1 each (Section 4.2).
fn features(lightness: &[f64], width: usize, pixels_per_degree: f64) -> (Vec<f64>, Vec<f64>) {
    let deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree;
    let radius = (3.0 * deviation).ceil() as i32;
    let taps = |of: &dyn Fn(f64) -> f64| -> Vec<f64> {
        let all = (-radius..=radius).map(|i| {
            let x = f64::from(i) / deviation;
            of(x) * (-0.5 * x * x).exp()
        });
        balanced(all.collect())
    };
    let (smooth, first, second) = (taps(&|_| 1.0), taps(&|x| -x), taps(&|x| x * x - 1.0));
    let strength = |derivative: &[f64]| -> Vec<f64> {
        let across = separable(lightness, width, derivative, &smooth);
        let down = separable(lightness, width, &smooth, derivative);
        across.iter().zip(down).map(|(x, y)| x.hypot(y)).collect()
    };
    (strength(&first), strength(&second))
}

/// Taps scaled so that those above 0 sum to 1 and those below 0, where there are any, to -1.
fn balanced(mut taps: Vec<f64>) -> Vec<f64> {
    let sum = |sign: f64| -> f64 { taps.iter().map(|tap| (sign * tap).max(0.0)).sum() };
    let (above, below) = (sum(1.0), sum(-1.0));
    taps.iter_mut().for_each(|tap| *tap /= if *tap > 0.0 { above } else { below });
    taps
}

/// A channel under the product of two kernels of odd length; beyond its edges it goes on as it ends there.
fn separable(channel: &[f64], width: usize, across: &[f64], down: &[f64]) -> Vec<f64> {
    let height = channel.len() / width.max(1);
    let one_way = |from: &[f64], taps: &[f64], at: &dyn Fn(usize, usize, isize) -> usize| -> Vec<f64> {
        let radius = (taps.len() / 2) as isize;
        let pixel = |i: usize| {
            let (x, y) = (i % width, i / width);
            (-radius..=radius).zip(taps).map(|(offset, tap)| tap * from[at(x, y, offset)]).sum()
        };
        (0..from.len()).map(pixel).collect()
    };
    let within = |place: usize, offset: isize, end: usize| place.saturating_add_signed(offset).min(end - 1);
    let rows = one_way(channel, across, &|x, y, offset| y * width + within(x, offset, width));
    one_way(&rows, down, &|x, y, offset| within(y, offset, height) * width + x)
}

/// Colour spaces over the white of linear RGB (1, 1, 1).
struct Space {
    white: Triple,
    xyz_to_rgb: [Triple; 3],
}

impl Space {
    fn new() -> Self {
        Self { white: RGB_TO_XYZ.map(|row| row.iter().sum()), xyz_to_rgb: inverse(&RGB_TO_XYZ) }
    }

    /// CIE XYZ relative to white.
    fn relative(&self, rgb: Triple) -> Triple {
        let xyz = times(&RGB_TO_XYZ, rgb);
        [0, 1, 2].map(|c| xyz[c] / self.white[c])
    }

    /// The linearised opponent space of Flohr et al. (1993).
    fn ycxcz(&self, rgb: Triple) -> Triple {
        let [x, y, z] = self.relative(rgb);
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    fn rgb_of_ycxcz(&self, [luma, cx, cz]: Triple) -> Triple {
        let y = (luma + 16.0) / 116.0;
        let relative = [cx / 500.0 + y, y, y - cz / 200.0];
        times(&self.xyz_to_rgb, [0, 1, 2].map(|c| relative[c] * self.white[c]))
    }

    /// CIE L*a*b* whose chroma fades with lightness, as Hunt found it to (Section 4.1.2).
    fn hunt_lab(&self, rgb: Triple) -> Triple {
        const DELTA: f64 = 6.0 / 29.0;
        let root = |t: f64| {
            if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
        };
        let [x, y, z] = self.relative(rgb).map(root);
        let lightness = 116.0 * y - 16.0;
        let hunt = 0.01 * lightness;
        [lightness, hunt * 500.0 * (x - y), hunt * 200.0 * (y - z)]
    }
}

fn times(matrix: &[Triple; 3], v: Triple) -> Triple {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Inverse by cofactors.
fn inverse(m: &[Triple; 3]) -> [Triple; 3] {
    let cofactor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum();
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| cofactor(j, i) / determinant))
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: i32 = 48;
    const HEIGHT: i32 = 40;

    /// An image of bytes in sRGB, as linear RGB.
    fn image(of: impl Fn(i32, i32) -> [i32; 3]) -> Vec<[f32; 3]> {
        let pixels = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
        pixels.map(|(x, y)| of(x, y).map(|byte| super::super::picture::linear(byte as f32 / 255.0))).collect()
    }

    fn ramps(x: i32, y: i32) -> [i32; 3] {
        [(5 * x) % 256, (6 * y) % 256, (2 * x + 3 * y) % 256]
    }

    fn noisy(x: i32, y: i32) -> [i32; 3] {
        let mut c = 0;
        ramps(x, y).map(|v| {
            c += 1;
            (v + (x * x * 31 + y * y * 17 + x * y * 7 + (c - 1) * 11) % 41 - 20).clamp(0, 255)
        })
    }

    fn disk(middle: i32) -> impl Fn(i32, i32) -> [i32; 3] {
        move |x, y| if (x - middle).pow(2) + (y - 20).pow(2) < 150 { [200, 180, 40] } else { [30, 60, 90] }
    }

    fn tinted(x: i32, y: i32) -> [i32; 3] {
        let [r, g, b] = ramps(x, y);
        [r, (g + 12).min(255), b]
    }

    fn dot(x: i32, y: i32) -> [i32; 3] {
        if (x, y) == (20, 15) { [255; 3] } else { [128; 3] }
    }

    /// The authors' own implementation on the same images: flip-evaluator 1.7 (PyPI), `evaluate(reference, test,
    /// "LDR", applyMagma=False)`, which computes in single precision. Its mean and maximum, and its values at
    /// (0, 0), (20, 15), (13, 20) and (47, 39).
    #[test]
    fn agrees_with_the_implementation_of_its_authors() {
        let grey = |_, _| [128; 3];
        for (name, image, reference, mean, max, at) in [
            ("shifted", image(disk(26)), image(disk(24)), 0.179_314_0, 0.821_880, [0.0, 0.245_456, 0.683_944, 0.0]),
            (
                "tinted",
                image(tinted),
                image(ramps),
                0.258_509_1,
                0.352_164,
                [0.130_238, 0.262_841, 0.302_282, 0.322_008],
            ),
            ("noisy", image(noisy), image(ramps), 0.103_366_5, 0.390_855, [0.051_924, 0.080_241, 0.058_480, 0.390_855]),
            ("dot", image(dot), image(grey), 0.002_240_6, 0.378_817, [0.0, 0.378_817, 0.0, 0.0]),
            ("green and blue", image(|_, _| [0, 0, 255]), image(|_, _| [0, 255, 0]), 1.0, 1.0, [1.0; 4]),
        ] {
            let found = flip(WIDTH as usize, &image, &reference, PIXELS_PER_DEGREE);
            let near = |what: &str, found: f64, expected: f64| {
                assert!((found - expected).abs() < 2e-4, "{name}: {what} {found}, not {expected}");
            };
            near("mean", found.iter().sum::<f64>() / found.len() as f64, mean);
            near("maximum", found.iter().copied().fold(0.0, f64::max), max);
            for ((x, y), expected) in [(0, 0), (20, 15), (13, 20), (47, 39)].into_iter().zip(at) {
                near(&format!("at {x}, {y}"), found[(y * WIDTH + x) as usize], expected);
            }
            let swapped = flip(WIDTH as usize, &reference, &image, PIXELS_PER_DEGREE);
            assert_eq!(swapped, found, "{name}: neither side comes first");
        }
        // At 30 pixels per degree, its mean.
        let found = flip(WIDTH as usize, &image(noisy), &image(ramps), 30.0);
        let mean = found.iter().sum::<f64>() / found.len() as f64;
        assert!((mean - 0.197_125_8).abs() < 2e-4, "{mean}");
    }

    #[test]
    fn what_a_display_cannot_show_is_clipped() {
        let alike = |a: f32, b: f32| flip(2, &[[a; 3]; 4], &[[b; 3]; 4], PIXELS_PER_DEGREE).iter().all(|v| *v == 0.0);
        assert!(alike(1.0, 7.0) && alike(0.0, -1.0) && alike(f32::NAN, 0.0) && alike(f32::INFINITY, 1.0));
        assert!(!alike(0.5, 0.6));
    }
}
