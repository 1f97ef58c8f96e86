//! Dapple puts Monte Carlo samples where an image needs them.
//!
//! This crate re-exports the parts, so that one dependency is enough:
//!
//! * [`core`]: the one plug. Point sets, samplers, integrators, filters, films, exact budgets, the render
//!   loop. Depend on it alone (as `dapple-core`) to use Dapple in a renderer of your own: it knows no
//!   geometry, no scene and no image file.
//! * [`low_discrepancy`] (feature `low-discrepancy`): Owen-scrambled Sobol', Halton, (0,2), stratified and
//!   independent points.
//! * [`adaptive`] (feature `adaptive`): the error-driven sampler, its variance preset, the stopping rule of Cycles.
//! * [`mitchell`] (feature `mitchell`): Mitchell's contrast-adaptive sampler, and pbrt-v2's.
//! * [`clustering`] (feature `clustering`): slices of triangles in, clusters out.
//! * [`cluster_adaptive`] (feature `cluster-adaptive`): sample counts from the projected sizes of clusters,
//!   through a closure that finds first hits.
//! * [`light_selection`] (feature `light-selection`): learned probabilities of lights.
//! * [`denoise`] (feature `denoise`): filters that are right under unequal sample counts.
//! * [`metrics`] (feature `metrics`): how wrong an image is.
//! * [`geometry`] (feature `geometry`): watertight rays.
//! * [`scene`] (feature `scene`): scene descriptions, pbrt and model readers, image files, bundled scenes.
//! * [`renderer`] (feature `renderer`): lights, materials, integrators.
//! * [`job`] (feature `job`): one render from description to image; samplers, point sets and filters by name;
//!   checkpoints and shards.
//! * `study` (feature `study`, not by default): what accuracy costs in time.
//!
//! `examples/foreign_renderer.rs` is a renderer that shares nothing with Dapple's own but these parts.
//!
//! # Example
//!
//! An integrator is anything that turns coordinates into radiance. This one is a soft shadow's edge; the
//! sampler finds it and puts its samples there.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use dapple::adaptive::Adaptive;
//! use dapple::core::{Block, Draws, Estimate, Frame, Integrator, Limits, Render, TrainingLog};
//! use dapple::low_discrepancy::Sobol;
//!
//! const PLACE: Block = Block::new(0);
//!
//! struct Penumbra;
//!
//! impl Integrator for Penumbra {
//!     fn estimate(&self, draws: &Draws<'_>, _: &mut TrainingLog) -> Estimate {
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

#[cfg(feature = "adaptive")]
pub use dapple_adaptive as adaptive;
#[cfg(feature = "cluster-adaptive")]
pub use dapple_cluster_adaptive as cluster_adaptive;
#[cfg(feature = "clustering")]
pub use dapple_clustering as clustering;
#[cfg(feature = "denoise")]
pub use dapple_denoise as denoise;
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
#[cfg(feature = "renderer")]
pub use dapple_renderer as renderer;
#[cfg(feature = "scene")]
pub use dapple_scene as scene;
#[cfg(feature = "study")]
pub use dapple_study as study;

/// The programs of the README and of the tutorial.
#[cfg(all(doctest, feature = "adaptive", feature = "denoise", feature = "low-discrepancy"))]
mod pages {
    #[doc = include_str!("../README.md")]
    struct Readme;
    #[doc = include_str!("../docs/book/src/writing-a-sampler.md")]
    struct WritingASampler;
    #[doc = include_str!("../docs/book/src/your-renderer.md")]
    struct YourRenderer;
}
