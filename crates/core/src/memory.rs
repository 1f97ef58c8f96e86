//! The memory that samplers and filters take, forecast before a render starts.

use crate::{Film, Frame, Limits, Needs};

/// The bytes that a sampler adds to a film of kept samples; 0 by default. Includes only what grows with the number of pixels.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SamplerMemory {
    /// The film's additional planes for discarded samples, in bytes.
    pub discarded: u64,
    /// The bytes of state that the sampler keeps from one round to the next.
    pub state: u64,
    /// The peak in bytes while a round is planned, the plan included.
    pub planning: u64,
    /// The bytes of the plan (a sample count per pixel), which is held while the round is traced.
    pub plan: u64,
}

impl SamplerMemory {
    /// The memory of a stateless sampler. Planning takes `bytes_per_pixel` in addition to the plan.
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
    /// With a budget given in samples, the sampler plans before the film has any kept samples. The operating system has not
    /// yet allocated the planes of kept samples, so the peak of planning is lower by the same amount.
    #[must_use]
    pub fn with_discarded(self, frame: &Frame, needs: &Needs, limits: &Limits) -> Self {
        let discarded = frame.bytes(Film::halves_bytes_per_pixel(needs));
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
    /// The memory of a filter that takes at most `bytes_per_pixel`, the filtered image included, and returns `planes`.
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
