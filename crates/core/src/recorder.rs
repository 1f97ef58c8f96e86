//! Statistics that a single method records, in addition to those of every film.

use crate::{Error, Estimate, Film};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

/// Statistics that one sampler or filter records for itself, as a list of 32-bit words per pixel in the film.
///
/// A film has one list per pixel and half, and separate lists for [discarded](crate::plan::Retention::Discard) samples.
/// Tiles, checkpoints and parts contain the lists of their pixels.
/// [`Sampler::recorders`](crate::Sampler::recorders) and [`Filter::recorders`](crate::Filter::recorders) return the
/// recorders; [`Film::recorded`](crate::Film::recorded) returns the words of a pixel.
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
    /// The name, with all parameters. Recorders of the same name must record the same statistics.
    fn name(&self) -> &str;

    /// Adds a sample to the words of its pixel, which are empty at first. Called for every sample, in the order of the
    /// pixel's samples.
    fn record(&self, words: &mut Vec<u32>, sample: &RecordedSample<'_>);

    /// Reserves room for `more` samples of a pixel, before they are traced. The default does nothing.
    fn reserve(&self, words: &mut Vec<u32>, more: u64) {
        let _ = (words, more);
    }

    /// The bytes of a pixel's words after `samples` samples, for memory forecasts.
    fn bytes(&self, samples: u64) -> u64;
}

/// A sample that is passed to a [`Recorder`].
#[non_exhaustive]
pub struct RecordedSample<'a> {
    /// The number of samples in the pixel, or in its half in a film with halves. Includes this one.
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
    /// One recorder per name. Empty in a film read from bytes, until a render resumes it.
    #[serde(skip)]
    pub(crate) active: Vec<Arc<dyn Recorder>>,
}

impl Recorders {
    /// Collects recorders, without repeating a name.
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
    /// Sets the recorders of a film read from bytes, in the order of the film's names.
    ///
    /// # Errors
    ///
    /// [`Error::OtherRender`] if the names of the film's recorders differ from those of `given`.
    pub(crate) fn resume_recorders(&mut self, given: Vec<Arc<dyn Recorder>>) -> Result<(), Error> {
        let given = Recorders::new(given);
        let found = self.recorders.names.iter().filter_map(|name| Some(given.active[given.position(name)?].clone()));
        let active: Vec<_> = found.collect();
        if active.len() != self.recorders.names.len() || active.len() != given.names.len() {
            let what = format!(
                "its recorders are {:?}, not {:?}; use the sampler and the filter of the saved render",
                self.recorders.names, given.names
            );
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
