//! What accuracy costs in time: samplers x filters x budgets x seeds over scenes, with intervals, and a report.

pub mod folder;
pub mod record;
pub mod report;
pub mod summary;

pub use record::{Budget, Errors, Machine, Manifest, Method, Phases, Reference, Run, SceneRecord};
pub use report::{ReportError, write_report};
pub use summary::Summary;
