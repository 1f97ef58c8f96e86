#![doc = include_str!("../README.md")]

mod awr;
mod dct;
mod deviations;
mod divergence;
mod fourier_dof;
mod gem;
mod james_stein;
mod mdas;
mod method;
mod nfor;
mod nlm_loop;
mod patch_means;
mod perceptual;
mod pixel_parts;
mod placed;
mod recorders;
mod staged;
mod sure;
mod tlfr;
mod tree;
mod wavelets;
mod welch;
mod windows;

pub use awr::{Awr, AwrOptions};
pub use dct::{CosineOptions, CosineScale, Dct, DctFilter, DctOptions};
pub use deviations::{
    Ears, EarsOptions, UpperConfidence, UpperConfidenceOptions, VarianceThreshold, VarianceThresholdOptions,
};
pub use divergence::{Divergence, DivergenceOptions, DivergenceScore};
pub use fourier_dof::{FourierDof, FourierDofOptions, LensBandwidthOptions, Splat, SplatOptions, TraceLensHit};
pub use gem::{Gem, GemFilter, GemFilterOptions, GemOptions};
pub use james_stein::{JamesStein, JamesSteinOptions, NoiseEstimate};
pub use mdas::{Mdas, MdasBoxes, MdasBoxesOptions, MdasOptions};
pub use method::{FilterMethod, MethodFilter, MethodSampler, SamplingMethod};
pub use nfor::{Nfor, NforOptions};
pub use nlm_loop::{HalfVariance, NlmLoop, NlmLoopFilter, NlmLoopFilterOptions, NlmLoopOptions};
pub use perceptual::{Perceptual, PerceptualOptions};
pub use pixel_parts::{
    Hierarchical, HierarchicalOptions, PartRule, Subdivision, SubdivisionOptions, TreeMean, TreeMeanOptions,
};
pub use placed::{Axis, Defocus, Domain, FilmPoints, Placed, PlacedHandle, Role};
pub use staged::{Staged, StagedOptions};
pub use sure::{Sure, SureFilter, SureFilterOptions, SureOptions};
pub use tlfr::{Tlfr, TlfrOptions};
pub use tree::{Refinement, TreeSampler};
pub use wavelets::{Basis, Wavelet, WaveletOptions};
pub use welch::{TestDegrees, Welch, WelchOptions};
