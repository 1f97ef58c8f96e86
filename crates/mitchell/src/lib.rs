//! Mitchell's contrast-adaptive sampler, and pbrt-v2's variant of it.
//!
//! Both samplers start with a first rate in every pixel and measure how much the samples differ. Pixels where they differ most
//! are sampled at a second rate:
//!
//! * [`Mitchell`]: contrast `(max - min) / (max + min)` per channel over 3x3 pixels, after Mitchell 1987;
//! * [`MitchellPbrt`]: deviation in luminance from the pixel's own mean, or different shapes, as in pbrt-v2.
//!
//! ```
//! use dapple_core::{Block, Draws, Estimate, Frame, Integrator, Limits, Render, Worker};
//! use dapple_low_discrepancy::Sobol;
//! use dapple_mitchell::Mitchell;
//!
//! /// Black to the left of a slanted edge, white to its right.
//! struct Edge;
//!
//! impl Integrator for Edge {
//!     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
//!         let [x, y] = draws.pixel().map(|n| n as f32);
//!         let [u, v, ..] = draws.block(Block::new(0));
//!         let white = x + u > 8.0 + 0.3 * (y + v);
//!         Estimate::new([f32::from(u8::from(white)); 3])
//!     }
//! }
//!
//! let frame = Frame::new(32, 32)?;
//! let mut sampler = Mitchell::new(Sobol::new(7));
//! let limits = Limits::samples(8 * 32 * 32);
//! let film = Render::new(frame, &limits).run(&mut Edge, &mut sampler)?;
//! // Four samples in flat pixels; 4 + 6 and more at the edge, until the budget is met exactly.
//! assert_eq!(film.record().samples, 8 * 32 * 32);
//! assert!(film.counts().iter().all(|&n| n >= 4));
//! assert!(film.count(16 * 32 + 13) >= 10);
//! # Ok::<(), dapple_core::Error>(())
//! ```
//!
//! # Guarantees
//!
//! * [`Stopping::Budget`] spends the budget exactly, and [`Stopping::Threshold`] never exceeds it. At most one pixel has a
//!   count other than the two rates.
//! * If the budget allows it, no pixel has fewer samples in the image than the first rate.
//! * [`PilotPolicy`] documents the bias of each use of the pilot samples. Each closed form is tested, with the biased policies
//!   as controls that the test must reject.
//!
//! # Limits
//!
//! * Contrast does not measure error: it never falls as samples are added. Of pixels with uniform noise of 29 % (`[0.5, 1.5]`
//!   times the mean), 18 % are refined with 2 samples each, 99.4 % with 16, and all with contrast over 3x3 pixels of 4 samples.
//!   The result is then uniform sampling, except for a few pixels.
//! * A pilot that sees no light has no contrast. A light that 1 sample in 1000 sees is missed by 99.6 % of pilots of 4 samples,
//!   and in 96.5 % of windows of 3x3 pixels.
//! * The staged filters of Mitchell's paper are not included.

mod extrema;
mod mitchell;
mod pbrt;
mod two_rates;

pub use dapple_core::plan::{PilotPolicy, Stopping};

pub use extrema::{Extrema, Extremes, FilmExtrema, contrast, deviation};
pub use mitchell::{Mitchell, MitchellOptions};
pub use pbrt::{MitchellPbrt, MitchellPbrtOptions, PbrtTest};
pub use two_rates::{Rates, Rule, TwoRates};

/// Runs the README's example as a documentation test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;
