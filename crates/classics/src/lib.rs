//! Published methods of adaptive sampling and reconstruction.
//!
//! Each method is a file of its own: its options, the method, and the tests that prove it. A method whose core is recalled
//! rather than read in its source is named "after" its authors.

mod awr;
mod dct;
mod divergence;
mod domain;
mod ears;
mod fourier_dof;
mod gem;
mod hierarchical;
mod james_stein;
mod mdas;
mod method;
mod nfor;
mod nlm_loop;
mod patch_means;
mod perceptual;
mod placed;
mod recorders;
mod rounds;
mod scale_selection;
mod staged;
mod student;
mod subdivision;
mod sure;
#[cfg(test)]
mod test_films;
#[cfg(test)]
mod test_scenes;
mod tlfr;
mod tree;
mod tree_mean;
mod upper_confidence;
mod variance_threshold;
mod variances;
mod wavelet_filter;
mod wavelets;
mod welch;
mod windows;

pub use awr::{Awr, AwrOptions, BlockPriority, SpreadStatistic};
pub use dct::{CosineOptions, CosineScale, Dct, DctFilter, DctOptions};
pub use divergence::{Divergence, DivergenceOptions, DivergenceScore};
pub use domain::{Axis, Defocus, Domain, Role};
pub use ears::{Ears, EarsOptions};
pub use fourier_dof::{FourierDof, FourierDofOptions, LensBandwidthOptions, Splat, SplatOptions, TraceLensProbe};
pub use gem::{Gem, GemFilter, GemFilterOptions, GemOptions};
pub use hierarchical::{Hierarchical, HierarchicalOptions};
pub use james_stein::{JamesStein, JamesSteinOptions, NoiseEstimate};
pub use mdas::{Mdas, MdasBoxes, MdasBoxesOptions, MdasOptions};
pub use method::{MethodFilter, MethodSampler, SamplesFilter};
pub use nfor::{Nfor, NforOptions};
pub use nlm_loop::{HalfVariance, NlmLoop, NlmLoopFilter, NlmLoopFilterOptions, NlmLoopOptions};
pub use perceptual::{Perceptual, PerceptualOptions};
pub use placed::{FilmPoints, Placed, PlacedHandle};
pub use staged::{Staged, StagedOptions};
pub use subdivision::{Subdivision, SubdivisionOptions};
pub use sure::{Sure, SureFilter, SureFilterOptions, SureOptions};
pub use tlfr::{Tlfr, TlfrOptions};
pub use tree::TreeSampler;
pub use tree_mean::{PartRule, TreeMean, TreeMeanOptions};
pub use upper_confidence::{UpperConfidence, UpperConfidenceOptions};
pub use variance_threshold::{VarianceThreshold, VarianceThresholdOptions};
pub use wavelet_filter::{Wavelet, WaveletOptions};
pub use wavelets::Basis;
pub use welch::{TestDegrees, Welch, WelchOptions};

/// The README's example, run as a doctest.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;
