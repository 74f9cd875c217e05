//! Complex indices of refraction of measured metals, per channel of linear Rec. 709.
//!
//! Spectra: Johnson and Christy 1972 (Au, Ag, Cu) and 1974 (Cr), Rakic 1995 (Al), as tabulated in the
//! public-domain (CC0) refractiveindex.info database, read linearly between the wavelengths.
//!
//! A channel's (eta, k) is the pair whose Fresnel curve is nearest, by least squares over the cosine, to
//! the channel of the colour that the spectral metal has under equal-energy light at each angle: the
//! spectral reflectance under the CIE 1931 matching functions (Wyman, Sloan and Shirley 2013, lobes),
//! taken to Rec. 709, white to 1. Where that colour leaves the gamut (gold's red) it is held to what the
//! spectrum reaches at most. Averaging eta and k themselves would be simpler and give another colour. The
//! tests repeat the derivation.

use common::scene::Metal;

use super::ComplexIndex;
use crate::math::Vec3;

/// Index of refraction of a metal, in air.
#[must_use]
pub fn index(metal: Metal) -> ComplexIndex {
    let (eta, k) = match metal {
        Metal::Au => ([0.1364, 0.4894, 1.4887], [4.4453, 2.2736, 1.7562]),
        Metal::Ag => ([0.0558, 0.0550, 0.0431], [4.3517, 3.5592, 2.5619]),
        Metal::Cu => ([0.2644, 1.0377, 1.3042], [3.1837, 2.6261, 2.3462]),
        Metal::Al => ([1.4492, 0.9910, 0.5934], [7.5493, 6.5627, 5.2996]),
        Metal::Cr => ([3.2196, 3.1239, 2.2649], [3.2914, 3.3363, 3.1043]),
    };
    ComplexIndex { eta: Vec3::from_array(eta), k: Vec3::from_array(k) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fresnel::{conductor, schlick};

    /// Wavelength in nm, eta, k.
    #[allow(clippy::approx_constant)] // 3.14 was measured.
    fn spectrum(metal: Metal) -> Vec<[f64; 3]> {
        const NOBLE: [f64; 14] =
            [381.5, 397.4, 413.3, 430.5, 450.9, 471.4, 495.9, 520.9, 548.6, 582.1, 616.8, 659.5, 704.5, 756.0];
        let join = |eta: [f64; 14], k: [f64; 14]| (0..14).map(|i| [NOBLE[i], eta[i], k[i]]).collect();
        match metal {
            Metal::Au => join(
                [1.46, 1.47, 1.46, 1.45, 1.38, 1.31, 1.04, 0.62, 0.43, 0.29, 0.21, 0.14, 0.13, 0.14],
                [1.933, 1.952, 1.958, 1.948, 1.914, 1.849, 1.833, 2.081, 2.455, 2.863, 3.272, 3.697, 4.103, 4.542],
            ),
            Metal::Ag => join(
                [0.05, 0.05, 0.05, 0.04, 0.04, 0.05, 0.05, 0.05, 0.06, 0.05, 0.06, 0.05, 0.04, 0.03],
                [1.864, 2.070, 2.275, 2.462, 2.657, 2.869, 3.093, 3.324, 3.586, 3.858, 4.152, 4.483, 4.838, 5.242],
            ),
            Metal::Cu => join(
                [1.33, 1.32, 1.28, 1.25, 1.24, 1.25, 1.22, 1.18, 1.02, 0.70, 0.30, 0.22, 0.21, 0.24],
                [2.045, 2.116, 2.207, 2.305, 2.397, 2.483, 2.564, 2.608, 2.577, 2.704, 3.205, 3.747, 4.205, 4.665],
            ),
            Metal::Al => vec![
                [364.66, 0.39877, 4.3957],
                [413.28, 0.52135, 5.0008],
                [442.80, 0.60790, 5.3676],
                [476.87, 0.72780, 5.7781],
                [516.60, 0.87340, 6.2418],
                [563.57, 1.0728, 6.7839],
                [619.93, 1.3660, 7.4052],
                [652.25, 1.5724, 7.7354],
                [688.81, 1.8301, 8.0601],
                [729.32, 2.1606, 8.3565],
                [774.91, 2.6154, 8.4914],
            ],
            Metal::Cr => {
                let wavelength = [381, 397, 413, 431, 451, 471, 496, 521, 549, 582, 617, 659, 704, 756];
                let k = [2.74, 2.83, 2.93, 3.04, 3.14, 3.24, 3.30, 3.33, 3.33, 3.30, 3.30, 3.34, 3.39, 3.42];
                let eta = [1.92, 2.00, 2.08, 2.19, 2.33, 2.51, 2.75, 2.94, 3.18, 3.22, 3.17, 3.09, 3.05, 3.08];
                (0..14).map(|i| [f64::from(wavelength[i]), eta[i], k[i]]).collect()
            }
        }
    }

    /// CIE 1931 matching functions at a wavelength in nm, as fitted by Wyman et al., in Rec. 709.
    fn matching(nm: f64) -> [f64; 3] {
        let lobe = |mean: f64, below: f64, above: f64| {
            let t = (nm - mean) * if nm < mean { below } else { above };
            (-0.5 * t * t).exp()
        };
        let x = 0.362 * lobe(442.0, 0.0624, 0.0374) + 1.056 * lobe(599.8, 0.0264, 0.0323)
            - 0.065 * lobe(501.1, 0.0490, 0.0382);
        let y = 0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322);
        let z = 1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725);
        [
            3.2406 * x - 1.5372 * y - 0.4986 * z,
            -0.9689 * x + 1.8758 * y + 0.0415 * z,
            0.0557 * x - 0.2040 * y + 1.0570 * z,
        ]
    }

    const METALS: [Metal; 5] = [Metal::Au, Metal::Ag, Metal::Cu, Metal::Al, Metal::Cr];

    #[test]
    fn channels_follow_the_colour_of_the_spectral_metal_at_every_angle() {
        for metal in METALS {
            let table = spectrum(metal);
            for cos in [1.0f32, 0.8, 0.6, 0.4, 0.2, 0.05] {
                let (mut colour, mut white, mut most) = ([0.0; 3], [0.0; 3], 0.0f64);
                for i in 0..74 {
                    let nm = 385.0 + 5.0 * f64::from(i);
                    let j = table.windows(2).position(|w| w[0][0] <= nm && nm <= w[1][0]).expect("nm is in the table");
                    let (a, b) = (table[j], table[j + 1]);
                    let t = (nm - a[0]) / (b[0] - a[0]);
                    let at = |i: usize| (a[i] + (b[i] - a[i]) * t) as f32;
                    let reflectance = f64::from(conductor(cos, at(1), at(2)));
                    most = most.max(reflectance);
                    for (c, m) in matching(nm).into_iter().enumerate() {
                        colour[c] += m * reflectance;
                        white[c] += m;
                    }
                }
                let found = index(metal).reflectance(cos);
                for c in 0..3 {
                    let expected = (colour[c] / white[c]).min(most);
                    assert!((f64::from(found[c]) - expected).abs() < 0.004, "{metal:?} {cos} {c}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn schlick_is_off_by_what_is_said_of_it() {
        // Greatest error over angles in the green channel.
        for (metal, expected) in METALS.into_iter().zip([0.0043, 0.0060, 0.0430, 0.0945, 0.1950]) {
            let metal = index(metal);
            let f0 = metal.reflectance(1.0).y;
            let error = (0..=1000)
                .map(|i| i as f32 / 1000.0)
                .map(|cos| (schlick(f0, cos) - metal.reflectance(cos).y).abs())
                .fold(0.0, f32::max);
            assert!((error - expected).abs() < 5e-4, "{error} {expected}");
        }
    }
}
