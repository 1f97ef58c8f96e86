//! Cosines fitted to samples at arbitrary points of a block of pixels, and the visibility of errors by frequency and luminance.

use crate::tree::{At, Cell};
use std::f64::consts::PI;

/// The side of a block in pixels.
pub(super) const SIDE: u32 = 8;
/// The number of different frequencies along an axis in products of two cosines.
const FREQUENCIES: usize = 2 * SIDE as usize;

/// The scale of radiance on which cosines are fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CosineScale {
    /// Linear radiance.
    #[default]
    Linear,
    /// The logarithm `ln(1 + x)`: less ringing around lights, but too dark where there is noise.
    Log,
}

dapple_core::choices!(CosineScale { Linear = "linear", Log = "log" });

dapple_core::options! {
    /// The parameters of the cosines that [`Dct`](crate::Dct) and [`DctFilter`](crate::DctFilter) fit to blocks.
    pub struct CosineOptions {
        /// Number of cosine terms as a fraction of the block's samples, at most one per pixel; 0.5 as published.
        pub share: f64 = 0.5, |share| share > 0.0 && share <= 1.0, "above 0 and at most 1";
        /// Weight of the fit's penalty on high frequencies, the sum of (coefficient x frequency)^2.
        pub lambda: f64 = 1e-3 => "0.001", |l| (1e-6..=1e6).contains(&l), "1e-6 to 1e6";
        /// Scale on which radiance is fitted: linear, or log (ln(1 + x): less ringing, but darkens noisy areas).
        pub scale: CosineScale = CosineScale::Linear => "linear";
    }
}

impl CosineScale {
    /// The luminance of a sample, and the differences of its red and blue from the luminance.
    pub(super) fn opponent(self, rgb: [f32; 3]) -> [f64; 3] {
        let [r, g, b] = rgb.map(|x| match self {
            Self::Linear => f64::from(x),
            Self::Log => libm::log1p(f64::from(x)),
        });
        let y = RED * r + GREEN * g + BLUE * b;
        [y, r - y, b - y]
    }

    /// The radiance of a colour in opponent space; 0 where the result is negative or NaN.
    pub(super) fn radiance(self, [y, red, blue]: [f64; 3]) -> [f32; 3] {
        let (r, b) = (y + red, y + blue);
        let g = (y - RED * r - BLUE * b) / GREEN;
        [r, g, b].map(|x| {
            let x = match self {
                Self::Linear => x,
                Self::Log => libm::expm1(x),
            };
            if x > 0.0 { x.min(f64::from(f32::MAX)) as f32 } else { 0.0 }
        })
    }
}

/// The weights of luminance [ITU-R BT.709].
const RED: f64 = 0.2126;
const GREEN: f64 = 0.7152;
const BLUE: f64 = 0.0722;

/// The frequencies of all cosines of a block in half waves along x and y, the lowest first. On 8x8 pixels this is JPEG's zigzag
/// order. On smaller blocks the order is by frequency per pixel.
fn frequencies([width, height]: [usize; 2]) -> Vec<[usize; 2]> {
    let mut all: Vec<[usize; 2]> = (0..height).flat_map(|v| (0..width).map(move |u| [u, v])).collect();
    let key = |[u, v]: &[usize; 2]| (u * height + v * width, if (u + v) % 2 == 0 { *u } else { *v });
    all.sort_by_key(key);
    all
}

/// The factor that gives a cosine a mean square of 1 over the block.
fn norm(frequency: usize) -> f64 {
    if frequency == 0 { 1.0 } else { std::f64::consts::SQRT_2 }
}

/// The cosines of the multiples 0, 1, 2, … of an angle.
fn multiples(angle: f64) -> [f64; FREQUENCIES] {
    let mut all = [1.0; FREQUENCIES];
    all[1] = libm::cos(angle);
    for k in 2..FREQUENCIES {
        all[k] = 2.0 * all[1] * all[k - 1] - all[k - 2];
    }
    all
}

/// The cosines along both axes at a point of a block.
struct Waves([[f64; FREQUENCIES]; 2]);

impl Waves {
    fn at(at: &At, size: [usize; 2]) -> Self {
        Self([0, 1].map(|axis| multiples(PI * f64::from(at[axis]) / size[axis] as f64)))
    }

    /// The means of the cosines over a pixel.
    fn over_pixel(pixel: [usize; 2], size: [usize; 2]) -> Self {
        Self([0, 1].map(|axis| {
            let per_pixel = PI / size[axis] as f64;
            let waves = multiples(per_pixel * (pixel[axis] as f64 + 0.5));
            std::array::from_fn(|k| {
                let half = 0.5 * per_pixel * k as f64;
                if k == 0 { 1.0 } else { waves[k] * libm::sin(half) / half }
            })
        }))
    }

    fn of(&self, [u, v]: [usize; 2]) -> f64 {
        norm(u) * norm(v) * self.0[0][u] * self.0[1][v]
    }
}

/// Sums over samples of products of cosines. All products of two basis functions follow from them.
struct Products([[f64; FREQUENCIES]; FREQUENCIES]);

impl Products {
    /// The sum over samples of the product of two basis functions.
    fn of(&self, [u, v]: [usize; 2], [s, t]: [usize; 2]) -> f64 {
        let sum: f64 = [v + t, v.abs_diff(t)].iter().map(|&y| self.0[y][u + s] + self.0[y][u.abs_diff(s)]).sum();
        0.25 * norm(u) * norm(v) * norm(s) * norm(t) * sum
    }
}

/// Cosines fitted to the samples of a block, for luminance and the red and blue differences.
#[derive(Debug)]
pub(super) struct Fit {
    pub(super) size: [usize; 2],
    /// The frequencies of all cosines of the block, the lowest first.
    pub(super) frequencies: Vec<[usize; 2]>,
    /// The coefficients of the fitted (lowest) frequencies, for each channel.
    pub(super) coefficients: [Vec<f64>; 3],
}

impl Fit {
    /// The fit that minimises the sum of squared deviations plus `lambda` times the sum of squared coefficients times squared
    /// frequencies; `None` without samples. Chroma has half as many coefficients as luminance.
    pub(super) fn new(block: &Cell, options: &CosineOptions) -> Option<Self> {
        if block.at.is_empty() {
            return None;
        }
        let size = block.size.map(|n| n as usize);
        let frequencies = frequencies(size);
        let luminances = ((options.share * block.at.len() as f64) as usize).clamp(1, frequencies.len());
        let fitted = &frequencies[..luminances];
        let (products, sides) = sums(block, options.scale, fitted);
        let factor = cholesky(luminances, |j, k| {
            let penalty = if j == k { options.lambda * squared(fitted[j], size) } else { 0.0 };
            products.of(fitted[j], fitted[k]) + penalty
        });
        let coefficients = [0, 1, 2].map(|channel| {
            let number = if channel == 0 { luminances } else { (luminances / 2).max(1) };
            solve(&factor, sides[..number].iter().map(|side| side[channel]).collect())
        });
        Some(Self { size, frequencies, coefficients })
    }

    fn value(&self, waves: &Waves) -> [f64; 3] {
        [0, 1, 2].map(|c| {
            let terms = self.coefficients[c].iter().zip(&self.frequencies);
            terms.map(|(coefficient, &frequency)| coefficient * waves.of(frequency)).sum()
        })
    }

    /// The fitted colour at a point.
    pub(super) fn at(&self, at: &At) -> [f64; 3] {
        self.value(&Waves::at(at, self.size))
    }

    /// The mean of the fitted colour over a pixel.
    pub(super) fn over_pixel(&self, pixel: [usize; 2]) -> [f64; 3] {
        self.value(&Waves::over_pixel(pixel, self.size))
    }

    /// The frequencies of the first band that the fit of a channel leaves out.
    pub(super) fn first_unfitted(&self, channel: usize) -> &[[usize; 2]] {
        let rest = &self.frequencies[self.coefficients[channel].len()..];
        let band = |[u, v]: [usize; 2]| u * self.size[1] + v * self.size[0];
        let same = rest.iter().take_while(|&&frequency| band(frequency) == band(rest[0])).count();
        &rest[..same]
    }

    /// The energy expected in a channel's first unfitted band, extrapolated by the inverse square of the frequency.
    pub(super) fn expected_energy(&self, channel: usize) -> f64 {
        let fitted = self.coefficients[channel].iter().zip(&self.frequencies).skip(1);
        let (sum, number) = fitted.fold((0.0, 0.0), |(sum, number), (coefficient, &frequency)| {
            (sum + coefficient * coefficient * squared(frequency, self.size), number + 1.0)
        });
        let slope = sum / f64::max(number, 1.0);
        self.first_unfitted(channel).iter().map(|&frequency| slope / squared(frequency, self.size)).sum()
    }
}

/// The squared frequency in half waves per eight pixels.
fn squared([u, v]: [usize; 2], [width, height]: [usize; 2]) -> f64 {
    let per_block = |k: usize, side: usize| f64::from(SIDE) * k as f64 / side as f64;
    per_block(u, width).powi(2) + per_block(v, height).powi(2)
}

/// Two sums over the samples: of products of cosines, and of each basis function times the samples' colours.
fn sums(block: &Cell, scale: CosineScale, fitted: &[[usize; 2]]) -> (Box<Products>, Vec<[f64; 3]>) {
    let highest = |axis: usize| fitted.iter().map(|f| 2 * f[axis]).max().unwrap_or(0);
    let (columns, rows) = (highest(0) + 1, highest(1) + 1);
    let mut products = Box::new(Products([[0.0; FREQUENCIES]; FREQUENCIES]));
    let mut sides = vec![[0.0; 3]; fitted.len()];
    for (at, &value) in block.at.iter().zip(&block.values) {
        let waves = Waves::at(at, block.size.map(|n| n as usize));
        for (row, y) in products.0.iter_mut().zip(&waves.0[1]).take(rows) {
            row.iter_mut().zip(&waves.0[0]).take(columns).for_each(|(sum, x)| *sum += x * y);
        }
        let colour = scale.opponent(value);
        for (side, &frequency) in sides.iter_mut().zip(fitted) {
            let wave = waves.of(frequency);
            (0..3).for_each(|c| side[c] += wave * colour[c]);
        }
    }
    (products, sides)
}

/// The Cholesky factor of a matrix: the rows of a lower triangle whose product with its transpose is the matrix. The upper left
/// part of the factor belongs to the upper left part of the matrix.
fn cholesky(order: usize, matrix: impl Fn(usize, usize) -> f64) -> Vec<Vec<f64>> {
    let mut rows: Vec<Vec<f64>> = Vec::with_capacity(order);
    for j in 0..order {
        let mut row = Vec::with_capacity(j + 1);
        for (k, before) in rows.iter().enumerate() {
            row.push((matrix(j, k) - dot(&row, before)) / before[k]);
        }
        // Rounding may cancel a diagonal entry that the penalty keeps above 0.
        let rest = (matrix(j, j) - dot(&row, &row)).max(LEAST * matrix(j, j));
        row.push(rest.sqrt());
        rows.push(row);
    }
    rows
}

/// The dot product of two vectors, over the length of the shorter.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The least fraction of a diagonal entry that remains.
const LEAST: f64 = 1e-14;

/// Solves the first `side.len()` equations whose matrix has this Cholesky factor.
fn solve(factor: &[Vec<f64>], mut side: Vec<f64>) -> Vec<f64> {
    for (j, row) in factor.iter().enumerate().take(side.len()) {
        side[j] = (side[j] - dot(&side[..j], row)) / row[j];
    }
    for j in (0..side.len()).rev() {
        let after: f64 = (j + 1..side.len()).map(|k| factor[k][j] * side[k]).sum();
        side[j] = (side[j] - after) / factor[j][j];
    }
    side
}

/// JPEG's quantisation steps of luminance [ITU-T T.81 1992, annex K], in rows of rising horizontal frequency.
const LUMINANCE: [[u8; 8]; 8] = [
    [16, 11, 10, 16, 24, 40, 51, 61],
    [12, 12, 14, 19, 26, 58, 60, 55],
    [14, 13, 16, 24, 40, 57, 69, 56],
    [14, 17, 22, 29, 51, 87, 80, 62],
    [18, 22, 37, 56, 68, 109, 103, 77],
    [24, 35, 55, 64, 81, 104, 113, 92],
    [49, 64, 78, 87, 103, 121, 120, 101],
    [72, 92, 95, 98, 112, 100, 103, 99],
];

/// JPEG's quantisation steps of chroma [ITU-T T.81 1992, annex K] at the four lowest frequencies along both axes.
const CHROMA: [[u8; 4]; 4] = [[17, 18, 24, 47], [18, 21, 26, 66], [24, 26, 56, 99], [47, 66, 99, 99]];
/// The quantisation step of chroma at all other frequencies.
const CHROMA_BEYOND: u8 = 99;

/// The quantisation step with a sensitivity of 1: the step of the mean luminance.
const UNIT: f64 = 16.0;

/// The sensitivity to a channel's error at a frequency in half waves per eight pixels: the reciprocal of JPEG's step.
fn sensitivity(channel: usize, [u, v]: [usize; 2]) -> f64 {
    let step = match channel {
        0 => LUMINANCE[v.min(7)][u.min(7)],
        _ => CHROMA.get(v).and_then(|row| row.get(u)).copied().unwrap_or(CHROMA_BEYOND),
    };
    UNIT / f64::from(step)
}

/// The weight of a channel's squared error, at the lowest frequencies that its fit leaves out. A fit with all frequencies uses
/// the highest frequency.
pub(super) fn weight(fit: &Fit, channel: usize) -> f64 {
    let unfitted = fit.first_unfitted(channel);
    let band = if unfitted.is_empty() { &fit.frequencies[fit.frequencies.len() - 1..] } else { unfitted };
    let per_block = |[u, v]: [usize; 2]| [u * SIDE as usize / fit.size[0], v * SIDE as usize / fit.size[1]];
    let squares = band.iter().map(|&frequency| sensitivity(channel, per_block(frequency)).powi(2));
    squares.sum::<f64>() / band.len() as f64
}

/// The weight of squared errors at a luminance, relative to the image's mean luminance: bright regions mask errors.
pub(super) fn masking(luminance: f64, mean: f64, exponent: f64) -> f64 {
    if mean > 0.0 { libm::pow((luminance / mean).max(DARKEST), -2.0 * exponent) } else { 1.0 }
}

/// The least luminance in the masking formula, relative to the image's mean.
const DARKEST: f64 = 0.01;
