//! The light of a film that a filter reads: all of it, or the direct or the indirect part.

use dapple_core::{Film, RgbMoments};

/// The parts of the light that [`ClusterRegression`](crate::ClusterRegression) filters one by one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Layers {
    /// Two from 16 samples per pixel on, else one: the second takes as much time as some samples per pixel.
    #[default]
    Auto,
    /// All light at once.
    One,
    /// Direct and indirect light ([`Estimate::indirect`](dapple_core::Estimate::indirect)), where the film records both.
    Two,
}

dapple_core::choices!(Layers { Auto = "auto", One = "1", Two = "2" });

impl Layers {
    /// Returns `true` if direct and indirect light are filtered one by one at this number of samples per pixel.
    pub(crate) fn are_two(self, spp: f64) -> bool {
        match self {
            Self::Auto => spp >= 16.0,
            Self::One => false,
            Self::Two => true,
        }
    }
}

/// The parts of a film's light that are filtered one by one.
pub(crate) fn parts(film: &Film, layers: Layers) -> Vec<Light<'_>> {
    let all = vec![Light::all(film)];
    if layers == Layers::One || !film.needs().indirect {
        return all;
    }
    let (pixels, parts) = (film.frame().pixels(), Light::parts(film));
    let samples: u64 = (0..pixels).map(|i| film.count(i)).sum();
    // Without indirect light, its image is known to be black.
    let is_lit = || (0..pixels).flat_map(|i| parts[1].mean(i)).any(|value| value as f32 > 0.0);
    if layers.are_two(samples as f64 / pixels as f64) && is_lit() { parts.to_vec() } else { all }
}

/// A film, and the part of its light that is filtered.
#[derive(Clone, Copy)]
pub(crate) struct Light<'a> {
    pub(crate) film: &'a Film,
    part: Part,
}

#[derive(Clone, Copy)]
enum Part {
    All,
    /// All light but the indirect one.
    Direct,
    Indirect,
}

impl<'a> Light<'a> {
    pub(crate) fn all(film: &'a Film) -> Self {
        Self { film, part: Part::All }
    }

    /// The direct and the indirect light of a film that records halves and indirect light.
    pub(crate) fn parts(film: &'a Film) -> [Self; 2] {
        [Part::Direct, Part::Indirect].map(|part| Self { film, part })
    }

    /// The mean radiance of pixel `i`.
    pub(crate) fn mean(&self, i: usize) -> [f64; 3] {
        match self.part {
            Part::All => self.film.refined_mean(i),
            Part::Direct => difference(self.film.refined_mean(i), self.indirect(i).mean),
            Part::Indirect => self.indirect(i).mean,
        }
    }

    /// Count, mean and squared deviations of half 0 or 1 of pixel `i`'s samples; of the direct light without deviations.
    pub(crate) fn half(&self, half: usize, i: usize) -> RgbMoments {
        let refined = || self.film.refined_half(half, i).unwrap_or_default();
        let indirect = || self.film.indirect(half, i).unwrap_or_default();
        match self.part {
            Part::All => refined(),
            Part::Direct => {
                let mut moments = refined();
                (moments.mean, moments.m2) = (difference(moments.mean, indirect().mean), [f64::NAN; 3]);
                moments
            }
            Part::Indirect => indirect(),
        }
    }

    /// The variance of one sample of pixel `i`; `None` below two samples.
    ///
    /// That of direct light is the difference of the variances of all and of indirect light. The covariance of both parts,
    /// which is positive where an edge crosses the pixel, counts as direct light's.
    pub(crate) fn variance(&self, i: usize) -> Option<[f64; 3]> {
        match self.part {
            Part::All => self.film.moments(i).variance(),
            Part::Direct => Some(difference(self.film.moments(i).variance()?, self.indirect(i).variance()?)),
            Part::Indirect => self.indirect(i).variance(),
        }
    }

    /// The ratio of the variance of the mean to that of the plain mean, if samples of features alone refine the emission of pixel
    /// `i`. The emission's part of the variance counts as its part of the mean: at the edge of a lamp, both are near 1.
    pub(crate) fn variance_left(&self, i: usize) -> Option<[f32; 3]> {
        if matches!(self.part, Part::Indirect) {
            return None;
        }
        let alone = |half: usize| self.film.emission_alone(half, i).map(|(samples, _)| f64::from(samples));
        let samples = alone(0)? + alone(1).unwrap_or_default();
        let (mean, count) = (self.mean(i), self.film.count(i) as f64);
        let [a, b] = [0, 1].map(|half| self.emission(half, i).unwrap_or_default());
        let less = samples / (count + samples);
        Some(std::array::from_fn(|c| {
            let share = 0.5 * f64::from(a[c] + b[c]) / mean[c].max(f64::MIN_POSITIVE);
            (1.0 - share.min(1.0) * less) as f32
        }))
    }

    /// The factor on the bandwidths within which pixels count as alike. Indirect light has few edges, and much of its noise is
    /// taken for edges by the bandwidths of all light.
    pub(crate) fn smoothness(&self) -> f32 {
        match self.part {
            Part::All | Part::Direct => 1.0,
            Part::Indirect => 1.4,
        }
    }

    /// Returns true if a regression with a guide for each half comes before the wider ones, so that no half's noise shapes its
    /// own windows. Only direct light that is filtered apart gains enough by it.
    pub(crate) fn has_first_pass(&self) -> bool {
        matches!(self.part, Part::Direct)
    }

    /// The mean emission of light sources that half 0 or 1 of pixel `i`'s samples saw directly.
    pub(crate) fn emission(&self, half: usize, i: usize) -> Option<[f32; 3]> {
        match self.part {
            Part::All | Part::Direct => self.film.refined_emission(half, i),
            Part::Indirect => None,
        }
    }

    /// Returns `true` if samples of features alone have met the edge of a lamp in pixel `i`.
    pub(crate) fn is_edge_of_lamp(&self, i: usize) -> bool {
        self.film.emission_alone(0, i).is_some()
    }

    /// The mean emission that all samples of pixel `i` saw directly; 0 if it is not recorded.
    pub(crate) fn mean_emission(&self, i: usize) -> [f32; 3] {
        let [a, b] = [0, 1].map(|half| self.emission(half, i).unwrap_or_default());
        let [na, nb] = [0, 1].map(|half| self.half(half, i).count);
        let share = na as f32 / (na + nb).max(1) as f32;
        [0, 1, 2].map(|c| b[c] + share * (a[c] - b[c]))
    }

    /// The mean emission of the half that pixel `i` lacks, if its samples all lie in the other; `None` if it is not known. At the
    /// edge of a lamp, samples of features alone know it. Elsewhere it is 0 if the samples of light saw none.
    pub(crate) fn emission_of_lacking(&self, i: usize) -> Option<[f32; 3]> {
        self.emission(0, i)?;
        let lacking = usize::from(self.film.half(0, i).is_some_and(|half| half.count > 0));
        let alone = self.film.emission_alone(lacking, i).map(|(_, mean)| mean);
        alone.or_else(|| Some([0.0; 3]).filter(|none| self.mean_emission(i) == *none))
    }

    fn indirect(&self, i: usize) -> RgbMoments {
        let [mut all, second] = [0, 1].map(|half| self.film.indirect(half, i).unwrap_or_default());
        all.merge(&second);
        all
    }
}

/// A bound of the rounding of indirect light, relative to all light. Its running means are `f32`: those of 1000 uniform numbers are
/// exact to 1.3e-6, those of 10,000 to 4.3e-6.
const ROUNDING: f64 = 1e-5;

/// The difference of two colours, or 0 if it may be rounding alone. Else pixels without direct light would seem to have a trace
/// of it, and set the image's level: most of the real direct light would be out of range.
fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|c| if a[c] - b[c] > ROUNDING * a[c] { a[c] - b[c] } else { 0.0 })
}
