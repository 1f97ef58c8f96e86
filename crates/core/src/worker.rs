//! Memory of one task of the render loop: scratch memory, splats, training notes.

use crate::integrator::TrainingSum;
use std::any::Any;

/// The memory of one task of the render loop, passed to [`Integrator::estimate`](crate::Integrator::estimate).
///
/// * [`Worker::scratch`]: memory of any type, reused by later samples and tasks.
/// * [`Worker::splat`]: light that this sample adds to other pixels.
/// * [`Worker::note`]: training data.
///
/// ```
/// use dapple_core::{Draws, Estimate, Integrator, Worker};
///
/// /// A tracer with a stack that keeps its memory from sample to sample.
/// struct Tracer;
///
/// impl Integrator for Tracer {
///     fn estimate(&self, _: &Draws<'_>, worker: &mut Worker) -> Estimate {
///         let stack: &mut Vec<u32> = worker.scratch();
///         stack.clear();
///         stack.push(0);
///         Estimate::new([stack.len() as f32; 3])
///     }
/// }
/// ```
#[derive(Debug, Default)]
pub struct Worker {
    pub(crate) notes: Vec<(u64, f32)>,
    scratch: Option<Box<dyn Any + Send>>,
    /// The splats of the last sample.
    pub(crate) splats: Vec<([u32; 2], [f32; 3])>,
}

impl Worker {
    /// A value of type `T` for this task alone: `T::default()`, or the value that any earlier sample or task left. Estimates
    /// must not depend on what was left. A request for another type drops the value.
    #[inline]
    pub fn scratch<T: Any + Send + Default>(&mut self) -> &mut T {
        if !self.scratch.as_ref().is_some_and(|s| s.is::<T>()) {
            self.scratch = Some(Box::<T>::default());
        }
        self.scratch.as_mut().and_then(|s| s.downcast_mut()).expect("the value was made above")
    }

    /// Adds light of this sample to another pixel, at column and row of the full image: light of a path that starts at a
    /// light source, for example.
    ///
    /// A pixel's radiance is the mean of its own samples plus `S P / N`, where `S` is the sum of its splats, `P` the number
    /// of pixels of the full image, and `N` the number of all kept samples. In films with halves, this holds for each half.
    ///
    /// Splats outside the frame's window are dropped. Splats that are NaN, infinite, negative or above 9e17 are rejected,
    /// and the sample is listed. Without [`Needs::splats`](crate::Needs::with_splats), splats are ignored.
    #[inline]
    pub fn splat(&mut self, pixel: [u32; 2], radiance: [f32; 3]) {
        self.splats.push((pixel, radiance));
    }

    /// Notes `value` under `key` as training data. NaN and infinite values are dropped.
    #[inline]
    pub fn note(&mut self, key: u64, value: f32) {
        if value.is_finite() {
            self.notes.push((key, value));
        }
    }

    /// Returns the sums of the notes by key, added in the order of noting, and clears the notes.
    pub(crate) fn summarise(&mut self) -> Vec<TrainingSum> {
        self.notes.sort_by_key(|n| n.0);
        let mut sums: Vec<TrainingSum> = Vec::new();
        for &(key, value) in &self.notes {
            let value = f64::from(value);
            let note = TrainingSum { key, count: 1, sum: value, sum_of_squares: value * value };
            match sums.last_mut() {
                Some(last) if last.key == key => last.add(&note),
                _ => sums.push(note),
            }
        }
        self.notes.clear();
        sums
    }
}
