//! How much memory a render takes, known before it starts.

use crate::{Budget, Film, Filter, Frame, Limits, Needs, Sampler};

/// Bytes that a sampler takes besides the film; the default is none.
///
/// What goes with pixels is counted; a few bytes that do not are not worth it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SamplerMemory {
    /// Statistics that the film keeps beside the image's, because the sampler discards or withdraws samples.
    pub discarded: u64,
    /// What the sampler itself keeps from one round to the next.
    pub state: u64,
    /// The most that planning a round takes, the plan included.
    pub planning: u64,
    /// The plan alone, which lasts while its round is traced.
    pub plan: u64,
}

impl SamplerMemory {
    /// A sampler that keeps nothing, and takes so many bytes per pixel to fill in a plan of `halves`' counts.
    pub fn planning(frame: &Frame, halves: bool, bytes_per_pixel: usize) -> Self {
        let plan = frame.bytes(if halves { 8 } else { 4 });
        Self { planning: plan.saturating_add(frame.bytes(bytes_per_pixel)), plan, ..Self::default() }
    }

    /// The same, with so many bytes per pixel from one round to the next.
    #[must_use]
    pub fn with_state(self, frame: &Frame, bytes_per_pixel: usize) -> Self {
        Self { state: frame.bytes(bytes_per_pixel), ..self }
    }

    /// The same for a sampler that discards its first rounds: the film has twice its statistics of samples. Where the
    /// budget is known it plans the rest when all samples so far are discarded, and the image's own counts, means and
    /// deviations are still zeros that nobody has written, so that they take no memory yet.
    #[must_use]
    pub fn with_discarded(self, frame: &Frame, needs: &Needs, limits: &Limits) -> Self {
        let discarded = frame.bytes(Film::bank_bytes_per_pixel(needs));
        let zeros = Needs { extrema: false, ..*needs };
        let known = matches!(limits.budget, Budget::Samples(_));
        let unwritten = if known { frame.bytes(Film::bank_bytes_per_pixel(&zeros)) } else { 0 };
        Self { discarded, planning: self.planning.saturating_sub(unwritten), ..self }
    }
}

/// Bytes that a filter takes besides the film.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FilterMemory {
    /// The most while it is applied, its image included.
    pub applying: u64,
    /// Its image, with the error if it knows that.
    pub image: u64,
}

impl FilterMemory {
    /// Of a filter that takes so many bytes per pixel at most, and knows its error or does not.
    pub fn new(frame: &Frame, applying: usize, knows_error: bool) -> Self {
        let image = frame.bytes(if knows_error { 16 } else { 12 });
        Self { applying: frame.bytes(applying).max(image), image }
    }
}

/// The memory that a render takes, in bytes, as far as it goes with the size of the image.
///
/// Counted from the planes that each part holds at its fullest, and not measured: the same on every machine of as many threads. What the
/// integrator knows of the scene comes on top, and so does what becomes of the image afterwards. Under a limit of time or
/// error it is what a render takes that goes on after its first round; one that ends with it takes less.
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// All that the film records.
    pub needs: Needs,
    /// The film, discarded samples included.
    pub film: u64,
    /// What the sampler keeps.
    pub sampler: u64,
    /// The most while a round is planned, besides the two.
    pub planning: u64,
    /// The plan of the round that is traced.
    pub tracing: u64,
    /// What the filter takes.
    pub filter: FilterMemory,
}

impl Memory {
    /// Of a [`Render`](crate::Render) with these arguments, and of applying `filter` to the film. `needs` are those of
    /// everybody but sampler and limits.
    pub fn of_render(sampler: &dyn Sampler, filter: &dyn Filter, needs: Needs, frame: &Frame, limits: &Limits) -> Self {
        let needs = needs.and(sampler.needs());
        let needs = if matches!(limits.budget, Budget::Error { .. }) { needs.with_halves() } else { needs };
        let SamplerMemory { discarded, state, planning, plan } = sampler.memory(frame, &needs, limits);
        // One sample a pixel goes to the first half; nobody writes to the other's zeros, so that they take no memory.
        let single = matches!(limits.budget, Budget::Samples(total) if total <= frame.pixels() as u64);
        let unwritten = if needs.halves && single { Film::bank_bytes_per_pixel(&needs) / 2 } else { 0 };
        Self {
            needs,
            film: frame.bytes(Film::bytes_per_pixel(&needs) - unwritten).saturating_add(discarded),
            sampler: state,
            planning,
            tracing: plan,
            filter: filter.memory(frame, &needs),
        }
    }

    /// A snapshot of the render between two slices ([`Status::snapshot`](crate::Status::snapshot)); as many bytes are there
    /// beside the film where a render goes on from one.
    pub fn snapshot(&self) -> u64 {
        self.film.saturating_add(self.tracing)
    }

    /// The most at any time, without snapshots.
    pub fn peak(&self) -> u64 {
        let lasting = self.film.saturating_add(self.sampler);
        lasting.saturating_add(self.planning.max(self.tracing).max(self.filter.applying))
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
    fn a_film_counts_what_it_will_record() {
        let frame = Frame::new(100, 50).unwrap();
        let uniform = of(&Uniform::new(Points), &frame, Budget::Samples(20_000));
        assert_eq!(uniform.film, 5000 * 32);
        assert_eq!(uniform.filter, FilterMemory { applying: 5000 * 12, image: 5000 * 12 });
        let halves = of(&Uniform::new(Points), &frame, Budget::Error { relmse: 0.1, at_most: 20_000 });
        assert_eq!((halves.film, halves.filter.image), (5000 * 64, 5000 * 16));
        assert_eq!(halves.snapshot(), halves.film + halves.tracing);
    }

    /// Sums that leave 64 bits are "more than there is", not little.
    #[test]
    fn z03_the_largest_image_does_not_wrap() {
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
