//! The core of Dapple: traits for point sets, samplers, integrators and filters, and the render loop that joins them.
//!
//! | role | trait | decides |
//! |---|---|---|
//! | point set (pbrt and Mitsuba call this the sampler) | [`PointSet`] | the random numbers of a sample: a pure function of its identity |
//! | sampler | [`Sampler`] | the number of samples per pixel, between rounds |
//! | integrator | [`Integrator`] | the radiance of one sample, and its first hit |
//! | filter (the denoiser; not the pixel filter) | [`Filter`] | an image from a [`Film`], and its error per pixel |
//!
//! [`Render`] alternates between planning and tracing until the [`Limits`] are met:
//!
//! ```
//! # use dapple_core::{PointSet, SampleId};
//! # struct Golden;
//! # impl PointSet for Golden {
//! #     fn describe(&self) -> String { "golden".into() }
//! #     fn block(&self, id: SampleId, _: u32) -> [f32; 4] { [(id.index as f32 * 0.618_034).fract(); 4] }
//! #     fn capacity(&self) -> u64 { 1 << 20 }
//! # }
//! use dapple_core::samplers::Uniform;
//! use dapple_core::{Block, Draws, Estimate, Filter, Frame, Integrator, Limits, Render, Worker, Unfiltered};
//!
//! const PLACE: Block = Block::new(0);
//!
//! /// A grey image: half of each pixel is lit.
//! struct Half;
//!
//! impl Integrator for Half {
//!     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
//!         let [u, ..] = draws.block(PLACE);
//!         Estimate::new(if u < 0.5 { [1.0; 3] } else { [0.0; 3] })
//!     }
//! }
//!
//! let points = Golden; // A real one is dapple_low_discrepancy::Sobol::new(7).
//! let frame = Frame::new(16, 9)?;
//! let film = Render::new(frame, &Limits::samples(64 * 16 * 9)).run(&mut Half, &mut Uniform::new(points))?;
//! let image = Unfiltered.apply(&film)?;
//! assert!(image.radiance.iter().all(|rgb| (rgb[0] - 0.5).abs() < 0.05));
//! # Ok::<(), dapple_core::Error>(())
//! ```
//!
//! # Guarantees
//!
//! * The image does not depend on the number of threads, on tiles, or on the division of a round into stages and parts.
//! * Sample counts add up to the budget exactly, or an [`Error`] gives the reason.
//! * A sample that is NaN, infinite or negative is rejected: it counts as a black sample, and can be replayed.
//!
//! # Limits
//!
//! * No geometry, scene or image file: all public items use `[f32; 3]`, slices and numbers.
//! * No sampling of arbitrary densities. Each use of randomness names its [`Block`], or takes the next number of a cursor,
//!   [`Draws::rng`].
//! * Each estimate belongs to one pixel. Pixel filters wider than a pixel are sampled by the integrator.

mod allocate;
mod clock;
pub mod container;
mod draws;
mod error;
pub mod film;
pub mod filter;
mod frame;
pub mod integrator;
pub mod limits;
mod macros;
mod memory;
mod moments;
mod needs;
pub mod options;
pub mod parallel;
pub mod plan;
pub mod point_set;
mod recorder;
pub mod render;
mod rng;
mod sampler;
pub mod samplers;
mod snapshot;
mod worker;

pub use clock::Clock;
pub use draws::{Block, Draws};
pub use error::Error;
#[doc(inline)]
pub use film::Film;
#[doc(inline)]
pub use filter::{Filter, Filtered, Unfiltered};
pub use frame::Frame;
#[doc(inline)]
pub use integrator::{Estimate, FirstHit, Integrator, PathRecord, SurfaceFeatures};
#[doc(inline)]
pub use limits::{InvalidSample, Limits};
pub use needs::Needs;
#[doc(inline)]
pub use point_set::{HostNumbers, PointSet, SampleId};
#[doc(inline)]
pub use render::{Methods, Render, Round, Session, Tile};
pub use rng::{OwnedRng, Rng};
pub use sampler::Sampler;
pub use snapshot::Snapshot;
pub use worker::Worker;

/// The README's example, run as a doctest.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;
