//! Methods that are a rule with options: the parts that are the same for all of them.

use crate::recorders::{FilmSamples, Singles};
use crate::rounds::{first_samples, plan_first};
use crate::{Domain, FilmPoints};
use dapple_core::{
    Error, Feedback, Film, Filter, FilterMemory, Filtered, Frame, ImagePlanes, Limits, Needs, Options, Plan, PointSet,
    Progress, Recorder, Sampler, SamplerMemory,
};
use std::sync::Arc;

/// A rule that plans sample counts from a film alone, after a pilot.
pub trait SamplingMethod: Options + Copy + Send {
    /// The sampler's name.
    const NAME: &'static str;

    /// The statistics that the rule reads.
    fn needs(&self) -> Needs {
        Needs::none().with_variance()
    }

    /// The recorders of statistics that the rule reads.
    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        Vec::new()
    }

    /// The number of rounds for a budget of samples, if it is known.
    fn number_of_rounds(&self) -> Option<u32> {
        None
    }

    /// The memory in which a round is planned.
    fn planning(&self, frame: &Frame, needs: &Needs) -> SamplerMemory;

    /// The samples per pixel of the pilot, for a mean budget of `mean` samples per pixel.
    fn pilot_samples(&self, mean: u64) -> u32;

    /// Plans a round after the pilot, which has `first` samples per pixel. Counts stay 0 if no more samples are wanted.
    ///
    /// # Errors
    ///
    /// If the budget cannot be met.
    fn refine(&self, seen: &Feedback<'_>, first: u32, plan: &mut Plan) -> Result<(), Error>;
}

/// A sampler of a point set and a rule with options.
pub struct MethodSampler<P, M> {
    points: P,
    options: M,
}

impl<P: PointSet, M: SamplingMethod> MethodSampler<P, M> {
    /// The sampler with these points and the default parameters.
    pub fn new(points: P) -> Self {
        Self { points, options: M::default() }
    }

    /// The sampler with these points and parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn with_options(points: P, options: M) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self { points, options })
    }
}

impl<P: PointSet, M: SamplingMethod> Sampler for MethodSampler<P, M> {
    fn name(&self) -> &str {
        M::NAME
    }

    fn describe(&self) -> String {
        format!("{}:{}", M::NAME, self.options.describe())
    }

    fn rounds(&self) -> Option<u32> {
        self.options.number_of_rounds()
    }

    fn needs(&self) -> Needs {
        self.options.needs()
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        self.options.recorders()
    }

    fn memory(&self, frame: &Frame, needs: &Needs, _: &Limits) -> SamplerMemory {
        self.options.planning(frame, needs)
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        seen.film.require(M::NAME, &self.needs())?;
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let first = first_samples(seen, self.options.pilot_samples(seen.budget.total / seen.pixels() as u64));
        if !plan_first(seen, first, plan) {
            self.options.refine(seen, first, plan)?;
        }
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }
}

/// A rule that makes an image from the statistics of a film.
pub trait FilterMethod: Options + Copy + Send + Sync {
    /// The filter's name.
    const NAME: &'static str;

    /// The statistics that the rule reads.
    fn needs(&self) -> Needs {
        Needs::none().with_variance()
    }

    /// The recorders of statistics that the rule reads.
    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        Vec::new()
    }

    /// The memory in which the image is made.
    fn applying(&self, frame: &Frame) -> FilterMemory;

    /// The image of a film that records what the rule reads.
    ///
    /// # Errors
    ///
    /// If the film lacks words of a recorder.
    fn image(&self, film: &Film) -> Result<Filtered, Error>;
}

/// A filter of a rule with options.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MethodFilter<M> {
    options: M,
}

impl<M: FilterMethod> MethodFilter<M> {
    /// The filter with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn with_options(options: M) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self { options })
    }
}

impl<M: FilterMethod> Filter for MethodFilter<M> {
    fn name(&self) -> &str {
        M::NAME
    }

    fn describe(&self) -> String {
        format!("{}:{}", M::NAME, self.options.describe())
    }

    fn needs(&self) -> Needs {
        self.options.needs()
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        self.options.recorders()
    }

    fn memory(&self, frame: &Frame, _: &Needs) -> FilterMemory {
        self.options.applying(frame)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(M::NAME, &self.needs())?;
        self.options.image(film)
    }
}

/// A rule that makes an image from single samples and their coordinates.
pub trait SamplesMethod: Options + Copy + Send + Sync {
    /// The filter's name.
    const NAME: &'static str;

    /// The samples that the rule reads.
    const READS: Singles = Singles::ALL;

    /// The dimensions that the rule reads; all by default.
    fn dimensions(&self, domain: &Domain) -> Domain {
        domain.clone()
    }

    /// Refuses points that the rule cannot use.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for such points.
    fn check(&self, points: &FilmPoints) -> Result<(), Error> {
        let _ = points;
        Ok(())
    }

    /// The bytes per pixel in which the image is made.
    fn bytes(&self) -> usize {
        12
    }

    /// The image of these samples.
    fn image(&self, samples: &FilmSamples<'_>, points: &FilmPoints) -> Filtered;
}

/// A filter of single samples: a rule with options, and the points of the samples.
#[derive(Clone, Debug)]
pub struct SamplesFilter<M> {
    points: FilmPoints,
    options: M,
}

impl<M: SamplesMethod> SamplesFilter<M> {
    /// The filter for films with these points.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range, and for points that the method cannot use.
    pub fn new(points: FilmPoints, options: M) -> Result<Self, Error> {
        options.check_ranges()?;
        options.check(&points)?;
        let domain = options.dimensions(points.domain());
        Ok(Self { points: points.with_domain(domain), options })
    }
}

impl<M: SamplesMethod> Filter for SamplesFilter<M> {
    fn name(&self) -> &str {
        M::NAME
    }

    fn describe(&self) -> String {
        format!("{}:{}", M::NAME, self.options.describe())
    }

    fn needs(&self) -> Needs {
        M::READS.needs()
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        M::READS.list()
    }

    fn memory(&self, frame: &Frame, _: &Needs) -> FilterMemory {
        FilterMemory::new(frame, self.options.bytes(), ImagePlanes::Radiance)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(M::NAME, &self.needs())?;
        Ok(self.options.image(&M::READS.of(film, M::NAME)?, &self.points))
    }
}
