#![doc = include_str!("../README.md")]
//!
//! A [`Plan`] holds the [`Method`]s, [`Study`] performs the [`Run`]s in a folder, and [`write_report`] writes the report and
//! the tables.

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
