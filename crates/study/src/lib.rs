//! What accuracy costs in time: samplers x filters x budgets x seeds over scenes, with intervals, and a report.

pub mod record;

pub use record::{Budget, Errors, Machine, Manifest, Method, Phases, Reference, Run, SceneRecord};
