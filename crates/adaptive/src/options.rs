//! The parameters of the sampler that follows the error.

use crate::{CellOptions, PoolShape};
use dapple_core::{Error, Film, Needs, PilotPolicy};

/// The parameters of [`Adaptive`](crate::Adaptive).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdaptiveOptions {
    /// Samples per pixel of the pilot; 0 takes 4, or the rung at a quarter of the mean budget where that is more.
    /// At least 2 otherwise, and 4 with [`PilotPolicy::Cross`], whose halves must each know a variance.
    pub pilot: u32,
    /// Into how many rounds the rest of the budget is cut, each planned from all samples before it; 0 takes 3 where the
    /// pilot is kept, else 1, since more would leave nothing unbiased.
    pub rounds: u32,
    /// Over what variance is pooled.
    pub pool: PoolShape,
    /// The window of the pool is `2 radius + 1` pixels squared.
    pub radius: u32,
    /// The pool's weight beside a pixel's own degrees of freedom.
    pub prior: f64,
    /// What is pooled is this power of the variance: see [`Pooling::power`](crate::Pooling::power).
    pub power: f64,
    /// Weight of what geometry says, in degrees of freedom as well; 0 leaves it out.
    pub geometry: f64,
    /// Errors are taken to fall as `n^-exponent`.
    pub exponent: f64,
    /// Errors are relative to `mean^2 + epsilon`.
    pub epsilon: f64,
    /// No pixel gets more than this many times the mean count.
    pub cap: f64,
    /// Share of a filter's error map in the score, the rest being the pixel's own variance, in a geometric mean.
    pub mix: f64,
    /// Counts are uniform where they promise no less than this share of the error of uniform ones; 1 adapts always.
    pub gain: f64,
    /// What becomes of the pilot.
    pub policy: PilotPolicy,
    /// What makes a cell, where cells are asked for.
    pub cells: CellOptions,
}

impl Default for AdaptiveOptions {
    /// What won by ablation on bundled scenes (docs/results/cluster.md).
    fn default() -> Self {
        Self {
            pilot: 0,
            rounds: 0,
            pool: PoolShape::Window,
            radius: 2,
            prior: 12.0,
            power: 2.0,
            geometry: 0.0,
            exponent: 1.15,
            epsilon: 0.01,
            cap: 6.0,
            mix: 0.5,
            gain: 0.98,
            policy: PilotPolicy::Keep,
            cells: CellOptions::default(),
        }
    }
}

impl AdaptiveOptions {
    /// Rounds after the pilot.
    pub(crate) fn rounds(&self) -> u32 {
        match (self.rounds, self.policy) {
            (0, PilotPolicy::Keep) => 3,
            (0, _) => 1,
            (rounds, _) => rounds,
        }
    }

    /// Whether first hits are read: for cells, or for what geometry says.
    pub(crate) fn look_at_hits(&self) -> bool {
        self.pool != PoolShape::Window || self.geometry > 0.0
    }

    /// Says beforehand what a sampler would refuse of them.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`].
    pub fn check(&self) -> Result<(), Error> {
        let out = |name, value: String, allowed| Err(Error::OutOfRange { name, value, allowed });
        if self.pilot == 1 {
            return out("pilot", "1".into(), "two samples or more have a variance; 0 chooses");
        }
        if self.policy == PilotPolicy::Cross && self.pilot != 0 && self.pilot < 4 {
            return out("pilot", self.pilot.to_string(), "each of the two halves needs two samples; 0 chooses");
        }
        if self.rounds > 64 {
            return out("rounds", self.rounds.to_string(), "1 to 64; 0 chooses");
        }
        if self.radius > 64 {
            return out("radius", self.radius.to_string(), "at most 64 pixels");
        }
        if self.prior.is_nan() || self.prior < 0.0 {
            return out("prior", self.prior.to_string(), "a weight of 0 or more, or inf");
        }
        if !(self.power > 0.0 && self.power <= 4.0) {
            return out("power", self.power.to_string(), "above 0 and at most 4");
        }
        if !(self.geometry >= 0.0 && self.geometry.is_finite()) {
            return out("geometry", self.geometry.to_string(), "a weight of 0 or more");
        }
        if !(self.exponent > 0.0 && self.exponent <= 3.0) {
            return out("exponent", self.exponent.to_string(), "the rate at which errors fall lies in (0, 3]");
        }
        if !(self.epsilon > 0.0 && self.epsilon.is_finite()) {
            return out("epsilon", self.epsilon.to_string(), "a number above zero");
        }
        if !(self.cap >= 1.0 && self.cap.is_finite()) {
            return out("cap", self.cap.to_string(), "at least 1");
        }
        if !(0.0..=1.0).contains(&self.mix) {
            return out("mix", self.mix.to_string(), "a share from 0 to 1");
        }
        if !(0.0..=1.0).contains(&self.gain) && self.gain != f64::INFINITY {
            return out("gain", self.gain.to_string(), "a share from 0 to 1, or inf");
        }
        if self.policy == PilotPolicy::Refined {
            return out("policy", "refined".into(), "keep, discard or cross");
        }
        if self.policy != PilotPolicy::Keep && self.rounds > 1 {
            return out(
                "rounds",
                self.rounds.to_string(),
                "1 unless the pilot is kept: the others would be biased too",
            );
        }
        if self.policy == PilotPolicy::Cross && self.look_at_hits() {
            return out("policy", "cross".into(), "keep or discard beside cells: a half's hits would decide on itself");
        }
        self.cells.check()
    }
}

/// Makes one number a pixel of a film: the expected squared error there, relative to what is shown.
pub type MapErrors = Box<dyn Fn(&Film) -> Result<Vec<f32>, Error> + Send>;

/// Where errors are known from besides a pixel's own variance: a filter that predicts its own.
pub struct ErrorMap {
    /// Its name in the sampler's description.
    pub name: String,
    /// What the film must record for it.
    pub needs: Needs,
    /// One number a pixel, row by row: the squared error that is left in the image made of this film, relative to the
    /// image squared, in any unit. What is negative or no number counts as none.
    pub of: MapErrors,
    /// The most memory that `of` takes, in bytes per pixel.
    pub bytes_per_pixel: usize,
}
