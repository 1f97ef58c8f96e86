//! Pixel means with emission refined by feature-only samples, and error estimates from the two halves.

use super::Film;
use crate::film::RgbMoments;

/// Refined means.
///
/// At the edge of a light source, most noise comes from the fraction of the pixel that the light covers. A feature-only
/// sample ([`features_alone`](crate::Integrator::features_alone)) measures the emission for the cost of a ray. Refined
/// means therefore average the emission over feature-only and ordinary samples. The expected value does not change, since
/// feature-only samples do not depend on ordinary ones.
///
/// In all other pixels, and in films without [`Needs::emission`](crate::Needs::emission), refined means equal plain means.
impl Film {
    /// The number and the mean emission of pixel `i`'s [feature-only samples](crate::Integrator::features_alone): of half 0
    /// or 1, or of all in a film without halves. `None` without feature-only samples that measure emission.
    pub fn emission_alone(&self, half: usize, i: usize) -> Option<(u32, [f32; 3])> {
        if !self.needs.emission {
            return None;
        }
        let alone = self.lamp_edges.get(&self.frame, i)?;
        let found = if self.needs.halves { (alone.samples[half & 1], alone.mean[half & 1]) } else { alone.whole() };
        (found.0 > 0).then_some(found)
    }

    /// The refined minus the plain mean emission of pixel `i`, in one half or in a film without halves.
    fn refinement(&self, half: usize, i: usize) -> Option<[f64; 3]> {
        let (samples, alone) = self.emission_alone(half, i)?;
        let (plain, count) = (self.emission(half, i)?, self.kept[half % self.kept.len()].counts[i]);
        let share = f64::from(samples) / (f64::from(samples) + f64::from(count));
        (count > 0).then(|| [0, 1, 2].map(|c| share * (f64::from(alone[c]) - f64::from(plain[c]))))
    }

    /// The mean emission over ordinary and feature-only samples of pixel `i`: of half 0 or 1, or of all samples in a film
    /// without halves. `None` if the film lacks [`Needs::emission`](crate::Needs::emission).
    pub fn refined_emission(&self, half: usize, i: usize) -> Option<[f32; 3]> {
        let plain = self.emission(half, i)?;
        let Some(change) = self.refinement(half, i) else { return Some(plain) };
        Some([0, 1, 2].map(|c| (f64::from(plain[c]) + change[c]).max(0.0) as f32))
    }

    /// Equals [`Film::half`], except that the mean contains [`Film::refined_emission`] in place of [`Film::emission`].
    pub fn refined_half(&self, half: usize, i: usize) -> Option<RgbMoments> {
        let mut moments = self.half(half, i)?;
        if let Some(change) = self.refinement(half, i) {
            moments.mean = changed(moments.mean, change);
        }
        Some(moments)
    }

    /// Equals [`Film::mean`], except that it contains [`Film::refined_emission`] in place of [`Film::emission`].
    pub fn refined_mean(&self, i: usize) -> [f64; 3] {
        let first = if self.kept.len() == 2 { self.first_half_weight(i) } else { 1.0 };
        let halves = [first, 1.0 - first].into_iter().take(self.kept.len()).enumerate();
        halves.fold(self.mean(i), |mean, (half, weight)| match self.refinement(half, i) {
            Some(change) => changed(mean, change.map(|change| weight * change)),
            None => mean,
        })
    }
}

/// The sum of `mean` and `change`, at least 0 in spite of rounding.
fn changed(mean: [f64; 3], change: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|c| (mean[c] + change[c]).max(0.0))
}

impl Film {
    /// The estimated squared error of pixel `i`'s mean, per channel. `None` in a film without halves, and for a pixel
    /// without samples in one of the two halves.
    ///
    /// The halves are scrambled independently, so their means A and B satisfy `E (A - B)^2 = var A + var B`. The variances are
    /// taken as inversely proportional to sample counts. The pixel's mean `w A + (1 - w) B` has the squared error `w^2 var A +
    /// (1 - w)^2 var B`. The estimate has one degree of freedom: average it over pixels. The error of splats is not included.
    pub fn squared_error(&self, i: usize) -> Option<[f64; 3]> {
        let [a, b] = &self.kept[..] else { return None };
        let (na, nb) = (f64::from(a.counts[i]), f64::from(b.counts[i]));
        if na == 0.0 || nb == 0.0 {
            return None;
        }
        let w = self.first_half_weight(i);
        let share = w * w * (nb / (na + nb)) + (1.0 - w) * (1.0 - w) * (na / (na + nb));
        let mut error = [0.0; 3];
        for (c, e) in error.iter_mut().enumerate() {
            let d = a.means[i][c] - b.means[i][c];
            *e = d * d * share;
        }
        Some(error)
    }

    /// The estimated squared error of every pixel's mean, averaged over the channels ([`Film::squared_error`]). Infinite
    /// for a pixel without samples in one of the two halves. `None` in a film without halves.
    pub fn squared_errors(&self) -> Option<Vec<f32>> {
        if self.kept.len() != 2 {
            return None;
        }
        let mean = |e: [f64; 3]| ((e[0] + e[1] + e[2]) / 3.0).min(f64::from(f32::MAX)) as f32;
        Some((0..self.frame.pixels()).map(|i| self.squared_error(i).map_or(f32::INFINITY, mean)).collect())
    }

    /// The relMSE of the unfiltered image, `mean((x - truth)^2 / (truth^2 + 0.01))` over pixels and channels, estimated
    /// from the halves. `None` in a film without halves, or if a pixel has no samples in one half.
    ///
    /// In the denominator, the mean over 3x3 pixels replaces the truth. The large mean of a firefly would hide its error.
    ///
    /// # Precision
    ///
    /// On the bundled scenes with 8 and more samples per pixel, the estimate is 0.65 to 1.05 times the true relMSE. With
    /// the pixel's own mean it would be 0.07 to 1.11 times (`examples/predicted_error.rs`).
    pub fn predicted_relmse(&self) -> Option<f64> {
        if self.kept.len() != 2 {
            return None;
        }
        let [width, height] = self.frame.size().map(|n| n as usize);
        // Three rows of means at a time: an image of them would take as much memory as a film.
        let mut means = vec![[0.0; 3]; 3 * width];
        let fill = |y: usize, means: &mut [[f64; 3]]| {
            let row = &mut means[y % 3 * width..][..width];
            row.iter_mut().enumerate().for_each(|(x, mean)| *mean = self.mean(y * width + x));
        };
        fill(0, &mut means);
        let mut sum = 0.0;
        for y in 0..height {
            if y + 1 < height {
                fill(y + 1, &mut means);
            }
            for x in 0..width {
                let error = self.squared_error(y * width + x)?;
                let (rows, columns) =
                    (y.saturating_sub(1)..(y + 2).min(height), x.saturating_sub(1)..(x + 2).min(width));
                let count = (rows.len() * columns.len()) as f64;
                let mut level = [0.0; 3];
                for row in rows {
                    for mean in &means[row % 3 * width..][columns.clone()] {
                        (0..3).for_each(|c| level[c] += mean[c] / count);
                    }
                }
                sum += (0..3).map(|c| error[c] / (level[c] * level[c] + 0.01)).sum::<f64>();
            }
        }
        Some(sum / (3 * width * height) as f64)
    }
}
