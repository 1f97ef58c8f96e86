//! The memory of a render as far as it grows with the size of the image.

use dapple_core::{Budget, Film, Filter, FilterMemory, Frame, Limits, Needs, Recorder, Render, Sampler, SamplerMemory};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The bytes of a render's film, plans and filter, computed from the planes that each part holds at its peak.
///
/// Machines with the same number of threads agree on them. Under a limit of time or error, the figures hold for a render of
/// more than one round; one round takes less.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ImageMemory {
    /// The statistics that the film records.
    pub(crate) needs: Needs,
    /// The film, with discarded samples, and the filtered image that an error limit keeps.
    pub(crate) film: u64,
    /// The state of the sampler between rounds.
    pub(crate) sampler: u64,
    /// The peak while a round is planned, besides film and state.
    pub(crate) planning: u64,
    /// The plan of the round that is traced.
    pub(crate) tracing: u64,
    pub(crate) filter: FilterMemory,
}

impl ImageMemory {
    /// The memory of a render with these arguments, and of `filter` applied to its film. An error limit concerns the filtered
    /// image if `judged`.
    ///
    /// [Recorders](Recorder) take the words of as many samples per pixel and half as the budget has in the mean.
    pub(crate) fn new(
        sampler: &dyn Sampler,
        (filter, judged): (&dyn Filter, bool),
        needs: Needs,
        frame: &Frame,
        limits: &Limits,
    ) -> Self {
        let is_error = matches!(limits.budget, Budget::Error { .. });
        let needs = needs.and(sampler.needs());
        let needs = if is_error { needs.with_halves() } else { needs };
        let SamplerMemory { discarded, state, planning, plan, .. } = sampler.memory(frame, &needs, limits);
        // One sample per pixel goes to the first half. The other's zeros are never written, so they take no memory.
        let single = limits.budget.samples(frame).is_some_and(|total| total <= frame.pixels() as u64);
        let unwritten = if needs.halves && single { Film::halves_bytes_per_pixel(&needs) / 2 } else { 0 };
        let kept = frame.bytes(if is_error && judged { Render::ERROR_OF_BYTES } else { 0 });
        let film = frame.bytes(Film::bytes_per_pixel(&needs) - unwritten).saturating_add(discarded);
        let recorders = sampler.recorders().into_iter().chain(filter.recorders());
        let recorders: BTreeMap<String, Arc<dyn Recorder>> = recorders.map(|one| (one.name().into(), one)).collect();
        let (pixels, halves) = (frame.pixels() as u64, if needs.halves { 2 } else { 1 });
        let each = limits.expected_samples(frame).div_ceil(pixels).div_ceil(halves);
        let words = recorders.values().map(|one| one.bytes(each) + size_of::<Vec<u32>>() as u64).sum::<u64>();
        let film = film.saturating_add((pixels * halves).saturating_mul(words)).saturating_add(kept);
        Self { needs, film, sampler: state, planning, tracing: plan, filter: filter.memory(frame, &needs) }
    }

    /// The bytes of a snapshot. A resumed render holds as many besides the film at first.
    pub(crate) fn snapshot(&self) -> u64 {
        self.film.saturating_add(self.tracing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_core::samplers::Uniform;
    use dapple_core::{HostNumbers, RecordedSample, Unfiltered};

    fn of(frame: &Frame, budget: Budget) -> ImageMemory {
        let (sampler, limits) = (Uniform::new(HostNumbers), Limits::new(budget));
        ImageMemory::new(&sampler, (&Unfiltered, true), Needs::none(), frame, &limits)
    }

    #[test]
    fn the_forecast_counts_every_recorded_statistic() {
        let frame = Frame::new(100, 50).unwrap();
        let uniform = of(&frame, Budget::Samples(20_000));
        assert_eq!((uniform.film, uniform.filter.image), (5000 * 32, 5000 * 12));
        let halves = of(&frame, Budget::Error { relmse: 0.1, at_most: 20_000 });
        assert_eq!((halves.film, halves.filter.image), (5000 * (64 + 48), 5000 * 16));
        assert_eq!(halves.snapshot(), halves.film + halves.tracing);
    }

    #[test]
    fn the_largest_image_does_not_wrap_z03() {
        let frame = Frame::new(65535, 65537).unwrap();
        assert_eq!(of(&frame, Budget::Samples(1 << 40)).film, 32 * u64::from(u32::MAX));
        assert_eq!(frame.bytes(usize::MAX), u64::MAX);
    }

    /// Keeps a word of each sample.
    struct Words(&'static str);

    impl Recorder for Words {
        fn name(&self) -> &str {
            self.0
        }

        fn record(&self, words: &mut Vec<u32>, _: &RecordedSample<'_>) {
            words.push(0);
        }

        fn bytes(&self, samples: u64) -> u64 {
            4 * samples
        }
    }

    impl Filter for Words {
        fn name(&self) -> &str {
            self.0
        }

        fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
            ["a", "a", "b"].map(|name| Arc::new(Words(name)) as Arc<dyn Recorder>).to_vec()
        }

        fn apply(&self, film: &Film) -> Result<dapple_core::Filtered, dapple_core::Error> {
            Unfiltered.apply(film)
        }
    }

    #[test]
    fn recorders_count_once_with_their_words() {
        let (frame, sampler) = (Frame::new(7, 5).unwrap(), Uniform::new(HostNumbers));
        for (needs, halves) in [(Needs::none(), 1), (Needs::none().with_halves(), 2)] {
            let memory = ImageMemory::new(&sampler, (&Words("words"), false), needs, &frame, &Limits::spp(8.0));
            let words = 2 * (4 * 8 / halves + size_of::<Vec<u32>>() as u64);
            assert_eq!(memory.film, 35 * halves * (32 + words));
        }
    }
}
