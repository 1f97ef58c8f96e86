//! A source of wall-clock time.

use std::sync::Arc;
use std::time::Instant;

/// A function that returns wall-clock time in seconds since a fixed moment, or always 0 ([`Clock::none`]).
///
/// ```
/// use dapple_core::Clock;
///
/// let clock = Clock::new(|| 2.5); // In a browser, performance.now() / 1000.
/// assert_eq!(clock.seconds(), 2.5);
/// assert!(!Clock::none().runs());
/// ```
#[derive(Clone, Default)]
pub struct Clock(Option<Arc<dyn Fn() -> f64 + Send + Sync>>);

impl Clock {
    /// A clock that shows the seconds since any fixed moment.
    pub fn new(seconds: impl Fn() -> f64 + Send + Sync + 'static) -> Self {
        Self(Some(Arc::new(seconds)))
    }

    /// A clock that always reads 0.
    pub fn none() -> Self {
        Self(None)
    }

    /// The machine's clock; [`Clock::none`] on `wasm32-unknown-unknown`, a target without a clock.
    pub fn of_machine() -> Self {
        if cfg!(all(target_family = "wasm", target_os = "unknown")) {
            return Self::none();
        }
        let start = Instant::now();
        Self::new(move || start.elapsed().as_secs_f64())
    }

    /// Returns `true` if the clock tells time, that is, unless it is [`Clock::none`].
    pub fn runs(&self) -> bool {
        self.0.is_some()
    }

    /// The current reading in seconds.
    pub fn seconds(&self) -> f64 {
        self.0.as_ref().map_or(0.0, |seconds| seconds())
    }
}
