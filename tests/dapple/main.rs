//! The workspace as a whole: its layout, pages, examples, hard cases, and what methods promise on scenes.

mod dependency_gate;
mod docs;
mod examples;
mod hard_cases;
mod honest;
mod price;
mod session;
mod video;
