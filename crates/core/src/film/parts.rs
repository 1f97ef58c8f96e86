//! Films made from other films (rows, tiles, halves), or from the statistics of another program.

use super::planes::{NO_SURFACE, Window};
use super::{Beside, FeatureMoments, Features, Film, Half, Record, Rejected, RgbMoments, Spread};
use crate::plan::{Combine, Retention};
use crate::{Error, Frame, Needs, SurfaceFeatures, macros::setters, point_set::streams};
use std::ops::Range;

impl Film {
    /// A film of the given rows, counted from the top of this film's window. It has a copy of this film's record and the
    /// rejected samples of the rows. Discarded samples are left out.
    ///
    /// ```
    /// use dapple_core::{Film, Frame, Needs};
    ///
    /// let mut film = Film::new(Frame::new(2, 4)?, Needs::none());
    /// film.push(5, 0, [0.5; 3]);
    /// let rows = film.of_rows(2..4)?;
    /// assert_eq!((rows.frame().size(), rows.count(1)), ([2, 2], 1));
    /// # Ok::<(), dapple_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`Error::BadCrop`] if `rows` is empty or reaches outside the window.
    pub fn of_rows(&self, rows: Range<u32>) -> Result<Film, Error> {
        let part = self.part(self.frame.rows(rows)?, Retention::Keep);
        let rejected = self.rejected_in(&part.frame);
        Ok(Film { record: self.record.clone(), unreported: self.unreported, rejected, ..part })
    }

    /// A copy of the film without the kept samples for which `is_marked(half, pixel)` is `true`; `None` if nothing is marked.
    /// `half` is 0 or 1; 0 in a film without halves. A pixel with one marked half of two has a variance of NaN, unless the film
    /// records [`Needs::half_variance`].
    pub fn without_samples(&self, is_marked: impl Fn(usize, usize) -> bool) -> Option<Film> {
        let pixels = self.frame.pixels();
        let marked = |half: usize| (0..pixels).map(|i| is_marked(half, i)).collect::<Vec<_>>();
        let marked: Vec<_> = (0..self.kept.len()).map(marked).collect();
        let mut film = marked.iter().flatten().any(|is_marked| *is_marked).then(|| self.clone())?;
        let layout = film.layout();
        let halves = film.kept.iter_mut().zip(&marked);
        halves.for_each(|(half, marked)| half.exchange(&mut Half::new(pixels, &layout), marked));
        for (half, i) in (0..marked.len()).flat_map(|half| (0..pixels).map(move |i| (half, i))) {
            if marked[half][i] {
                let is_known = layout.needs.splits_variance() || marked.iter().all(|marked| marked[i]);
                let (sum, none) = (layout.needs.sum_at(half, i), [if is_known { 0.0 } else { f32::NAN }; 3]);
                film.spread.m2.get_mut(sum).into_iter().for_each(|m2| *m2 = none);
                film.spread.indirect_m2.get_mut(sum).into_iter().for_each(|m2| *m2 = none);
            }
        }
        Some(film)
    }

    /// The rejected samples of some rows.
    fn rejected_in(&self, rows: &Frame) -> Vec<Rejected> {
        let (first, height) = (rows.origin()[1], rows.size()[1]);
        let rejected = self.rejected.iter().filter(|r| (first..first + height).contains(&r.sample.pixel[1]));
        rejected.copied().collect()
    }

    /// The part `frame` of this film as a separate film, with the statistics that a round of this retention reads and writes.
    pub(crate) fn part(&self, frame: Frame, retention: Retention) -> Film {
        let window = Window::new(&self.frame, &frame);
        let cut = |halves: &[_], wanted: bool| match wanted {
            true => halves.iter().map(|planes: &Half| planes.cut(&window)).collect(),
            false => Vec::new(),
        };
        let spread = |of: &Spread, wanted: bool| if wanted { of.cut(&window) } else { Spread::default() };
        Film {
            combine: self.combine,
            spread: spread(&self.spread, retention == Retention::Keep),
            discarded_spread: spread(&self.discarded_spread, retention == Retention::Discard),
            kept: cut(&self.kept, retention == Retention::Keep),
            discarded: cut(&self.discarded, retention == Retention::Discard),
            withdrawn: self.withdrawn.iter().map(|withdrawn| window.cut(withdrawn)).collect(),
            beside: self.beside.cut(&window),
            lamp_edges: self.lamp_edges.cut(&self.frame, &frame),
            recorders: self.recorders.clone(),
            half_of: self.half_of,
            ..Self::without_planes(frame, self.needs)
        }
    }

    /// Writes back a [`Film::part`] that has gained samples, and adds its record.
    pub(crate) fn put_back(&mut self, part: Film, retention: Retention) {
        let window = Window::new(&self.frame, &part.frame);
        let ((to, from), (spread, own)) = match retention {
            Retention::Keep => ((&mut self.kept, part.kept), (&mut self.spread, part.spread)),
            Retention::Discard => {
                ((&mut self.discarded, part.discarded), (&mut self.discarded_spread, part.discarded_spread))
            }
        };
        spread.paste(&window, own);
        to.iter_mut().zip(from).for_each(|(to, from)| to.paste(&window, from));
        self.beside.paste(&window, part.beside);
        self.lamp_edges.paste(&self.frame, &part.frame, &part.lamp_edges);
        self.record.samples += part.record.samples;
        self.record.rays += part.record.rays;
        self.record.blocks += part.record.blocks;
        self.unreported += part.unreported;
        if part.record.rejected > 0 {
            self.list_rejected(part.record.rejected, part.rejected);
        }
    }

    /// Mean and variance of the features of pixel `i`'s samples in half 0 or 1; `None` if the film lacks
    /// [`Needs::feature_halves`].
    pub fn half_features(&self, half: usize, i: usize) -> Option<Features> {
        self.beside.half_features.get(2 * i + (half & 1)).map(Into::into)
    }

    /// The samples of half 0 or 1 as a film without halves, so that a filter can be applied to one half alone.
    ///
    /// * From one half: counts, means, emission (also of [feature-only samples](Film::emission_alone)), data of recorders,
    ///   splats, discarded and rejected samples; variances with [`Needs::half_variance`], else none.
    /// * From both halves: first hits, surfaces, and features (from one half with [`Needs::feature_halves`]).
    /// * Left out: costs and the record of rounds.
    ///
    /// A filter that needs halves refuses the new film.
    ///
    /// ```
    /// use dapple_core::{Film, Frame, Needs};
    ///
    /// let mut film = Film::new(Frame::new(1, 1)?, Needs::none().with_halves());
    /// film.push(0, 0, [1.0; 3]);
    /// film.push(0, 1, [4.0; 3]);
    /// film.push(0, 1, [2.0; 3]);
    /// let second = film.half_film(1)?;
    /// assert_eq!((second.count(0), second.mean(0)), (2, [3.0; 3]));
    /// assert!(!second.needs().halves);
    /// # Ok::<(), dapple_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`Error::NotRecorded`] for a film without halves.
    pub fn half_film(&self, half: usize) -> Result<Self, Error> {
        if self.kept.len() != 2 {
            return Err(Error::NotRecorded { who: "half_film".into(), what: "independent halves" });
        }
        let (half, variance) = (half & 1, self.needs.splits_variance());
        let alone = Needs { halves: false, half_variance: false, feature_halves: false, cost: false, ..self.needs };
        let needs = Needs { variance, ..alone };
        // Without sums of each half there are no pairs.
        let own = |sums: &[[f32; 3]]| -> Vec<[f32; 3]> {
            let pairs = if variance { sums.as_chunks::<2>().0 } else { &[] };
            pairs.iter().map(|pair| pair[half]).collect()
        };
        let spread = |of: &Spread| Spread { m2: own(&of.m2), indirect_m2: own(&of.indirect_m2) };
        let kept = vec![self.kept[half].clone()];
        let discarded: Vec<_> = self.discarded.get(half).cloned().into_iter().collect();
        let features = match self.beside.half_features.as_chunks().0 {
            [] => self.beside.features.clone(),
            pairs => pairs.iter().map(|pair: &[_; 2]| pair[half]).collect(),
        };
        let streams = [streams::HALVES[half], streams::DISCARDED_HALVES[half]];
        let rejected: Vec<_> = self.rejected.iter().filter(|r| streams.contains(&r.sample.stream)).copied().collect();
        let samples =
            kept.iter().chain(&discarded).flat_map(|planes| &planes.counts).map(|count| u64::from(*count)).sum();
        Ok(Self {
            combine: Combine::ByCount,
            kept,
            discarded,
            spread: spread(&self.spread),
            discarded_spread: spread(&self.discarded_spread),
            withdrawn: self.withdrawn.get(half).cloned().into_iter().collect(),
            lamp_edges: self.lamp_edges.clone().half(half),
            beside: Beside {
                features,
                surfaces: self.beside.surfaces.clone(),
                first_hits: self.beside.first_hits.clone(),
                ..Beside::default()
            },
            recorders: self.recorders.clone(),
            splats: self.splats.half(half),
            // The field is only tested for being as large as the number of samples.
            unreported: if self.unreported < self.record.samples { 0 } else { samples },
            record: Record { samples, rejected: rejected.len() as u64, ..Record::default() },
            rejected,
            half_of: Some(half),
            ..Self::without_planes(self.frame, needs)
        })
    }
}

/// The statistics of one pixel for [`Film::from_pixels`]: both halves of its samples, emission, features and surface.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelStatistics {
    /// Count, mean and squared deviations of each half of the samples. Means may be negative.
    pub halves: [RgbMoments; 2],
    /// The mean emission of light sources seen directly.
    pub emission: [f32; 3],
    /// The mean features over the samples that hit a surface; `None` if all samples missed.
    pub features: Option<SurfaceFeatures>,
    /// Sample variances of normal, albedo and position, each summed over its channels, and of depth.
    pub feature_variance: [f32; 4],
    /// The fraction of the samples that hit a surface, 0 to 1.
    pub coverage: f32,
    /// Shape and primitive of the first hit of the pixel's first sample; `None` if unknown. Filters that read clusters use it.
    pub surface: Option<[u32; 2]>,
}

impl PixelStatistics {
    /// Statistics of a pixel whose samples hit no surface.
    pub fn new(halves: [RgbMoments; 2]) -> Self {
        Self { halves, ..Self::default() }
    }

    /// Sets the mean features, their sample variances, and the fraction of samples that hit a surface.
    #[must_use]
    pub fn with_features(self, mean: SurfaceFeatures, variance: [f32; 4], coverage: f32) -> Self {
        Self { features: Some(mean), feature_variance: variance, coverage, ..self }
    }

    setters! {
        /// Sets the mean emission of light sources seen directly.
        with_emission(emission: [f32; 3]);
    }

    /// Sets shape and primitive of the first hit.
    #[must_use]
    pub fn with_surface(self, shape: u32, primitive: u32) -> Self {
        Self { surface: Some([shape, primitive]), ..self }
    }

    fn is_finite(&self) -> bool {
        let moments = self.halves.iter().flat_map(|half| half.mean.into_iter().chain(half.m2));
        let emission = self.emission.into_iter().chain([self.coverage]).chain(self.feature_variance);
        moments.chain(emission.map(f64::from)).all(f64::is_finite)
            && self.features.is_none_or(|features| features.is_finite())
    }

    fn feature_moments(&self) -> FeatureMoments {
        let samples = self.halves.iter().map(|half| half.count).sum::<u64>().min(u64::from(u16::MAX)) as u16;
        let hits = (self.coverage.clamp(0.0, 1.0) * f32::from(samples)).round() as u16;
        match self.features {
            Some(SurfaceFeatures { normal: n, albedo: a, position: p, depth, .. }) if hits > 0 => FeatureMoments {
                samples,
                hits: hits.min(samples),
                mean: [n[0], n[1], n[2], a[0], a[1], a[2], p[0], p[1], p[2], depth],
                m2: self.feature_variance.map(|v| v * f32::from(hits - 1)),
            },
            _ => FeatureMoments { samples, ..FeatureMoments::default() },
        }
    }
}

impl Film {
    /// A film made from statistics of another program. `of(i)` returns those of pixel `i`, counted row by row from the top.
    ///
    /// The film records variance, halves, features and emission. It records surfaces only if a pixel has one. Filters treat
    /// it like the film of a render. `dapple_denoise::denoise` makes such films from image buffers.
    ///
    /// ```
    /// use dapple_core::{Film, Frame};
    /// use dapple_core::film::{PixelStatistics, RgbMoments};
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
                let what = format!("pixel ({x}, {y}) has a NaN or an infinity; use finite numbers, or a count of 0");
                return Err(Error::BadBuffer { buffer: "pixels", what });
            }
            for (planes, half) in film.kept.iter_mut().zip(pixel.halves) {
                // The sum makes -0, the mean of rejected samples, 0.
                let count = u32::try_from(half.count).unwrap_or(u32::MAX);
                (planes.counts[i], planes.means[i]) = (count, half.mean.map(|x| x + 0.0));
                (0..3).for_each(|c| {
                    film.spread.m2[i][c] =
                        (f64::from(film.spread.m2[i][c]) + half.m2[c]).min(f64::from(f32::MAX)) as f32
                });
                if count > 0 {
                    let seen = |c: usize| pixel.emission[c].min(half.mean[c] as f32).max(0.0);
                    planes.emission[i] = [seen(0), seen(1), seen(2)];
                }
                film.record.samples += u64::from(count);
            }
            film.beside.features[i] = pixel.feature_moments();
            if let Some(surface) = pixel.surface {
                film.needs = film.needs.with_surfaces();
                film.beside.surfaces.resize(frame.pixels(), NO_SURFACE);
                film.beside.surfaces[i] = surface;
            }
        }
        Ok(film)
    }
}
