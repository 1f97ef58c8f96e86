//! Studies of error against render time: samplers x point sets x filters x budgets x seeds over scenes.
//!
//! A sampler decides how many samples each pixel gets. A point set decides where they lie (pbrt and Mitsuba call this
//! the sampler). A filter is a denoiser. The three together are a [`Method`].
//!
//! 1. [`Plan`] is read from a TOML file or made of [`PlanSettings`], which are checked.
//! 2. [`Study`] makes the runs of the plan in a folder. Each [`Run`] is a [`dapple_core::Render`] followed by a filter.
//!    It is timed without progress reports, and its image is compared with a reference by all
//!    [metrics](dapple_metrics::METRICS).
//! 3. Each finished run is a line of `runs.jsonl`, on the disk before the next run begins. A stopped study resumes when
//!    it is opened again with the same plan.
//! 4. [`write_report`] makes `report.html`, and tables as CSV, of a finished or an unfinished study.
//!
//! ```
//! use dapple_study::{InProcess, Plan, Study, StudyOptions, write_report};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! let plan = r#"
//!     scenes = ["cornell"]
//!     samplers = ["variance"]
//!     filters = ["none"]
//!     spp = [2, 4]
//!     seeds = 2
//!     reference_spp = 16
//!     resolution = [8, 8]
//! "#;
//! let plan = Plan::parse(plan, "plan.toml".as_ref(), &[])?;
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
mod plan;
mod record;
mod records;
mod reference;
mod report;
mod runner;
mod scene;
mod study;
pub mod summary;

pub use error::StudyError;
pub use external::External;
pub use plan::{Plan, PlanError, PlanSettings, ScenePlan};
pub use record::{ImageErrors, Machine, Manifest, Method, Phases, ReferenceRecord, Run, RunBudget, SceneRecord};
pub use records::RecordedStudy;
pub use report::write_report;
pub use runner::{InProcess, Processes, RunRequest, Runner};
pub use scene::View;
pub use study::{Study, StudyMonitor, StudyOptions, StudyProgress, StudyStatus};
pub use summary::Summary;
