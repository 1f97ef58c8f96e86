//! Wavelet transforms of images by lifting, the variances of the coefficients, and the filter that shrinks the coefficients.

use crate::method::{FilterMethod, MethodFilter};
use crate::windows::filled_means;
use dapple_core::{Error, Film, Filtered, Needs, parallel};

/// A biorthogonal wavelet basis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Basis {
    /// The 9/7 filters of Cohen, Daubechies and Feauveau.
    Cdf97,
    /// The 5/3 filters of Cohen, Daubechies and Feauveau.
    Cdf53,
    /// Means and differences of pairs.
    Haar,
}

dapple_core::choices!(Basis { Cdf97 = "cdf97", Cdf53 = "cdf53", Haar = "haar" });

/// Lifting steps of the 9/7 filters [Daubechies and Sweldens 1998].
const CDF97: [f64; 4] = [-1.586_134_342_059_924, -0.052_980_118_572_961, 0.882_911_075_530_934, 0.443_506_852_043_971];
/// Lifting steps of the 5/3 filters.
const CDF53: [f64; 2] = [-0.5, 0.25];

impl Basis {
    /// The lifting steps: odd samples change by their even neighbours, then even samples by their odd neighbours, and so on.
    fn steps(self) -> &'static [f64] {
        match self {
            Self::Cdf97 => &CDF97,
            Self::Cdf53 => &CDF53,
            Self::Haar => &[],
        }
    }

    /// The factors by which lifting scales the mean in the low band, and the highest frequency in the high band.
    fn gains(self) -> [f64; 2] {
        let (mut constant, mut alternating) = ([1.0, 1.0], [1.0, -1.0]);
        for (k, step) in self.steps().iter().enumerate() {
            for pair in [&mut constant, &mut alternating] {
                pair[1 - k % 2] += 2.0 * step * pair[k % 2];
            }
        }
        [constant[0], alternating[1]]
    }

    /// Transforms a line in place into the low band followed by the high band, or inverts the transform if `back`. The low band
    /// of a constant is that constant.
    fn transform<const N: usize>(self, back: bool, line: &mut [[f64; N]], scratch: &mut Vec<[f64; N]>) {
        if line.len() < 2 {
            return;
        }
        let evens = line.len().div_ceil(2);
        if !back {
            scratch.clear();
            scratch.extend(line.iter().step_by(2).chain(line.iter().skip(1).step_by(2)));
            line.copy_from_slice(scratch);
        }
        let (low, high) = line.split_at_mut(evens);
        let (steps, [of_low, of_high]) = (self.steps().iter().enumerate(), self.gains());
        match (self, back) {
            (Self::Haar, _) => {
                for (a, b) in low.as_flattened_mut().iter_mut().zip(high.as_flattened_mut()) {
                    (*a, *b) = if back { (*a - *b, *a + *b) } else { (0.5 * (*a + *b), 0.5 * (*b - *a)) };
                }
            }
            (_, false) => {
                steps.for_each(|(k, step)| lift(low, high, k, *step));
                scale(low, 1.0 / of_low);
                scale(high, 1.0 / of_high);
            }
            (_, true) => {
                scale(low, of_low);
                scale(high, of_high);
                steps.rev().for_each(|(k, step)| lift(low, high, k, -step));
            }
        }
        if back {
            scratch.clear();
            scratch.extend((0..line.len()).map(|i| if i % 2 == 0 { line[i / 2] } else { line[evens + i / 2] }));
            line.copy_from_slice(scratch);
        }
    }

    /// The low-band and high-band filters of one level, as weights at integer offsets from the even sample.
    fn filters(self) -> [Taps; 2] {
        const LENGTH: usize = 32;
        let mut scratch = Vec::new();
        let mut filters = [0, 1].map(|_| Taps { first: -(LENGTH as i64 / 2), weights: vec![0.0; LENGTH] });
        for at in 0..LENGTH {
            let mut line = [[0.0]; LENGTH];
            line[at] = [1.0];
            self.transform(false, &mut line, &mut scratch);
            // The coefficients at the even sample in the middle.
            filters[0].weights[at] = line[LENGTH / 4][0];
            filters[1].weights[at] = line[LENGTH / 2 + LENGTH / 4][0];
        }
        filters.map(Taps::trimmed)
    }

    /// The filters from pixels to the coefficients of level 1, 2 and so on: low band and high band.
    pub(crate) fn cascade(self, levels: usize) -> Vec<[Taps; 2]> {
        let [low, high] = self.filters();
        let mut finer = Taps { first: 0, weights: vec![1.0] };
        let cascade = |level: usize| {
            let both = [&low, &high].map(|taps| finer.then(taps, 1 << level));
            finer = both[0].clone();
            both
        };
        (0..levels).map(cascade).collect()
    }
}

/// Adds `step` times the sum of both neighbours to each odd sample if `k` is even, or to each even sample if `k` is odd. The
/// line is mirrored at its ends.
fn lift<const N: usize>(low: &mut [[f64; N]], high: &mut [[f64; N]], k: usize, step: f64) {
    let (evens, odds) = (low.len(), high.len());
    if k.is_multiple_of(2) {
        for (i, odd) in high.iter_mut().enumerate() {
            let (left, right) = (low[i], low[(i + 1).min(evens - 1)]);
            (0..N).for_each(|c| odd[c] += step * (left[c] + right[c]));
        }
    } else {
        for (i, even) in low.iter_mut().enumerate() {
            let (left, right) = (high[i.saturating_sub(1)], high[i.min(odds - 1)]);
            (0..N).for_each(|c| even[c] += step * (left[c] + right[c]));
        }
    }
}

fn scale<const N: usize>(line: &mut [[f64; N]], factor: f64) {
    line.iter_mut().flatten().for_each(|value| *value *= factor);
}

/// A filter: weights at the offsets `first`, `first + 1` and so on.
#[derive(Clone, Debug)]
pub(crate) struct Taps {
    pub(crate) first: i64,
    pub(crate) weights: Vec<f64>,
}

impl Taps {
    /// The filter without the zeros at its ends.
    fn trimmed(mut self) -> Self {
        let is_zero = |w: &f64| w.abs() < 1e-15;
        let zeros = self.weights.iter().take_while(|w| is_zero(w)).count();
        self.weights.drain(..zeros);
        self.first += zeros as i64;
        while self.weights.last().is_some_and(is_zero) {
            self.weights.pop();
        }
        self
    }

    /// The composition of `self`, applied at every `spacing`-th sample, and `next`.
    fn then(&self, next: &Self, spacing: usize) -> Self {
        let mut weights = vec![0.0; (next.weights.len() - 1) * spacing + self.weights.len()];
        for (k, outer) in next.weights.iter().enumerate() {
            let to = &mut weights[k * spacing..];
            to.iter_mut().zip(&self.weights).for_each(|(sum, inner)| *sum += outer * inner);
        }
        Self { first: self.first + next.first * spacing as i64, weights }
    }

    /// Applies the squared filter to the row `values` at every `spacing`-th position.
    fn squared_sums(&self, values: &[f64], spacing: usize, sums: &mut [f64]) {
        for (j, sum) in sums.iter_mut().enumerate() {
            let from = (j * spacing) as i64 + self.first;
            let inside = from >= 0 && from + self.weights.len() as i64 <= values.len() as i64;
            *sum = if inside {
                self.weights.iter().zip(&values[from as usize..]).map(|(w, v)| w * w * v).sum()
            } else {
                let at = |k: usize| values[mirrored(from + k as i64, values.len())];
                self.weights.iter().enumerate().map(|(k, w)| w * w * at(k)).sum()
            };
        }
    }
}

/// The index in a line that is mirrored at its ends; the end samples are not repeated.
pub(crate) fn mirrored(at: i64, length: usize) -> usize {
    let period = 2 * (length as i64 - 1).max(1);
    let at = at.rem_euclid(period);
    (if at < length as i64 { at } else { period - at }).min(length as i64 - 1) as usize
}

/// The size of the low band after each level, starting with the image itself. Each level halves the size, rounded up.
pub(crate) fn sizes(size: [usize; 2], levels: usize) -> Vec<[usize; 2]> {
    (0..=levels).map(|level| size.map(|n| n.div_ceil(1 << level))).collect()
}

/// Transforms an image in place through the levels `levels`, counted from 0, or inverts them if `back`. The low band of each
/// level is the upper left corner of the next finer low band.
pub(crate) fn transform<const N: usize>(
    basis: Basis,
    size: [usize; 2],
    levels: std::ops::Range<usize>,
    back: bool,
    image: &mut Vec<[f64; N]>,
) {
    for level in levels.clone() {
        let level = if back { levels.start + levels.end - 1 - level } else { level };
        along_both(size, sizes(size, level)[level], image, |line, scratch| basis.transform(back, line, scratch));
    }
}

/// Applies `change` along both axes to the lines of the upper left corner of size `region`.
fn along_both<const N: usize>(
    [width, height]: [usize; 2],
    region: [usize; 2],
    image: &mut Vec<[f64; N]>,
    change: impl Fn(&mut [[f64; N]], &mut Vec<[f64; N]>) + Sync,
) {
    for ([width, height], [columns, rows]) in [([width, height], region), ([height, width], [region[1], region[0]])] {
        parallel::chunks(&mut image[..rows * width], width, |_, row| change(&mut row[..columns], &mut Vec::new()));
        *image = transposed([width, height], image);
    }
}

fn transposed<T: Copy + Send + Sync>([width, height]: [usize; 2], values: &[T]) -> Vec<T> {
    let mut all = values.to_vec();
    parallel::chunks(&mut all, height, |x, column| {
        column.iter_mut().enumerate().for_each(|(y, value)| *value = values[y * width + x]);
    });
    all
}

/// The variances of the coefficients of a level, row by row over its low band: the low band and the three high bands (high in
/// x, high in y, high in both). Pixels have these `variances` and are independent.
pub(crate) fn coefficient_variances(
    [low, high]: &[Taps; 2],
    level: usize,
    [width, height]: [usize; 2],
    variances: &[f64],
) -> [Vec<f64>; 4] {
    let [columns, rows] = [width, height].map(|n| n.div_ceil(1 << level));
    let along = |taps: &Taps, [width, out]: [usize; 2], values: &[f64]| -> Vec<f64> {
        let mut sums = vec![0.0; values.len() / width * out];
        parallel::chunks(&mut sums, out, |y, sums| taps.squared_sums(&values[y * width..][..width], 1 << level, sums));
        sums
    };
    let [across_low, across_high] =
        [low, high].map(|taps| transposed([columns, height], &along(taps, [width, columns], variances)));
    let down = |taps: &Taps, values: &[f64]| transposed([rows, columns], &along(taps, [height, rows], values));
    [down(low, &across_low), down(low, &across_high), down(high, &across_low), down(high, &across_high)]
}

/// The columns and rows of one of a level's three high bands: high in x, high in y, high in both. Bands may be a row or a
/// column shorter than the low band.
pub(crate) fn high_band(size: [usize; 2], level: usize, band: usize) -> [std::ops::Range<usize>; 2] {
    let sizes = sizes(size, level);
    let (fine, coarse) = (sizes[level - 1], sizes[level]);
    let is_high = [band != 1, band != 0];
    [0, 1].map(|axis| if is_high[axis] { coarse[axis]..fine[axis] } else { 0..coarse[axis] })
}

dapple_core::options! {
    /// The parameters of [`Wavelet`].
    pub struct WaveletOptions {
        /// Wavelets: cdf97 or cdf53 (smooth, by Cohen, Daubechies and Feauveau), or haar (blocks).
        pub basis: Basis = Basis::Cdf97 => "cdf97";
        /// Number of wavelet levels.
        pub levels: usize = 5, |levels| (1..=10).contains(&levels), "1 to 10";
        /// Coefficients shrink by this many standard errors; 0 leaves the image unchanged.
        pub gamma: f64 = 1.0 => "1", |gamma| (0.0..=100.0).contains(&gamma), "0 to 100 standard errors";
    }
}

/// Wavelet shrinkage, the reconstruction of adaptive wavelet rendering [after Overbeck, Donner and Ramamoorthi 2009].
///
/// The image of pixel means is transformed. Each wavelet coefficient `w` becomes `sign(w) max(0, |w| - gamma SE)`, and the
/// image is transformed back. `SE` is the coefficient's standard error, `sqrt(sum f^2 v)` for filter taps `f` and the variances
/// `v` of the pixel means. Pixels without samples are filled from their neighbours first.
///
/// The paper shrinks by one standard error. The basis, the levels and the use of sample variances are not in the paper.
///
/// *Error*: not estimated. *Bias*: coefficients are shrunk even if they are detail, and shrinkage depends on the samples.
/// Radiance below 0 becomes 0. *Weaknesses*: ringing and blotches at few samples; low-contrast texture vanishes; fireflies
/// leave smeared traces. The filter uses no features.
pub type Wavelet = MethodFilter<WaveletOptions>;

impl WaveletOptions {
    /// Shrinks the coefficients of an image whose pixels have the given variances.
    fn shrink(&self, size: [usize; 2], image: &mut Vec<[f64; 3]>, variances: &[f64]) {
        let Self { basis, levels, gamma } = *self;
        transform(basis, size, 0..levels, false, image);
        for (below, filters) in basis.cascade(levels).iter().enumerate() {
            let level = below + 1;
            let columns = size[0].div_ceil(1 << level);
            let [_, bands @ ..] = coefficient_variances(filters, level, size, variances);
            for (band, variances) in bands.iter().enumerate() {
                let [xs, ys] = high_band(size, level, band);
                let rows = &mut image[ys.start * size[0]..ys.end * size[0]];
                parallel::chunks(rows, size[0], |y, row| {
                    for (colour, variance) in row[xs.clone()].iter_mut().zip(&variances[y * columns..]) {
                        let threshold = gamma * variance.sqrt();
                        *colour = colour.map(|w| (w.abs() - threshold).max(0.0).copysign(w));
                    }
                });
            }
        }
        transform(basis, size, 0..levels, true, image);
    }
}

impl FilterMethod for WaveletOptions {
    const NAME: &'static str = "wavelet";
    // The image and its transposed copy, variances, and half of three planes along an axis with their copies.
    const BYTES: usize = 2 * 24 + 8 + 4 * 8 + 12;

    fn needs(&self) -> Needs {
        Needs::none().with_variance()
    }

    fn image(&self, film: &Film, (): &()) -> Result<Filtered, Error> {
        let size = film.frame().size();
        let (mut image, variances) = filled_means(film);
        self.shrink(size.map(|n| n as usize), &mut image, &variances);
        Ok(Filtered::new(size, image.into_iter().map(|colour| colour.map(|x| x.max(0.0) as f32)).collect()))
    }
}
