//! What accuracy costs in time: samplers x filters x budgets x seeds over scenes, with intervals, and a report.
//!
//! A [`Draft`] says what is wanted, from words or a TOML file; [`Draft::resolve`] makes a checked [`Plan`] of it. A
//! [`Study`] makes the plan's runs in a folder: each is the public [`dapple_core::render`] and a filter, timed without
//! anybody looking on, and measured against a reference. Each finished [`Run`] is a line of `runs.jsonl`, on the disk
//! before the next begins; a study that was killed goes on where it was when it is opened again with the same plan.
//! [`write_report`] makes `summary.csv` and `report.html` of what is there, finished or not.
//!
//! ```
//! use dapple_study::{Draft, InProcess, ScenePlan, Sitting, Study};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! let draft = Draft {
//!     scenes: Some(vec![ScenePlan::from("cornell")]),
//!     samplers: Some(vec!["variance".into()]),
//!     filters: Some(vec!["none".into()]),
//!     spp: Some(vec![2, 4]),
//!     seeds: Some(vec![1, 2]),
//!     reference_spp: Some(16),
//!     resolution: Some([8, 8]),
//!     ..Draft::default()
//! };
//! let plan = draft.resolve()?;
//! let mut study = Study::open(plan, folder.path(), &Sitting::default(), &mut ())?.expect("nobody stopped it");
//! study.run(&mut InProcess::new(|| None), &mut ())?;
//! // Two methods, the baseline uniform/sobol/none being added; two budgets and the time of one of them; two seeds.
//! assert_eq!(study.runs().len(), 2 * 3 * 2);
//! # Ok(())
//! # }
//! ```

/// The README's example is tested.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod digest;
mod error;
mod external;
pub mod folder;
mod ledger;
mod plan;
pub mod record;
mod references;
pub mod report;
mod run;
mod shot;
mod study;
mod subject;
pub mod summary;
mod truth;

pub use digest::Digest;
pub use error::StudyError;
pub use external::External;
pub use ledger::{Ledger, Store};
pub use plan::{
    DEFAULT_FILTERS, DEFAULT_REFERENCE_SPP, DEFAULT_SAMPLERS, DEFAULT_SCENES, DEFAULT_SEEDS, DEFAULT_SIDE, DEFAULT_SPP,
    Draft, Plan, PlanError, ScenePlan, split_words,
};
pub use record::{Budget, Errors, Machine, Manifest, Method, Phases, Reference, Run, SceneRecord};
pub use report::{ReportError, write_report};
pub use run::{InProcess, Job, Processes, Runner};
pub use study::{Ended, Onlooker, Progress, Sitting, Study};
pub use subject::{Subject, View};
pub use summary::Summary;
