//! The designs S1 to S8 by which claims about images are tested, one place for all crates.
//!
//! | design | what it asks | here |
//! |---|---|---|
//! | S1 | is a mean what it should be? | [`Mean::against`], [`Mean::against_estimate`] |
//! | S2 | are two images of the same thing? | [`images`], [`image`] |
//! | S3 | are draws spread by their density? | [`chi_square`], [`integrate`] |
//! | S4 | is a mean *proven* to lie close? | [`Mean::equals`], [`decide`], [`samples_needed`] |
//! | S5 | which of two is better at equal budget? | `ratio_interval` and `log_log_fit` of dapple-metrics |
//! | S6 | equal spread? honest forecasts? | [`brown_forsythe`], [`Calibration`] |
//! | S7 | does deciding on samples bias them? | [`kept`], [`refined`], [`Bernoulli`], [`Naive`], [`count_trend`] |
//! | S8 | what must not change a bit | [`bits`](crate::bits) and the checks of samplers and filters |
//!
//! Seeds are fixed, and a family of tests together raises a false alarm with probability [`FAMILY`] at most: each test's level
//! is [`sidak`]'s share of that, or p-values are [`adjusted`]. What a test sees is computed by [`power`] and asserted, since one
//! that cannot fail is worth nothing. Variances are taken *between* replicates with seeds of their own: samples within one
//! low-discrepancy or adaptive image are not independent.
//!
//! Everything panics on nonsense (lengths that differ, fewer than two replicates): these are tests.

mod adaptive;
mod chi_square;
mod image;
mod levels;
mod mean;
mod spread;

pub use adaptive::{Bernoulli, Naive, Pixels, count_trend, image_mean, kept, refined};
pub use chi_square::{chi_square, integrate};
pub use image::{ImageTest, image, images};
pub use levels::{FAMILY, adjusted, critical, gamma_q, ln_gamma, normal_tail, power, sidak, student_tail, two_sided};
pub use mean::{Decided, Mean, MeanTest, Verdict, decide, samples_needed};
pub use spread::{Calibration, brown_forsythe};
