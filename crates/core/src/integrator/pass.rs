//! Preparation of an integrator for a pass of samples.

use crate::{Draws, Frame, PointSet, SampleId, streams};

/// The times at which an integrator prepares itself ([`Integrator::prepare`](crate::Integrator::prepare)).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Prepares {
    /// Never.
    #[default]
    Never,
    /// Once, before the first sample.
    Once,
    /// Before each pass of about two samples per pixel: one for each half of the film.
    ///
    /// A round in which few pixels get samples has passes of more samples for each, so that passes take about the same
    /// time. Their lengths follow from the plans alone.
    EveryPass,
}

/// The inputs of one preparation.
#[non_exhaustive]
pub struct Pass<'a> {
    /// The number of the pass, from 0.
    pub number: u32,
    /// The point set of the render.
    pub points: &'a dyn PointSet,
    /// The frame of the image.
    pub frame: Frame,
}

impl<'a> Pass<'a> {
    /// The random numbers of one of the pass's paths from the lights, a pure function of point set, pass and path.
    ///
    /// Paths of a pass are samples of one pixel of the stream [`streams::LIGHT`], so that they are well distributed
    /// together.
    pub fn draws(&self, path: u64) -> Draws<'a> {
        let capacity = self.points.capacity().max(1);
        let pixel = [self.number, u32::try_from(path / capacity).unwrap_or(u32::MAX)];
        Draws::new(self.points, SampleId::new(pixel, streams::LIGHT, path % capacity))
    }
}

/// The cost of one preparation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Prepared {
    /// The number of rays traced.
    pub rays: u64,
}
