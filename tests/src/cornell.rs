//! The Cornell box's colours, from its published spectra.
//!
//! Cornell University Program of Computer Graphics, "Cornell Box Data": reflectances of the three paints every
//! 4 nm from 400 to 700 nm, and the lamp's emission at four wavelengths, linear between them. A colour is the
//! spectrum weighted with the CIE 1931 colour matching functions, taken to linear Rec. 709, with each channel
//! divided by that of an equal-energy spectrum: a perfect white is 1, 1, 1. The unit of the lamp's emission is
//! open; scenes/cornell-box.json takes it [`EXPOSURE`] times, which shows the box as bright as it looks.

/// What the lamp's published values are multiplied by.
pub const EXPOSURE: f64 = 2.0;

/// Wavelengths of the tables below: 400, 404, ... 700 nm.
const SAMPLES: usize = 76;

/// Reflectance of the white paint, thousandths.
#[rustfmt::skip]
const WHITE: [u16; SAMPLES] = [
    343, 445, 551, 624, 665, 687, 708, 723, 715, 710, 745, 758, 739, 767, 777, 765, 751, 745, 748,
    729, 745, 757, 753, 750, 746, 747, 735, 732, 739, 734, 725, 721, 733, 725, 732, 743, 744, 748,
    728, 716, 733, 726, 713, 740, 754, 764, 752, 736, 734, 741, 740, 732, 745, 755, 751, 744, 731,
    733, 744, 731, 712, 708, 729, 730, 727, 707, 703, 729, 750, 760, 751, 739, 724, 730, 740, 737,
];

/// Reflectance of the green paint, thousandths.
#[rustfmt::skip]
const GREEN: [u16; SAMPLES] = [
    92, 96, 98, 97, 98, 95, 95, 97, 95, 94, 97, 98, 96, 101, 103, 104, 107, 109, 112,
    115, 125, 140, 160, 187, 229, 285, 343, 390, 435, 464, 472, 476, 481, 462, 447, 441, 426, 406,
    373, 347, 337, 314, 285, 277, 266, 250, 230, 207, 186, 171, 160, 148, 141, 136, 130, 126, 123,
    121, 122, 119, 114, 115, 117, 117, 118, 120, 122, 128, 132, 139, 144, 146, 150, 152, 157, 159,
];

/// Reflectance of the red paint, thousandths.
#[rustfmt::skip]
const RED: [u16; SAMPLES] = [
    40, 46, 48, 53, 49, 50, 53, 55, 57, 56, 59, 57, 61, 61, 60, 62, 62, 62, 61,
    62, 60, 59, 57, 58, 58, 58, 56, 55, 56, 59, 57, 55, 59, 59, 58, 59, 61, 61,
    63, 63, 67, 68, 72, 80, 90, 99, 124, 154, 192, 255, 287, 349, 402, 443, 487, 513, 558,
    584, 620, 606, 609, 651, 612, 610, 650, 638, 627, 620, 630, 628, 642, 639, 657, 639, 635, 642,
];

/// The lamp's emission: wavelength in nm, radiance.
const LAMP: [(f64, f64); 4] = [(400.0, 0.0), (500.0, 8.0), (600.0, 15.6), (700.0, 18.4)];

/// Name of a material of scenes/cornell-box.json, or `lamp`, and its colour.
#[must_use]
pub fn colours() -> Vec<(&'static str, [f64; 3])> {
    let paint = |table: &[u16; SAMPLES]| table.map(|thousandths| f64::from(thousandths) / 1000.0);
    let lamp = std::array::from_fn(|i| {
        let nm = wavelength(i);
        let next = LAMP.partition_point(|(at, _)| *at < nm).clamp(1, LAMP.len() - 1);
        let ((a, below), (b, above)) = (LAMP[next - 1], LAMP[next]);
        EXPOSURE * (below + (above - below) * (nm - a) / (b - a))
    });
    [("white", paint(&WHITE)), ("green", paint(&GREEN)), ("red", paint(&RED)), ("lamp", lamp)]
        .map(|(name, spectrum)| (name, colour(&spectrum)))
        .to_vec()
}

fn wavelength(sample: usize) -> f64 {
    400.0 + 4.0 * sample as f64
}

fn colour(spectrum: &[f64; SAMPLES]) -> [f64; 3] {
    let (found, white) = (rec709(spectrum), rec709(&[1.0; SAMPLES]));
    std::array::from_fn(|c| found[c] / white[c])
}

fn rec709(spectrum: &[f64; SAMPLES]) -> [f64; 3] {
    let mut xyz = [0.0; 3];
    for (i, value) in spectrum.iter().enumerate() {
        for (sum, weight) in xyz.iter_mut().zip(matching(wavelength(i))) {
            *sum += value * weight;
        }
    }
    const ROWS: [[f64; 3]; 3] =
        [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]];
    ROWS.map(|row| row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2])
}

/// The colour matching functions of the CIE 1931 standard observer, as the sums of skewed Gaussians of Wyman,
/// Sloan and Shirley (2013), equation 4.
fn matching(nm: f64) -> [f64; 3] {
    let lobe = |height: f64, peak: f64, below: f64, above: f64| {
        let t = (nm - peak) * if nm < peak { below } else { above };
        height * (-0.5 * t * t).exp()
    };
    [
        lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(1.056, 599.8, 0.0264, 0.0323) - lobe(0.065, 501.1, 0.0490, 0.0382),
        lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322),
        lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725),
    ]
}
