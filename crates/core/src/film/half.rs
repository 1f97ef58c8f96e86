//! One half of a film, as a film of its own.

use super::{FeatureMoments, Features, Film, Splats};
use crate::{Combine, Error, Needs, Record, streams};

impl Film {
    /// Mean and variance of the features of pixel `i`'s samples in half 0 or 1; `None` without
    /// [`Needs::feature_halves`].
    pub fn half_features(&self, half: usize, i: usize) -> Option<Features> {
        self.half_features.get(2 * self.held.at(i) + (half & 1)).map(Into::into)
    }

    /// The samples of half 0 or 1 as a film without halves, so that a filter can be applied to one half alone.
    ///
    /// Counts, moments, extrema, emission, channels, sums, single samples, splats and discarded samples are those of the half. So are
    /// features if the film records them [per half](Needs::feature_halves); else they are those of both halves, as first
    /// hits always are. [Emission alone](Film::emission_alone) is that of the half. Costs and the record of rounds are left
    /// out. A filter that needs halves refuses the film.
    ///
    /// The film takes [`Film::bytes_per_pixel`] of its own [`Needs`].
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
        let half = half & 1;
        let needs = Needs { halves: false, feature_halves: false, cost: false, ..self.needs };
        let kept = vec![self.kept[half].clone()];
        let discarded: Vec<_> = self.discarded.get(half).cloned().into_iter().collect();
        let mut features = match self.half_features.as_chunks().0 {
            [] => self.features.clone(),
            pairs => pairs.iter().map(|pair: &[_; 2]| pair[half]).collect(),
        };
        features.iter_mut().for_each(|f: &mut FeatureMoments| f.emission.keep(half));
        let splats = Splats {
            sums: self.splats.sums.get(half).cloned().into_iter().collect(),
            samples: [self.splats.samples[half], 0],
        };
        let own = [streams::HALVES[half], streams::DISCARDED_HALVES[half]];
        let rejected: Vec<_> = self.rejected.iter().filter(|r| own.contains(&r.sample.stream)).copied().collect();
        let samples = kept.iter().chain(&discarded).flat_map(|bank| &bank.counts).sum();
        let record = Record { samples, rejected: rejected.len() as u64, ..Record::default() };
        // Of samples that report no hits, only whether all are such is read.
        let unreported = if self.unreported < self.record.samples { 0 } else { samples };
        Ok(Self {
            frame: self.frame,
            needs,
            combine: Combine::ByCount,
            kept,
            discarded,
            features,
            half_features: Vec::new(),
            first_hits: self.first_hits.clone(),
            costs: Vec::new(),
            splats,
            rejected,
            record,
            unreported,
            half_of: Some(half),
            held: self.held.clone(),
        })
    }
}
