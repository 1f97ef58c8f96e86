//! The memory of a render, forecast before it starts.

use crate::bands::{BAND, bands};
use crate::render::holdout::Holdout;
use crate::{Budget, Film, Filter, Frame, Limits, Needs, Sampler, Shard, Trajectory, saturating_u32};

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
        let zeros = Needs { extrema: false, samples: 0, ..*needs };
        let known = limits.budget.samples(frame).is_some();
        let unwritten = if known { frame.bytes(Film::bank_bytes_per_pixel(&zeros)) } else { 0 };
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
    /// The bytes of the film, discarded samples included. One process among several has some rows of it.
    pub film: u64,
    /// The bytes of the film of all processes.
    pub whole: u64,
    /// The bytes of the film that process 0 among several gets for its files.
    pub delivered: u64,
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

/// The number of samples that a render stores one by one.
fn samples(needs: &Needs, frame: &Frame, limits: &Limits) -> u64 {
    let pixels = frame.pixels() as u64;
    let halves = if needs.halves { 2 } else { 1 };
    let kept = pixels.saturating_mul(halves).saturating_mul(u64::from(needs.samples));
    kept.min(limits.expected_samples(frame))
}

/// The bytes of a sample that is stored one by one.
fn sample_bytes(needs: &Needs) -> u64 {
    (size_of::<[f32; 3]>() + if needs.trajectories { size_of::<Trajectory>() } else { 0 }) as u64
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
    /// Samples stored one by one take 12 bytes each, or 28 with [`Needs::trajectories`]. They are [`Needs::samples`] per pixel and
    /// half, but not more than the budget has in the mean ([`Limits::expected_samples`]).
    pub fn of_render(sampler: &dyn Sampler, filter: &dyn Filter, needs: Needs, frame: &Frame, limits: &Limits) -> Self {
        let needs = needs.and(sampler.needs());
        let needs = if matches!(limits.budget, Budget::Error { .. }) { needs.with_halves() } else { needs };
        let SamplerMemory { discarded, state, planning, plan } = sampler.memory(frame, &needs, limits);
        // One sample per pixel goes to the first half. The other's zeros are never written, so they take no memory.
        let single = limits.budget.samples(frame).is_some_and(|total| total <= frame.pixels() as u64);
        let unwritten =
            if needs.halves && single { Film::bank_bytes_per_pixel(&Needs { samples: 0, ..needs }) / 2 } else { 0 };
        let stored = samples(&needs, frame, limits);
        let each = saturating_u32(stored.div_ceil(frame.pixels().max(1) as u64));
        let film = frame
            .bytes(Film::bytes_per_pixel(&needs) - unwritten)
            .saturating_add(discarded)
            .saturating_add(stored.saturating_mul(sample_bytes(&needs)));
        Self {
            needs,
            film,
            whole: film,
            delivered: 0,
            sampler: state,
            planning,
            tracing: plan,
            filter: filter.memory(frame, &Needs { samples: each, ..needs }),
            holdout: 0,
        }
    }

    /// The memory of one process among several that render together [in bands](crate::Render::in_bands): its rows of the
    /// film and those around them. Process 0 gets the whole film and filters it. Unchanged if every process plans the whole image.
    ///
    /// Bands are dealt by cost; the figures hold if all take the same time.
    #[must_use]
    pub fn in_bands(self, sampler: &dyn Sampler, frame: &Frame, limits: &Limits, share: Shard) -> Self {
        let reads_all = matches!(limits.budget, Budget::Error { .. }) || self.needs.splats;
        let halo = sampler.halo().filter(|_| !reads_all && share.of() > 1);
        let Some(halo) = halo else { return self };
        let height = u64::from(frame.size()[1]);
        let part =
            |bytes: u64, rows: u64| (u128::from(bytes) * u128::from(rows.min(height)) / u128::from(height)) as u64;
        let own = (bands(height as usize) as u64).div_ceil(u64::from(share.of())) * BAND as u64;
        let held = own + own / BAND as u64 * 2 * u64::from(halo);
        let is_first = share.index() == 0;
        let FilterMemory { applying, image } = self.filter;
        // Process 0 filters the whole film.
        let (filter, delivered) = match is_first {
            true => (FilterMemory { applying: self.film.saturating_add(applying), image }, self.film),
            false => (FilterMemory::default(), 0),
        };
        let planning = self.tracing.saturating_add(part(self.planning.saturating_sub(self.tracing), own));
        Self { film: part(self.film, held), planning, filter, delivered, ..self }
    }

    /// The bytes of a snapshot taken during the render ([`Status::snapshot`](crate::Status::snapshot)). A resumed
    /// render holds the same number of bytes besides the film at first.
    pub fn snapshot(&self) -> u64 {
        self.whole.saturating_add(self.tracing).saturating_add(self.holdout)
    }

    /// The peak of the whole render in bytes, without snapshots.
    pub fn peak(&self) -> u64 {
        let lasting = self.film.saturating_add(self.sampler).saturating_add(self.holdout);
        let files = self.filter.image.saturating_add(self.delivered);
        lasting.saturating_add(self.planning.max(self.tracing).max(self.filter.applying).max(files))
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
    fn samples_stored_one_by_one_count_as_far_as_the_budget_goes() {
        let (frame, uniform) = (Frame::new(100, 50).unwrap(), Uniform::new(Points));
        let film = |needs: Needs, limits: &Limits| Memory::of_render(&uniform, &Unfiltered, needs, &frame, limits).film;
        let three = Needs::none().with_samples(3);
        let all = Needs::none().with_halves().with_samples(u32::MAX);
        assert_eq!(film(three, &Limits::spp(4.0)), 5000 * (32 + 24 + 12 * 3));
        assert_eq!(film(three, &Limits::spp(2.0)), 5000 * (32 + 24 + 12 * 2));
        assert_eq!(film(all, &Limits::spp(16.0)), 5000 * (2 * (32 + 24) + 12 * 16));
        assert_eq!(film(all, &Limits::spp(1.0)), 5000 * (32 + 2 * 24 + 12));
        assert_eq!(film(three.with_halves(), &Limits::spp(16.0)), 5000 * 2 * (32 + 24 + 12 * 3));
        assert_eq!(film(all, &Limits::seconds(9.0)), 5000 * (2 * (32 + 24) + 12 * 64));
        assert_eq!(film(all, &Limits::seconds(9.0).with_max_spp(8)), 5000 * (2 * (32 + 24) + 12 * 8));
        assert_eq!(film(all, &Limits::error(0.1, 40_000)), 5000 * (2 * (32 + 24) + 12 * 8));
    }

    #[test]
    fn trajectories_count_only_with_samples_stored_one_by_one() {
        let (frame, uniform) = (Frame::new(100, 50).unwrap(), Uniform::new(Points));
        let film = |needs: Needs| Memory::of_render(&uniform, &Unfiltered, needs, &frame, &Limits::spp(4.0)).film;
        assert_eq!(film(Needs::none().with_trajectories()), 5000 * 32);
        let three = Needs::none().with_samples(3).with_trajectories();
        assert_eq!(film(three), 5000 * (32 + 2 * 24 + 3 * (12 + 16)));
        let all = Needs::none().with_halves().with_samples(u32::MAX).with_trajectories();
        assert_eq!(film(all), 5000 * (2 * (32 + 2 * 24) + 4 * (12 + 16)));
    }

    /// A sampler that plans by rows.
    struct ByRows(Uniform<Points>);

    impl Sampler for ByRows {
        fn name(&self) -> &str {
            "rows"
        }

        fn points(&self) -> &dyn PointSet {
            self.0.points()
        }

        fn halo(&self) -> Option<u32> {
            Some(2)
        }

        fn next_round(
            &mut self,
            seen: &crate::Feedback<'_>,
            plan: &mut crate::Plan,
        ) -> Result<crate::Progress, crate::Error> {
            self.0.next_round(seen, plan)
        }
    }

    #[test]
    fn one_process_among_several_takes_its_rows() {
        let (frame, limits) = (Frame::new(100, 160).unwrap(), Limits::new(Budget::Samples(64_000)));
        let sampler = ByRows(Uniform::new(Points));
        let memory = Memory::of_render(&sampler, &Unfiltered, Needs::none().with_features(), &frame, &limits);
        let (image, film) = (12 * 16_000, (32 + 120) * 16_000);
        assert_eq!((memory.film, memory.filter.applying), (film, image));
        let of = |index, of| {
            let share = Shard::new(index, of).unwrap();
            memory.in_bands(&sampler, &frame, &limits, share)
        };
        assert_eq!(of(0, 1), memory);
        // Two bands of 16 rows, each with four more. Process 0 filters the whole film.
        assert_eq!((of(1, 5).film, of(1, 5).delivered, of(1, 5).filter), (film / 160 * 40, 0, FilterMemory::default()));
        assert_eq!(of(0, 5).filter, FilterMemory { applying: film + image, image });
        assert_eq!((of(0, 5).peak(), of(1, 5).snapshot()), (film / 4 + film + image, memory.snapshot()));
    }

    /// Sums beyond 64 bits saturate instead of wrapping.
    #[test]
    fn the_largest_image_does_not_wrap_z03() {
        let frame = Frame::new(65535, 65537).unwrap();
        assert_eq!(frame.pixels(), u32::MAX as usize);
        let largest = of(&Uniform::new(Points), &frame, Budget::Samples(1 << 40));
        assert_eq!(largest.film, 32 * u64::from(u32::MAX));
        let film = 32 * u64::from(u32::MAX);
        assert_eq!(largest.peak(), film + 12 * u64::from(u32::MAX), "the image stands beside the film");
        assert_eq!(frame.bytes(usize::MAX), u64::MAX);
        let full = Memory { film: u64::MAX, whole: u64::MAX, ..largest };
        assert_eq!((full.peak(), full.snapshot()), (u64::MAX, u64::MAX));
    }
}
