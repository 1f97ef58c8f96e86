//! The tests of the crate in one program, so that shared code is linked and instantiated once.
//!
//! Modules of the library that are arithmetic of their own are mounted.

mod awr;
mod conformance;
mod dct;
mod deviations;
mod divergence;
mod fourier_dof;
mod gem;
mod james_stein;
mod mdas;
mod nfor;
mod nlm_loop;
mod perceptual;
mod pixel_parts;
mod placed;
mod staged;
mod statistics;
mod support;
mod sure;
mod tlfr;
mod wavelets;
mod welch;

// What mounted modules take from the crate's root.
use dapple_classics::{Defocus, Domain, FilmPoints, Role};

#[allow(dead_code, unreachable_pub, reason = "tests use a part of it")]
#[path = "../../src/fourier_dof/bandwidth.rs"]
mod bandwidth;
#[allow(dead_code, reason = "tests use a part of it")]
#[path = "../../src/sure/bank.rs"]
mod bank;
#[allow(dead_code, unreachable_pub, reason = "tests use a part of it")]
#[path = "../../src/recorders.rs"]
mod recorders;
#[allow(dead_code, reason = "tests use a part of it")]
#[path = "../../src/tlfr/samples.rs"]
mod samples;
#[allow(dead_code, reason = "tests use a part of it")]
#[path = "../../src/windows.rs"]
mod windows;
