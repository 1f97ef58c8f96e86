//! Light that filters do not get: bright emission seen directly, and all beyond the range of their planes. It stays in its
//! own pixel. Noise that is bright in one half is spread instead ([`outliers`](crate::outliers)).
//!
//! A lamp may have 10^5 times the radiance of the wall beside it. Hardly any weight is small enough to keep it there.
//! Within a pixel its emission is almost free of noise. So filters get images without most of it.

use crate::light::Light;
use dapple_core::{Filtered, RgbMoments};
use rayon::prelude::*;

/// The largest radiance in units of the image's level (its mean brightness). Its fourth power fits `f32`.
pub(crate) const BRIGHTEST: f32 = 1e9;

/// The bound of emission in units of the image's level, for one sample per pixel and a brightest emission of one level.
const EMISSION: f64 = 3e6;

/// The least bound of emission, in units of the image's level. Most displays show that as white.
const LEAST: f64 = 30.0;

/// The largest light that filters get from a pixel, in radiance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    /// The bound of the emission seen directly.
    emission: f64,
    /// That bound for filters that read no halves; 0 below two samples per pixel.
    blurred: f64,
    /// The bound of all other light.
    other: f64,
}

impl Bounds {
    /// The bounds for a film whose image has this `level` (its mean brightness).
    ///
    /// The emission of a pixel that a lamp covers partly is noisy, and filters remove that noise. With all emission
    /// withheld, blurred lamps of a thin lens have three times the error at 8 samples per pixel. Leaks of brighter lamps
    /// are worse, and more samples leave less noise. So the bound falls with the largest emission and with the number
    /// of samples. On nine scenes, at 8 to 32 samples, it never costs more than noise, and takes up to 16 % off.
    pub(crate) fn new(light: Light<'_>, level: f32) -> Self {
        let (level, pixels) = (f64::from(level), light.film.frame().pixels());
        let samples = (0..pixels).map(|i| light.film.count(i)).sum::<u64>() as f64 / pixels as f64;
        let emission = |i| [0, 1].into_iter().filter_map(move |half| light.emission(half, i)).flatten();
        let brightest = f64::from((0..pixels).flat_map(emission).fold(0.0, f32::max)) / level;
        let bound = (EMISSION / (samples * brightest).max(1e-3)).clamp(LEAST, f64::from(BRIGHTEST)) * level;
        let blurred = if samples < 2.0 { 0.0 } else { bound };
        Self { emission: bound, blurred, other: f64::from(BRIGHTEST) * level }
    }

    /// The largest emission that filters get from a pixel, in radiance.
    pub(crate) fn emission(self) -> f32 {
        self.emission as f32
    }

    /// The light that is withheld from the mean of pixel `i`, for filters that read no halves: emission alone. Below two samples
    /// per pixel that is all emission: these filters would spread it as far as any other light.
    pub(crate) fn withheld_emission(self, light: Light<'_>, i: usize) -> [f64; 3] {
        let mean = light.mean(i);
        let emission = light.mean_emission(i);
        std::array::from_fn(|c| (f64::from(emission[c]) - self.blurred).clamp(0.0, mean[c].max(0.0)))
    }

    /// The light that is withheld from a mean colour of which `emission` is seen directly.
    fn withheld(self, mean: [f64; 3], emission: [f32; 3]) -> [f64; 3] {
        if emission.iter().all(|e| f64::from(*e) <= self.emission) && mean.iter().all(|m| *m <= self.other) {
            return [0.0; 3];
        }
        std::array::from_fn(|c| {
            // The mean of a half of split noise may be negative.
            let emission = (f64::from(emission[c]) - self.emission).clamp(0.0, mean[c].max(0.0));
            emission + (mean[c] - emission - self.other).max(0.0)
        })
    }

    /// The light that is withheld from each half of the samples of pixel `i`, from the halves' moments. A half without
    /// samples has the film's mean.
    pub(crate) fn withheld_of_halves(self, light: Light<'_>, i: usize, halves: &[RgbMoments; 2]) -> [[f64; 3]; 2] {
        let emission = [0, 1].map(|half| light.emission(half, i).unwrap_or_default());
        [0, 1].map(|h| match halves[h].count {
            0 => self.withheld(light.mean(i), emission[1 - h]),
            _ => self.withheld(halves[h].mean, emission[h]),
        })
    }

    /// Adds the withheld light of both halves to a filtered image, and its variance to the image's error.
    pub(crate) fn restore(self, light: Light<'_>, filtered: Filtered) -> Filtered {
        let Filtered { size, mut radiance, mut error, .. } = filtered;
        let add = |(i, colour): (usize, &mut [f32; 3])| -> f32 {
            let halves = [0, 1].map(|half| light.half(half, i));
            let [a, b] = self.withheld_of_halves(light, i, &halves);
            if [a, b] == [[0.0; 3]; 2] {
                return 0.0;
            }
            let [na, nb] = halves.map(|half| half.count as f64);
            let share = if na + nb > 0.0 { na / (na + nb) } else { 0.5 };
            let apart: [f64; 3] = std::array::from_fn(|c| a[c] - b[c]);
            *colour = std::array::from_fn(|c| finite(f64::from(colour[c]) + b[c] + share * apart[c]));
            finite(share * (1.0 - share) * apart.iter().map(|d| d * d).sum::<f64>() / 3.0)
        };
        let more: Vec<f32> = radiance.par_iter_mut().enumerate().with_min_len(1024).map(add).collect();
        for (error, more) in error.iter_mut().flatten().zip(more).filter(|(error, _)| error.is_finite()) {
            *error = finite(f64::from(*error) + f64::from(more));
        }
        Filtered::new(size, radiance).with_error(error)
    }
}

/// The nearest `f32` that is not infinite.
fn finite(value: f64) -> f32 {
    value.min(f64::from(f32::MAX)) as f32
}
