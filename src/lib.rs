//! Adaptive sampling for Monte Carlo rendering: more samples where an image needs them.
//!
//! This crate re-exports Dapple's library crates, so that one dependency is enough:
//!
//! * [`core`]: the interfaces of point sets, samplers, integrators and filters; films, exact budgets and the render
//!   loop. It contains no geometry, scenes or image files; to use Dapple in another renderer, `dapple-core` alone is
//!   enough.
//! * [`points()`], [`sampler()`], [`filter()`] and [`default_pair`]: methods by name; [`registry`] (feature `registry`):
//!   their tables, and clusters of a host. The default features are this one and those of the methods:
//!   * [`low_discrepancy`] (feature `low-discrepancy`): Owen-scrambled Sobol', Halton, (0,2), stratified,
//!     lattice and independent random point sets, and some that spread errors over pixels as blue noise.
//!   * [`adaptive`] (feature `adaptive`): the default sampler, driven by estimated errors; its variance preset; Cycles'
//!     stopping rule.
//!   * [`mitchell`] (feature `mitchell`): Mitchell's contrast-adaptive sampler, and the variant in pbrt-v2.
//!   * [`clustering`] (feature `clustering`): groups neighbouring triangles with similar normals into clusters.
//!   * [`cluster_adaptive`] (feature `cluster-adaptive`): a sampler with sample counts from the projected sizes of
//!     clusters; a closure that traces first hits connects it to a renderer.
//!   * [`denoise`](mod@denoise) (feature `denoise`): filters (denoisers) that take unequal sample counts into account.
//!
//! Off by default; the feature `full` has all of them but `oidn`:
//!
//! * `classics` (feature `classics`): published methods of adaptive sampling and reconstruction, for comparison.
//! * `distributed` (feature `distributed`): one render by many processes, with the bits of one.
//! * `light_selection` (feature `light-selection`): learned probabilities of selecting each of several lights.
//! * `metrics` (feature `metrics`): errors of images against references, and their statistics.
//! * `oidn` (feature `oidn`): Intel Open Image Denoise as a filter; its library is found at run time.
//! * `geometry` (feature `geometry`): ray tracing of triangles and other shapes, watertight at shared edges.
//! * `scene` (feature `scene`): scene descriptions, readers of pbrt and model files, image files, bundled scenes.
//! * `renderer` (feature `renderer`): lights, materials, integrators.
//! * `transport` (feature `transport`): integrators whose light starts at the lights.
//! * `job` (feature `job`): one render, from its description to its image; checkpoints and shards.
//! * `study` (feature `study`): measurements of error against render time, with a report.
//!
//! `examples/plugs` has five renderers that keep their loop, each with at most 15 lines for Dapple.
//! `examples/foreign_renderer.rs` connects clusters, sampler and denoiser to a renderer that shares no code with
//! Dapple.
//!
//! # Example
//!
//! An integrator maps a sample's random coordinates to radiance. This one computes the edge of a soft shadow; the
//! sampler finds the penumbra and takes most samples there.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use dapple::adaptive::Adaptive;
//! use dapple::core::{Block, Draws, Estimate, Frame, Integrator, Limits, Render, Worker};
//! use dapple::low_discrepancy::Sobol;
//!
//! const PLACE: Block = Block::new(0);
//!
//! struct Penumbra;
//!
//! impl Integrator for Penumbra {
//!     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
//!         let [u, _, lamp, _] = draws.block(PLACE);
//!         let x = draws.pixel()[0] as f32 + u;
//!         let lit = x + 16.0 * lamp > 40.0;
//!         Estimate::new([if lit { 1.0 } else { 0.0 }; 3])
//!     }
//! }
//!
//! let frame = Frame::new(64, 16)?;
//! let mut sampler = Adaptive::variance(Sobol::new(7));
//! let limits = Limits::samples(16 * 64 * 16);
//! let film = Render::new(frame, &limits).run(&mut Penumbra, &mut sampler)?;
//!
//! assert_eq!(film.record().samples, 16 * 64 * 16);       // the budget, exactly
//! assert!(film.count(32) > 2 * film.count(5));           // more in the penumbra than in the dark
//! # Ok(())
//! # }
//! ```

pub use dapple_core as core;
pub use dapple_core::{
    Block, Draws, Error, Estimate, Film, Filtered, FirstHit, Frame, HostNumbers, Integrator, Limits, Methods, Needs,
    OwnedRng, Render, Rng, Round, Session, Tile, Worker,
};

#[cfg(feature = "adaptive")]
pub use dapple_adaptive as adaptive;
#[cfg(feature = "classics")]
pub use dapple_classics as classics;
#[cfg(feature = "cluster-adaptive")]
pub use dapple_cluster_adaptive as cluster_adaptive;
#[cfg(feature = "clustering")]
pub use dapple_clustering as clustering;
#[cfg(feature = "denoise")]
pub use dapple_denoise as denoise;
#[cfg(feature = "denoise")]
pub use dapple_denoise::denoise;
#[cfg(feature = "distributed")]
pub use dapple_distributed as distributed;
#[cfg(feature = "geometry")]
pub use dapple_geometry as geometry;
#[cfg(feature = "job")]
pub use dapple_job as job;
#[cfg(feature = "light-selection")]
pub use dapple_light_selection as light_selection;
#[cfg(feature = "low-discrepancy")]
pub use dapple_low_discrepancy as low_discrepancy;
#[cfg(feature = "metrics")]
pub use dapple_metrics as metrics;
#[cfg(feature = "mitchell")]
pub use dapple_mitchell as mitchell;
#[cfg(feature = "oidn")]
pub use dapple_oidn as oidn;
#[cfg(feature = "registry")]
pub use dapple_registry::{self as registry, default_pair, default_pair_with};
#[cfg(feature = "renderer")]
pub use dapple_renderer as renderer;
#[cfg(feature = "scene")]
pub use dapple_scene as scene;
#[cfg(feature = "study")]
pub use dapple_study as study;
#[cfg(feature = "transport")]
pub use dapple_transport as transport;

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
