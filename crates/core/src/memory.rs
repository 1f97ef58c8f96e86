//! The memory of a render, forecast before it starts.

use crate::recorder::Recorders;
use crate::render::holdout::Holdout;
use crate::{Budget, Film, Filter, Frame, Limits, Needs, Sampler};

/// The bytes that a sampler takes besides the film; 0 by default. Counts only memory that grows with the number of
/// pixels.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SamplerMemory {
    /// The bytes of the statistics of discarded or withdrawn samples, which the film stores besides those of the kept
    /// samples.
    pub discarded: u64,
    /// The bytes of state that the sampler keeps from one round to the next.
    pub state: u64,
    /// The peak in bytes while a round is planned, the plan included.
    pub planning: u64,
    /// The bytes of the plan (a sample count per pixel), which is held while the round is traced.
    pub plan: u64,
}

impl SamplerMemory {
    /// The memory of a sampler without state that takes `bytes_per_pixel`, besides the plan, while it plans.
    pub fn planning(frame: &Frame, bytes_per_pixel: usize) -> Self {
        let plan = frame.bytes(4);
        Self { planning: plan.saturating_add(frame.bytes(bytes_per_pixel)), plan, ..Self::default() }
    }

    /// Adds the bytes of the sample counts, one per pixel, that a plan stores for the second half of the samples.
    #[must_use]
    pub fn with_second_half(self, frame: &Frame) -> Self {
        let counts = frame.bytes(4);
        let (planning, plan) = (self.planning.saturating_add(counts), self.plan.saturating_add(counts));
        Self { planning, plan, ..self }
    }

    /// Sets the memory of the sampler's state between rounds, in bytes per pixel.
    #[must_use]
    pub fn with_state(self, frame: &Frame, bytes_per_pixel: usize) -> Self {
        Self { state: frame.bytes(bytes_per_pixel), ..self }
    }

    /// Adds the memory of discarded samples: a film with both kept and discarded samples holds its statistics twice.
    ///
    /// With a budget given in samples, all samples so far are discarded when the rest is planned. The planes of kept
    /// samples are then still untouched zeros, which take no memory yet.
    #[must_use]
    pub fn with_discarded(self, frame: &Frame, needs: &Needs, limits: &Limits) -> Self {
        let discarded = frame.bytes(Film::bank_bytes_per_pixel(needs));
        let known = limits.budget.samples(frame).is_some();
        let unwritten = if known { discarded } else { 0 };
        Self { discarded, planning: self.planning.saturating_sub(unwritten), ..self }
    }
}

/// The per-pixel values in a filter's result.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImagePlanes {
    /// Radiance only.
    Radiance,
    /// Radiance, and the estimated squared error.
    RadianceAndError,
}

/// The bytes that a filter takes besides the film.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FilterMemory {
    /// The peak in bytes while the filter is applied, the filtered image included.
    pub applying: u64,
    /// The bytes of the filtered image, with its error estimates if the filter makes them.
    pub image: u64,
}

impl FilterMemory {
    /// The memory of a filter that takes at most `bytes_per_pixel`, the filtered image included, and returns these
    /// planes.
    pub fn new(frame: &Frame, bytes_per_pixel: usize, planes: ImagePlanes) -> Self {
        let image = frame.bytes(match planes {
            ImagePlanes::Radiance => 12,
            ImagePlanes::RadianceAndError => 16,
        });
        Self { applying: frame.bytes(bytes_per_pixel).max(image), image }
    }

    /// Raises the peak to at least `applying` bytes.
    #[must_use]
    pub fn at_least(self, applying: u64) -> Self {
        Self { applying: self.applying.max(applying), ..self }
    }
}

/// The memory of a render in bytes, as far as it grows with the size of the image.
///
/// The figures are computed from the planes that each part holds at its peak, not measured. Machines with the same
/// number of threads agree on them. The scene, and later processing of the image, are not included. Under a limit of
/// time or error, the figures hold for a render of more than one round; one round takes less.
///
/// ```
/// # use dapple_core::*;
/// # use dapple_core::samplers::Uniform;
/// # struct Points;
/// # impl PointSet for Points {
/// #     fn describe(&self) -> String { "none".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// #     fn capacity(&self) -> u64 { u64::MAX }
/// # }
/// let frame = Frame::new(2048, 2048)?;
/// let limits = Limits::new(Budget::Samples(4 << 22));
/// let memory = Memory::of_render(&Uniform::new(Points), &Unfiltered, Needs::none(), &frame, &limits);
/// assert_eq!(memory.film, 32 << 22);
/// assert!(memory.peak() < 80 << 22);
/// # Ok::<(), Error>(())
/// ```
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// The statistics that the film records.
    pub needs: Needs,
    /// The bytes of the film, discarded samples included.
    pub film: u64,
    /// The bytes of state that the sampler keeps between rounds.
    pub sampler: u64,
    /// The peak in bytes while a round is planned, besides the film and the sampler's state.
    pub planning: u64,
    /// The bytes of the plan (a sample count per pixel) of the round being traced.
    pub tracing: u64,
    /// The bytes that the filter takes besides the film.
    pub filter: FilterMemory,
    /// The bytes of the last filtered image and its halves, which [`Render::error_of`](crate::Render::error_of) keeps.
    pub holdout: u64,
}

impl Memory {
    /// Adds the memory of an error limit that concerns a filtered image
    /// ([`Render::error_of`](crate::Render::error_of)).
    #[must_use]
    pub fn with_error_of(self, frame: &Frame) -> Self {
        Self { holdout: frame.bytes(Holdout::BYTES), ..self }
    }

    /// The memory of a [`Render`](crate::Render) with these arguments, and of `filter` applied to its film. `needs` are
    /// the statistics that the filter and other readers request; those of sampler and limits are added.
    ///
    /// [Recorders](crate::Recorder) take the words of as many samples per pixel and half as the budget has in the mean
    /// ([`Limits::expected_samples`]).
    pub fn of_render(sampler: &dyn Sampler, filter: &dyn Filter, needs: Needs, frame: &Frame, limits: &Limits) -> Self {
        let needs = needs.and(sampler.needs());
        let needs = if matches!(limits.budget, Budget::Error { .. }) { needs.with_halves() } else { needs };
        let SamplerMemory { discarded, state, planning, plan } = sampler.memory(frame, &needs, limits);
        // One sample per pixel goes to the first half. The other's zeros are never written, so they take no memory.
        let single = limits.budget.samples(frame).is_some_and(|total| total <= frame.pixels() as u64);
        let unwritten = if needs.halves && single { Film::bank_bytes_per_pixel(&needs) / 2 } else { 0 };
        let film = frame.bytes(Film::bytes_per_pixel(&needs) - unwritten).saturating_add(discarded);
        let recorders = Recorders::new(sampler.recorders().into_iter().chain(filter.recorders()));
        let (pixels, halves) = (frame.pixels() as u64, if needs.halves { 2 } else { 1 });
        let each = limits.expected_samples(frame).div_ceil(pixels.max(1)).div_ceil(halves);
        let words = recorders.active.iter().map(|one| one.bytes(each) + size_of::<Vec<u32>>() as u64).sum::<u64>();
        Self {
            needs,
            film: film.saturating_add((pixels * halves).saturating_mul(words)),
            sampler: state,
            planning,
            tracing: plan,
            filter: filter.memory(frame, &needs),
            holdout: 0,
        }
    }

    /// The bytes of a snapshot taken during the render ([`Status::snapshot`](crate::Status::snapshot)). A resumed
    /// render holds the same number of bytes besides the film at first.
    pub fn snapshot(&self) -> u64 {
        self.film.saturating_add(self.tracing).saturating_add(self.holdout)
    }

    /// The peak of the whole render in bytes, without snapshots.
    pub fn peak(&self) -> u64 {
        let lasting = self.film.saturating_add(self.sampler).saturating_add(self.holdout);
        lasting.saturating_add(self.planning.max(self.tracing).max(self.filter.applying).max(self.filter.image))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samplers::Uniform;
    use crate::{PointSet, SampleId, Unfiltered};

    struct Points;

    impl PointSet for Points {
        fn describe(&self) -> String {
            "none".into()
        }

        fn block(&self, _: SampleId, _: u32) -> [f32; 4] {
            [0.5; 4]
        }

        fn capacity(&self) -> u64 {
            u64::MAX
        }
    }

    fn of(sampler: &dyn Sampler, frame: &Frame, budget: Budget) -> Memory {
        Memory::of_render(sampler, &Unfiltered, Needs::none(), frame, &Limits::new(budget))
    }

    #[test]
    fn the_forecast_counts_every_recorded_statistic() {
        let frame = Frame::new(100, 50).unwrap();
        let uniform = of(&Uniform::new(Points), &frame, Budget::Samples(20_000));
        assert_eq!(uniform.film, 5000 * 32);
        assert_eq!(uniform.filter, FilterMemory { applying: 5000 * 12, image: 5000 * 12 });
        let halves = of(&Uniform::new(Points), &frame, Budget::Error { relmse: 0.1, at_most: 20_000 });
        assert_eq!((halves.film, halves.filter.image), (5000 * 64, 5000 * 16));
        assert_eq!(halves.snapshot(), halves.film + halves.tracing);
    }

    #[test]
    fn the_largest_image_does_not_wrap_z03() {
        let frame = Frame::new(65535, 65537).unwrap();
        assert_eq!(frame.pixels(), u32::MAX as usize);
        let largest = of(&Uniform::new(Points), &frame, Budget::Samples(1 << 40));
        assert_eq!(largest.film, 32 * u64::from(u32::MAX));
        let film = 32 * u64::from(u32::MAX);
        assert_eq!(largest.peak(), film + 12 * u64::from(u32::MAX), "the image stands beside the film");
        assert_eq!(frame.bytes(usize::MAX), u64::MAX);
        let full = Memory { film: u64::MAX, ..largest };
        assert_eq!((full.peak(), full.snapshot()), (u64::MAX, u64::MAX));
    }
}
