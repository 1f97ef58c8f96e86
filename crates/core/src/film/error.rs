//! Error estimates from the halves of a film.

use super::Film;

impl Film {
    /// The estimated squared error of pixel `i`'s mean, per channel. `None` in a film without halves, or if a half of
    /// the pixel has no samples.
    ///
    /// The estimate comes from the difference of the means A and B of the two halves, which are scrambled
    /// independently: `E (A - B)^2 = var A + var B`. That sum is split by sample counts, for a pixel mean of `w A + (1
    /// - w) B`. Each pixel has one degree of freedom, so average over pixels before use. The error of splats is not in it.
    pub fn squared_error(&self, i: usize) -> Option<[f64; 3]> {
        let [a, b] = &self.kept[..] else { return None };
        let (na, nb) = (a.counts[i] as f64, b.counts[i] as f64);
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

    /// The estimated squared error of every pixel's mean, averaged over the channels ([`Film::squared_error`]).
    /// Infinite if a half of the pixel has no samples. `None` in a film without halves.
    pub fn squared_errors(&self) -> Option<Vec<f32>> {
        if self.kept.len() != 2 {
            return None;
        }
        let mean = |e: [f64; 3]| ((e[0] + e[1] + e[2]) / 3.0) as f32;
        Some((0..self.frame.pixels()).map(|i| self.squared_error(i).map_or(f32::INFINITY, mean)).collect())
    }

    /// The relMSE of the unfiltered image, `mean((x - truth)^2 / (truth^2 + 0.01))` over pixels and channels, as
    /// estimated from the halves. `None` without halves, and while a pixel lacks a sample in one of them.
    ///
    /// The mean over 3x3 pixels stands in for the truth. A pixel's own mean is high where its error is, and would hide
    /// the error.
    ///
    /// # Precision
    ///
    /// On the bundled scenes with 8 and more samples per pixel, the estimate is 0.65 to 1.05 of the true relMSE. With
    /// the pixel's own mean it would be 0.07 to 1.11 (`examples/predicted_error.rs`).
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
