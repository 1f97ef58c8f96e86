//! Statistics that a method records for itself, beside those of a film.

use crate::{Error, Estimate, Film};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

/// Statistics of a sampler's or filter's own: the film keeps a list of words for each pixel, and the recorder fills it.
///
/// A film keeps one list per pixel and half, and others for [discarded](crate::plan::Retention::Discard) samples. Lists travel with the
/// pixel through tiles, checkpoints and machines. [`Sampler::recorders`](crate::Sampler::recorders) and
/// [`Filter::recorders`](crate::Filter::recorders) name what a method reads; [`Film::recorded`](crate::Film::recorded) finds it.
///
/// ```
/// use dapple_core::film::{Recorder, RecordedSample};
///
/// /// The largest red of each pixel.
/// struct Reddest;
///
/// impl Recorder for Reddest {
///     fn name(&self) -> &str {
///         "reddest"
///     }
///
///     fn record(&self, words: &mut Vec<u32>, sample: &RecordedSample<'_>) {
///         let red = sample.radiance[0];
///         match words.first_mut() {
///             Some(most) => *most = f32::from_bits(*most).max(red).to_bits(),
///             None => words.push(red.to_bits()),
///         }
///     }
///
///     fn bytes(&self, _: u64) -> u64 {
///         4
///     }
/// }
/// ```
pub trait Recorder: Send + Sync {
    /// The name, with all parameters: recorders of the same name record the same.
    fn name(&self) -> &str;

    /// Adds a sample to the words of its pixel, which are empty at first. Called for every sample, in the pixel's order.
    fn record(&self, words: &mut Vec<u32>, sample: &RecordedSample<'_>);

    /// Makes room for `more` samples of a pixel, before they are traced. The default makes none.
    fn reserve(&self, words: &mut Vec<u32>, more: u64) {
        let _ = (words, more);
    }

    /// The bytes of a pixel's words after some samples, for forecasts of memory.
    fn bytes(&self, samples: u64) -> u64;
}

/// A sample as a [`Recorder`] sees it.
#[non_exhaustive]
pub struct RecordedSample<'a> {
    /// The number of samples in the pixel's half, with this one.
    pub count: u64,
    /// The radiance that enters the film: black for a rejected sample.
    pub radiance: [f32; 3],
    /// The estimate as the integrator returned it.
    pub estimate: &'a Estimate,
}

/// The recorders of a film, by name.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct Recorders {
    pub(crate) names: Vec<String>,
    /// As many as names; none in a film read from bytes, until a render resumes it.
    #[serde(skip)]
    pub(crate) active: Vec<Arc<dyn Recorder>>,
}

impl Recorders {
    /// Unites recorders; each name occurs once.
    pub(crate) fn new(all: impl IntoIterator<Item = Arc<dyn Recorder>>) -> Self {
        let mut united = Self::default();
        for one in all {
            if united.position(one.name()).is_none() {
                united.names.push(one.name().to_owned());
                united.active.push(one);
            }
        }
        united
    }

    pub(crate) fn position(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }
}

impl Film {
    /// Gives the recorders of a film read from bytes, in the order of their names there.
    ///
    /// # Errors
    ///
    /// [`Error::OtherRender`] if the film has recorders that are not given, or lacks given ones.
    pub(crate) fn resume_recorders(&mut self, given: Vec<Arc<dyn Recorder>>) -> Result<(), Error> {
        let given = Recorders::new(given);
        let found = self.recorders.names.iter().filter_map(|name| Some(given.active[given.position(name)?].clone()));
        let active: Vec<_> = found.collect();
        if active.len() != self.recorders.names.len() || active.len() != given.names.len() {
            let what = format!("it recorded {:?} for its methods, not {:?}", self.recorders.names, given.names);
            return Err(Error::OtherRender { what });
        }
        self.recorders.active = active;
        Ok(())
    }
}

impl PartialEq for Recorders {
    fn eq(&self, other: &Self) -> bool {
        self.names == other.names
    }
}

impl fmt::Debug for Recorders {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.names.fmt(f)
    }
}
