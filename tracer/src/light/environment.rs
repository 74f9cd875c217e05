//! What rays that leave the scene meet: the same radiance everywhere, or a picture of the surroundings.
//!
//! A picture is looked up with bilinear interpolation. Light sampling chooses one of its cells with
//! probability in proportion to the mean of the interpolated picture over the cell times the cell's solid
//! angle, then a direction uniformly within that solid angle: where the picture shines, the
//! density is above 0, poles included. Where BSDF sampling finds light too, the picture's mean is left to it
//! ([`ImageEnvironment::compensated`]).

use std::{f64::consts::PI, sync::Arc};

use super::delta::mean;
use crate::math::{
    DAffine3, Frame, INV_PI, Rgb, TAU, UNIFORM_SPHERE_PDF, Vec2, Vec3, acos, atan2, cosine_hemisphere, safe_sqrt,
    sin_cos_turns, uniform_sphere,
};

/// Radiance from infinitely far away.
#[derive(Debug, Clone)]
pub enum Environment {
    /// The same from everywhere.
    Constant(Rgb),
    /// A picture.
    Image(Arc<ImageEnvironment>),
}

impl Environment {
    /// Radiance that arrives from the unit direction `wi`.
    #[inline]
    #[must_use]
    pub fn radiance(&self, wi: Vec3) -> Rgb {
        match self {
            Self::Constant(radiance) => *radiance,
            Self::Image(image) => image.radiance(wi),
        }
    }

    /// A direction, for a surface with unit normal `n` that reflects only, or for any scatterer where `n`
    /// is 0.
    #[inline]
    #[must_use]
    pub fn sample(&self, n: Vec3, u: Vec2) -> Vec3 {
        match self {
            Self::Constant(_) if n == Vec3::ZERO => uniform_sphere(u),
            Self::Constant(_) => Frame::from_normal(n).to_world(cosine_hemisphere(u)),
            Self::Image(image) => image.sample(u),
        }
    }

    /// Density per solid angle with which [`Environment::sample`] chooses `wi`.
    #[inline]
    #[must_use]
    pub fn pdf(&self, n: Vec3, wi: Vec3) -> f32 {
        match self {
            Self::Constant(_) if n == Vec3::ZERO => UNIFORM_SPHERE_PDF,
            Self::Constant(_) => n.dot(wi).max(0.0) * INV_PI,
            Self::Image(image) => image.pdf(wi),
        }
    }

    /// Power that enters a scene bounded by a sphere of `radius`: the mean of the three channels, W.
    #[must_use]
    pub fn power(&self, radius: f64) -> f64 {
        // Projected area pi r^2, from every direction.
        PI * radius
            * radius
            * match self {
                Self::Constant(radiance) => 4.0 * PI * mean(*radiance),
                Self::Image(image) => image.fluence,
            }
    }
}

/// Most cells that directions are chosen among, 4 bytes each. Up to 2048 x 1024 every pixel has four; pixels
/// of larger pictures share.
const MAX_CELLS: usize = 1 << 23;

/// An equirectangular picture: its top is +y and its middle column looks along -z.
#[derive(Debug, Clone)]
pub struct ImageEnvironment {
    width: usize,
    height: usize,
    pixels: Vec<Rgb>,
    /// Columns of the rotation from its own space to the world.
    axes: [Vec3; 3],
    cells: Cells,
    /// Integral of the mean of the channels over all directions.
    fluence: f64,
}

/// Probabilities of cells, as rising sums: whoever samples and whoever asks for a density sees the
/// differences of the same stored numbers.
#[derive(Debug, Clone)]
struct Cells {
    columns: usize,
    rows: usize,
    /// `rows` + 1 sums.
    marginal: Vec<f32>,
    /// `columns` + 1 sums a row.
    conditional: Vec<f32>,
    /// Cosines of the polar angles between rows, from 1 down to -1.
    cosines: Vec<f32>,
}

impl ImageEnvironment {
    /// A picture of linear radiances, rows from the top. `to_world` is a rotation (of anything else the
    /// nearest right angles are taken, in order of x, y, z). `None` where there are no pixels or their
    /// number is not width x height.
    #[must_use]
    pub fn new(width: usize, height: usize, mut pixels: Vec<Rgb>, scale: Rgb, to_world: &DAffine3) -> Option<Self> {
        if width == 0 || height == 0 || pixels.len() != width.checked_mul(height)? {
            return None;
        }
        for pixel in &mut pixels {
            // Bad pixels are dark: one NaN would reach every pixel of the image.
            *pixel = (*pixel * scale).map(|v| if v.is_finite() { v.max(0.0) } else { 0.0 });
        }
        let m = to_world.matrix3;
        let x = m.x_axis.try_normalize()?;
        let y = (m.y_axis - x * x.dot(m.y_axis)).try_normalize()?;
        let z = x.cross(y);
        let z = if z.dot(m.z_axis) < 0.0 { -z } else { z };
        let (cells, fluence) = Cells::new(width, height, &pixels, 0.0);
        Some(Self { width, height, pixels, axes: [x.as_vec3(), y.as_vec3(), z.as_vec3()], cells, fluence })
    }

    /// The same picture for light sampling beside BSDF sampling under multiple importance sampling: the density
    /// follows what the picture has above its mean, and is 0 below, where BSDF sampling does as well (Karlik, Sik,
    /// Vevoda, Skrivan and Krivanek, "MIS Compensation", 2019, section 5). For light sampling alone it would miss
    /// light.
    #[must_use]
    pub fn compensated(mut self) -> Self {
        (self.cells, _) = Cells::new(self.width, self.height, &self.pixels, self.fluence / (4.0 * PI));
        self
    }

    /// Radiance from the unit direction `wi`.
    #[must_use]
    pub fn radiance(&self, wi: Vec3) -> Rgb {
        let at = self.position(wi);
        // Centres of pixels lie at half-integers; columns wrap around, rows end.
        let (x, y) = (at.x * self.width as f32 - 0.5, at.y * self.height as f32 - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let column = |x: f32| (x as i64).rem_euclid(self.width as i64) as usize;
        let row = |y: f32| (y.max(0.0) as usize).min(self.height - 1);
        let pixel = |x: f32, y: f32| self.pixels[row(y) * self.width + column(x)];
        let top = pixel(x0, y0) * (1.0 - fx) + pixel(x0 + 1.0, y0) * fx;
        let bottom = pixel(x0, y0 + 1.0) * (1.0 - fx) + pixel(x0 + 1.0, y0 + 1.0) * fx;
        top * (1.0 - fy) + bottom * fy
    }

    /// A direction for `u`.
    fn sample(&self, u: Vec2) -> Vec3 {
        let cells = &self.cells;
        let (row, v) = pick(&cells.marginal, u.y);
        let (column, h) = pick(cells.row(row), u.x);
        let (top, bottom) = (cells.cosines[row], cells.cosines[row + 1]);
        let y = top + (bottom - top) * v;
        let r = safe_sqrt((1.0 - y) * (1.0 + y));
        let (sin, cos) = sin_cos_turns(((column as f32 + h) / cells.columns as f32).clamp(0.0, 1.0));
        // The middle column looks along -z, and the turn grows towards +x.
        let [x_axis, y_axis, z_axis] = self.axes;
        (x_axis * (-r * sin) + y_axis * y + z_axis * (r * cos)).normalize()
    }

    /// Density of [`ImageEnvironment::sample`].
    fn pdf(&self, wi: Vec3) -> f32 {
        let cells = &self.cells;
        let at = self.position(wi);
        let column = ((at.x * cells.columns as f32) as usize).min(cells.columns - 1);
        let row = ((at.y * cells.rows as f32) as usize).min(cells.rows - 1);
        let sums = cells.row(row);
        let probability = (cells.marginal[row + 1] - cells.marginal[row]) * (sums[column + 1] - sums[column]);
        let solid_angle = TAU / cells.columns as f32 * (cells.cosines[row] - cells.cosines[row + 1]);
        (probability / solid_angle).min(f32::MAX)
    }

    /// Where in the picture the unit direction `wi` lies: (0, 0) is the top left corner, (1, 1) the
    /// bottom right one.
    #[inline]
    fn position(&self, wi: Vec3) -> Vec2 {
        let [x, y, z] = self.axes.map(|axis| axis.dot(wi));
        // Near the poles an arc cosine is coarse; the angle of (radius, height) is not.
        let polar = if y.abs() < 0.9 { acos(y) } else { atan2(safe_sqrt(x * x + z * z), y) };
        Vec2::new((0.5 + atan2(x, -z) / TAU).clamp(0.0, 1.0), (polar * INV_PI).clamp(0.0, 1.0))
    }
}

impl Cells {
    /// The cells of a picture, in proportion to what it has above a radiance of `least`; and the integral of the
    /// mean of its channels over all directions.
    fn new(width: usize, height: usize, pixels: &[Rgb], least: f64) -> (Self, f64) {
        // Half pixels: within one the interpolant is smooth, and nothing but its own slope makes noise.
        let (across, down) = (2 * width, 2 * height);
        let mut block = 1;
        while across.div_ceil(block) * down.div_ceil(block) > MAX_CELLS {
            block += 1;
        }
        let (columns, rows) = (across.div_ceil(block), down.div_ceil(block));
        let polar_cosine = |row: usize, rows: usize| libm::cos(PI * row as f64 / rows as f64);
        let mut weights = vec![0.0f64; columns * rows];
        let mut fluence = 0.0;
        let value = |x: usize, y: usize| mean(pixels[y * width + x]);
        for j in 0..down {
            let y = j / 2;
            let beside = if j % 2 == 0 { y.saturating_sub(1) } else { (y + 1).min(height - 1) };
            let solid_angle = (polar_cosine(j, down) - polar_cosine(j + 1, down)) * 2.0 * PI / across as f64;
            for i in 0..across {
                let x = i / 2;
                let next = if i % 2 == 0 { (x + width - 1) % width } else { (x + 1) % width };
                // The mean of the interpolant over a half pixel weighs the pixel and its neighbour 3:1 each way.
                let row = |y: usize| 3.0 * value(x, y) + value(next, y);
                let integral = (3.0 * row(y) + row(beside)) / 16.0 * solid_angle;
                fluence += integral;
                let above = (integral - least * solid_angle).max(0.0);
                for (row, height_share) in overlaps(j, down, rows) {
                    for (column, width_share) in overlaps(i, across, columns) {
                        weights[row * columns + column] += above * height_share * width_share;
                    }
                }
            }
        }
        // Of a picture that is the same all over, rounding would be all that is left.
        if least > 0.0 && weights.iter().sum::<f64>() <= 1e-3 * fluence {
            return Self::new(width, height, pixels, 0.0);
        }
        let mut conditional = Vec::with_capacity((columns + 1) * rows);
        let mut row_sums = Vec::with_capacity(rows);
        for row in weights.chunks_exact(columns) {
            row_sums.push(row.iter().sum());
            rising_sums(row, &mut conditional);
        }
        let mut marginal = Vec::with_capacity(rows + 1);
        rising_sums(&row_sums, &mut marginal);
        let cosines = (0..=rows).map(|row| polar_cosine(row, rows) as f32).collect();
        (Self { columns, rows, marginal, conditional, cosines }, fluence)
    }

    #[inline]
    fn row(&self, row: usize) -> &[f32] {
        &self.conditional[row * (self.columns + 1)..(row + 1) * (self.columns + 1)]
    }
}

/// The cells out of `cells` that part `index` out of `parts` lies in, at most two since there are no more
/// cells than parts, and its share in each.
fn overlaps(index: usize, parts: usize, cells: usize) -> [(usize, f64); 2] {
    // In units of 1 / (parts x cells) everything is a whole number.
    let (begin, end) = (index * cells, (index + 1) * cells);
    let cell = begin / parts;
    let edge = ((cell + 1) * parts).min(end);
    let share = (edge - begin) as f64 / cells as f64;
    [(cell, share), ((cell + 1).min(cells - 1), 1.0 - share)]
}

/// Append the sums of the first 0, 1, ... of `weights`, divided by their total; equal steps where it is 0.
/// A weight above 0 makes a step above 0, however small it is.
fn rising_sums(weights: &[f64], sums: &mut Vec<f32>) {
    let total: f64 = weights.iter().sum();
    let floor = total * f64::from(f32::EPSILON);
    let step = |w: f64| match (total > 0.0, w > 0.0) {
        (true, true) => w.max(floor),
        (true, false) => 0.0,
        (false, _) => 1.0,
    };
    let total: f64 = weights.iter().map(|&w| step(w)).sum();
    let mut sum = 0.0;
    sums.push(0.0);
    for (i, &w) in weights.iter().enumerate() {
        sum += step(w);
        sums.push(if i + 1 == weights.len() { 1.0 } else { (sum / total) as f32 });
    }
}

/// The step of rising sums from 0 to 1 that `u` falls into, and where in it.
#[inline]
fn pick(sums: &[f32], u: f32) -> (usize, f32) {
    let last = sums.len() - 2;
    let index = sums.partition_point(|&s| s <= u).saturating_sub(1).min(last);
    let width = sums[index + 1] - sums[index];
    (index, if width > 0.0 { ((u - sums[index]) / width).clamp(0.0, 1.0) } else { 0.5 })
}
