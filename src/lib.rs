//! Adaptive sampling and denoising for any Monte Carlo renderer: more samples where an image needs them.
//!
//! Your renderer keeps its loop, its threads, its rays and its materials. A [`Session`] requests samples, takes their
//! results and makes the image:
//!
//! ```
//! use dapple::{Error, Estimate, FirstHit, Frame, Limits, Rng, Session};
//!
//! /// Your renderer: one sample of a pixel. Here a floor with tiles, under a lamp half hidden by a wall.
//! fn sample([column, row]: [u32; 2], rng: &mut Rng<'_>) -> Estimate {
//!     let [u, v] = rng.next_2d();
//!     let (x, y) = (column as f32 + u, row as f32 + v);
//!     let depth = 60.0 / (y + 1.0);
//!     let at = [(x - 32.0) * depth / 40.0, 0.0, depth];
//!     let albedo = [0.3 + 0.4 * (at[0].floor() + at[2].floor()).rem_euclid(2.0); 3];
//!     let lit = at[0] + 2.0 * rng.next_f32() > 0.5;
//!     let light = albedo.map(|a| if lit { a } else { 0.1 * a });
//!     Estimate::new(light).with_first_hit(FirstHit::new(at, [0.0, 1.0, 0.0], depth).with_albedo(albedo))
//! }
//!
//! # fn main() -> Result<(), Error> {
//! let session = Session::new(Frame::new(64, 48)?, Limits::spp(16.0), dapple::default_pair(7))?;
//! let image = session.run(|round| round.trace(|s| sample(s.pixel(), &mut s.rng())))?;
//! assert_eq!(image.radiance.len(), 64 * 48);
//! # Ok(())
//! # }
//! ```
//!
//! [`docs/book/src/your-renderer.md`](https://github.com/dapple-rs/dapple/blob/main/docs/book/src/your-renderer.md) is the guide, with five small
//! renderers. [`denoise`] filters finished images.
//!
//! # Features
//!
//! | feature | adds |
//! |---|---|
//! | `registry` (default) | [`default_pair`], and methods by name: [`points()`], [`sampler()`], [`filter()`] |
//! | `denoise` (default) | [`denoise()`] and the types of its arguments |
//! | `threads` (default) | loops on all threads, with rayon; without it, on the caller's thread, with bit-identical results |
//! | `classics` | published methods of adaptive sampling and reconstruction, by name |
//! | `oidn` | the filters `oidn` and `oidn-blend`: Intel Open Image Denoise, found at run time |
//! | `rand_core_0_10`, `rand_core_0_9`, `rand_core_0_6` | [`Rng`] is a generator of `rand` 0.10, 0.9, 0.8 |
//!
//! # Crates
//!
//! This crate re-exports what a host renderer needs. To write a sampler or a filter, or to use more of Dapple, depend on
//! one of these crates:
//!
//! | crate | contents |
//! |---|---|
//! | `dapple-core` | traits of samplers, point sets, integrators and filters; films, budgets and `Render`, which owns the loop |
//! | `dapple-low-discrepancy`, `dapple-adaptive`, `dapple-mitchell`, `dapple-cluster-adaptive`, `dapple-classics` | point sets and samplers |
//! | `dapple-denoise`, `dapple-oidn` | filters |
//! | `dapple-registry` | all methods by name, with the host's clusters |
//! | `dapple-clustering`, `dapple-light-selection`, `dapple-distributed`, `dapple-metrics` | clusters of triangles; learned light selection; renders by many processes; error metrics of images |
//! | `dapple-geometry`, `dapple-scene`, `dapple-renderer`, `dapple-transport`, `dapple-job`, `dapple-study` | the example renderer, its jobs and its studies |

#[doc(inline)]
pub use dapple_core::{
    Block, Clock, Draws, Error, Estimate, Film, Filter, Filtered, FirstHit, Frame, HostNumbers, InvalidSample, Limits,
    Methods, OwnedRng, PathRecord, PointSet, Rng, Round, SampleId, Sampler, Session, Snapshot, SurfaceFeatures, Tile,
};
#[cfg(feature = "denoise")]
#[doc(inline)]
pub use dapple_denoise::{
    Denoise, FireflyLight, SampleBuffers, Variance, Warning, denoise, denoise_whole, warnings_of,
};
#[cfg(feature = "registry")]
#[doc(inline)]
pub use dapple_registry::{default_pair, default_pair_with};

#[cfg(feature = "registry")]
mod methods;
#[cfg(feature = "registry")]
pub use methods::{filter, points, sampler};

/// Runs the examples of the README and of the tutorial pages as documentation tests.
#[cfg(all(doctest, feature = "registry"))]
mod pages {
    #[doc = include_str!("../README.md")]
    struct Readme;
    #[doc = include_str!("../docs/book/src/writing-a-sampler.md")]
    struct WritingASampler;
    #[doc = include_str!("../docs/book/src/your-renderer.md")]
    struct YourRenderer;
    #[doc = include_str!("../docs/book/src/denoise-buffers.md")]
    struct DenoiseBuffers;
}
