//! Studies of error against render time: samplers x point sets x filters x budgets x seeds over scenes.
//!
//! A sampler decides how many samples each pixel gets. A point set decides where they lie (pbrt and Mitsuba call this
//! the sampler). A filter is a denoiser. The three together are a [`Method`].
//!
//! 1. [`PlanPatch`] holds settings, from code or a TOML file; [`PlanPatch::resolve`] checks them and adds the defaults.
//! 2. [`Study`] makes the runs of the [`Plan`] in a folder. Each [`Run`] is a [`dapple_core::Render`] followed by a
//!    filter. It is timed without progress reports, and its image is compared with a reference.
//! 3. Each finished run is a line of `runs.jsonl`, on the disk before the next run begins. A stopped study resumes when
//!    it is opened again with the same plan.
//! 4. [`write_report`] makes `report.html`, tables, plots, and files for LaTeX, pandas and image viewers, of a finished or
//!    an unfinished study.
//!
//! ```
//! use dapple_study::{InProcess, PlanPatch, ScenePlan, Study, StudyOptions, write_report};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! let plan = PlanPatch::default()
//!     .scenes(vec![ScenePlan::from("cornell")])
//!     .samplers(vec!["variance".into()])
//!     .filters(vec!["none".into()])
//!     .spp(vec![2, 4])
//!     .seeds(vec![1, 2])
//!     .reference_spp(16)
//!     .resolution([8, 8])
//!     .resolve()?;
//! let mut study = Study::open(plan, folder.path(), &StudyOptions::default(), &mut ())?.expect("not stopped");
//! study.run(&mut InProcess::new(|| None), &mut ())?;
//! // Two methods, as the baseline uniform/sobol/none is added; two budgets and one equal time; two seeds.
//! assert_eq!(study.runs().len(), 2 * 3 * 2);
//! let summary = write_report(folder.path())?;
//! assert!(folder.path().join("report.html").is_file() && !summary.rows().is_empty());
//! # Ok(())
//! # }
//! ```

/// Runs the README's examples as documentation tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod error;
mod external;
mod file_names;
mod measured_image;
mod plan;
mod point_plots;
mod record;
mod recorded_study;
mod reference_image;
mod references;
mod report;
mod run_log;
mod runner;
mod study;
mod study_scene;
pub mod summary;

pub use error::StudyError;
pub use external::External;
pub use plan::{
    DEFAULT_FILTERS, DEFAULT_REFERENCE_SPP, DEFAULT_SAMPLERS, DEFAULT_SCENES, DEFAULT_SEEDS, DEFAULT_SIDE, DEFAULT_SPP,
    Plan, PlanError, PlanPatch, ScenePlan, default_lights, split_names,
};
pub use point_plots::{PLOTTED_COUNTS, PointPlots, point_plots};
pub use record::{ImageErrors, Machine, Manifest, Method, Phases, ReferenceRecord, Run, RunBudget, SceneRecord};
pub use recorded_study::{FolderError, RecordedStudy};
pub use report::{ReportError, write_report};
pub use run_log::RunStore;
pub use runner::{InProcess, Processes, RunRequest, Runner};
pub use study::{Study, StudyMonitor, StudyOptions, StudyProgress, StudyStatus, merge_studies};
pub(crate) use study_scene::Subject;
pub use study_scene::View;
pub use summary::Summary;
