//! Films from statistics of each pixel that another program gathered.

use super::{FeatureMoments, Film};
use crate::macros::setters;
use crate::{Error, FirstHit, Frame, Needs, RgbMoments, SurfaceFeatures};

/// The statistics of one pixel for [`Film::from_pixels`]: both halves of its samples, emission, features and first hit.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelStatistics {
    /// Count, mean and squared deviations of each half of the samples. Means may be negative.
    pub halves: [RgbMoments; 2],
    /// The mean emission of light sources seen directly.
    pub emission: [f32; 3],
    /// The mean features over the samples that hit a surface; `None` for a miss.
    pub features: Option<SurfaceFeatures>,
    /// Sample variances of normal (3), albedo (3), position (3) and depth (1).
    pub feature_variance: [f32; 10],
    /// The share of the samples that hit a surface, 0 to 1.
    pub coverage: f32,
    /// The first hit of the pixel's first sample, for filters that read clusters.
    pub first_hit: Option<FirstHit>,
}

impl PixelStatistics {
    /// Statistics of a pixel whose samples met no surface.
    pub fn new(halves: [RgbMoments; 2]) -> Self {
        Self { halves, ..Self::default() }
    }

    /// Sets the features, their sample variances, and the share of the samples that they are means over.
    #[must_use]
    pub fn with_features(self, mean: SurfaceFeatures, variance: [f32; 10], coverage: f32) -> Self {
        Self { features: Some(mean), feature_variance: variance, coverage, ..self }
    }

    setters! {
        /// Sets the mean emission of light sources seen directly.
        with_emission(emission: [f32; 3]);
    }

    /// Sets the first hit.
    #[must_use]
    pub fn with_first_hit(self, hit: FirstHit) -> Self {
        Self { first_hit: Some(hit), ..self }
    }

    fn is_finite(&self) -> bool {
        let moments = self.halves.iter().flat_map(|half| half.mean.into_iter().chain(half.m2));
        let emission = self.emission.into_iter().chain([self.coverage]).chain(self.feature_variance);
        moments.chain(emission.map(f64::from)).all(f64::is_finite)
            && self.features.is_none_or(|features| features.is_finite())
    }

    fn feature_moments(&self) -> FeatureMoments {
        let samples = self.halves.iter().map(|half| half.count).sum::<u64>().min(u64::from(u32::MAX)) as u32;
        let hits = (self.coverage.clamp(0.0, 1.0) * samples as f32).round() as u32;
        match self.features {
            Some(SurfaceFeatures { normal: n, albedo: a, position: p, depth, .. }) if hits > 0 => FeatureMoments {
                samples,
                hits: hits.min(samples),
                mean: [n[0], n[1], n[2], a[0], a[1], a[2], p[0], p[1], p[2], depth],
                m2: self.feature_variance.map(|v| v * (hits - 1) as f32),
                ..FeatureMoments::default()
            },
            _ => FeatureMoments { samples, ..FeatureMoments::default() },
        }
    }
}

impl Film {
    /// A film from statistics of each pixel that another program gathered, row by row from the top.
    ///
    /// The film records variance, halves, features, emission, and the first hit of one sample if any pixel has one. Filters
    /// read it as they read the film of a render. `dapple_denoise::denoise` makes such films from image buffers.
    ///
    /// ```
    /// use dapple_core::{Film, Frame, PixelStatistics, RgbMoments};
    ///
    /// // Two halves of 4 samples each; the sample variance is 0.01.
    /// let half = |value| RgbMoments::new(4, [value; 3], [0.01; 3]);
    /// let film = Film::from_pixels(Frame::new(2, 1)?, |_| PixelStatistics::new([half(0.5), half(1.5)]))?;
    /// assert_eq!((film.mean(0), film.count(1)), ([1.0; 3], 8));
    /// # Ok::<(), dapple_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`Error::BadBuffer`] for a pixel with a NaN or an infinity.
    pub fn from_pixels(frame: Frame, of: impl Fn(usize) -> PixelStatistics) -> Result<Self, Error> {
        let needs = Needs::none().with_variance().with_halves().with_features().with_emission();
        let mut film = Self::new(frame, needs);
        for i in 0..frame.pixels() {
            let pixel = of(i);
            if !pixel.is_finite() {
                let [x, y] = frame.pixel(i);
                let what = format!("pixel ({x}, {y}) has a NaN or an infinity; give finite numbers, or a count of 0");
                return Err(Error::BadBuffer { buffer: "pixels", what });
            }
            for (bank, half) in film.kept.iter_mut().zip(pixel.halves) {
                (bank.counts[i], bank.means[i], bank.m2[i]) = (half.count, half.mean, half.m2);
                if half.count > 0 {
                    let seen = |c: usize| pixel.emission[c].min(half.mean[c] as f32).max(0.0);
                    bank.emission[i] = [seen(0), seen(1), seen(2)];
                }
                film.record.samples += half.count;
            }
            film.beside.features[i] = pixel.feature_moments();
            if pixel.first_hit.is_some() && film.beside.first_hits.is_empty() {
                film.needs = film.needs.with_first_hits(1);
                film.beside.first_hits = vec![None; frame.pixels()];
            }
            if let Some(hit) = film.beside.first_hits.get_mut(i) {
                *hit = pixel.first_hit.filter(FirstHit::is_finite);
            }
        }
        Ok(film)
    }
}
