//! Methods of this crate conform: a test for each line of the table.

use crate::support::{domain, film_points, random, sobol};
use Role::{Lens, Time};
use dapple_classics::*;
use dapple_core::options::Options;
use dapple_denoise::Gaussian;

/// Declares tests: the check of `dapple_conformance`, the name of the test, and the method.
macro_rules! conforms {
    ($($check:ident $name:ident: $made:expr;)*) => {$(
        #[test]
        fn $name() {
            dapple_conformance::$check(|| Box::new($made.unwrap()));
        }
    )*};
}

/// Options with these values, and defaults for all others.
fn of<O: Options>(values: &str) -> O {
    O::parse(values).unwrap()
}

/// The points of a film in these dimensions.
fn points(roles: &[Role]) -> FilmPoints {
    film_points(sobol(3), roles, None).with_defocus(Some(Defocus::new([3.0, -3.0], [1.0, -1.0])))
}

conforms! {
    sampler awr: Awr::with_options(sobol(7), of(""));
    sampler awr_of_haar: Awr::with_options(sobol(7), of("basis=haar,rounds=2"));
    sampler awr_of_one_level: Awr::with_options(sobol(7), of("basis=cdf53,levels=1"));
    sampler awr_without_levels: Awr::with_options(sobol(7), of("levels=0"));
    sampler dct: Dct::new(random(7), &domain(&[]), of(""), of(""));
    sampler dct_of_logarithms: Dct::new(random(7), &domain(&[]), of("pilot=9,growth=1,visible=0,masking=0"), of("share=1,scale=log"));
    sampler divergence: Divergence::with_options(sobol(7), of(""));
    sampler divergence_kl: Divergence::with_options(random(7), of("by=kl,pilot=3"));
    sampler divergence_chi2: Divergence::with_options(random(7), of("by=chi2,pilot=3"));
    sampler divergence_entropy: Divergence::with_options(random(7), of("by=entropy,pilot=3"));
    sampler divergence_geometric: Divergence::with_options(random(7), of("by=geometric,pilot=3"));
    sampler divergence_tsallis_half: Divergence::with_options(random(7), of("by=tsallis,q=0.5"));
    sampler divergence_tsallis_one: Divergence::with_options(random(7), of("by=tsallis,q=1"));
    sampler divergence_tsallis_two: Divergence::with_options(random(7), of("by=tsallis,q=2,cap=1.5"));
    sampler divergence_fuzzy: Divergence::with_options(random(7), of("by=fuzzy"));
    sampler divergence_gh: Divergence::with_options(random(7), of("by=gh"));
    sampler ears: Ears::with_options(sobol(7), of(""));
    sampler ears_without_windows: Ears::with_options(random(7), of("pilot=3,rounds=1,radius=0,most=2,outliers=0"));
    sampler gem: Gem::with_options(sobol(7), of(""));
    sampler gem_in_few_rounds: Gem::with_options(sobol(7), of("gamma=0.4,pilot=2,rounds=3"));
    sampler hierarchical: Hierarchical::new(random(7), &domain(&[Time]), of("pilot=8"));
    sampler mdas: Mdas::new(random(7), &domain(&[Time]), of("candidates=1,pilot=8"));
    sampler nlm_loop: NlmLoop::with_options(sobol(7), of("window=2,patch=1"));
    sampler nlm_loop_of_samples: NlmLoop::with_options(sobol(7), of("window=2,patch=1,rounds=2,variance=samples"));
    sampler perceptual: Perceptual::with_options(sobol(7), of(""));
    sampler perceptual_in_one_round: Perceptual::with_options(sobol(7), of("adapt=0.2,rounds=1"));
    sampler subdivision: Subdivision::new(sobol(7), &domain(&[]), of(""));
    sampler sure: Sure::with_options(sobol(7), of("window=2,smooth=1"));
    sampler sure_with_a_cap: Sure::with_options(random(7), of("window=2,smooth=1,pilot=3,rounds=3,cap=20"));
    sampler ucb: UpperConfidence::with_options(sobol(7), of(""));
    sampler ucb_without_bonus: UpperConfidence::with_options(random(7), of("pilot=3,bonus=0,step=0.3"));
    sampler variance_threshold: VarianceThreshold::with_options(sobol(7), of(""));
    sampler variance_threshold_of_random: VarianceThreshold::with_options(random(7), of(""));
    sampler variance_threshold_with_a_cap: VarianceThreshold::with_options(random(7), of("min=3,step=5,cap=2,threshold=0.01"));

    threshold_sampler divergence_up_to: Divergence::with_options(random(7), of("mode=threshold"));
    threshold_sampler divergence_kl_up_to: Divergence::with_options(random(7), of("by=kl,pilot=3,threshold=0.01,step=3,mode=threshold"));
    threshold_sampler divergence_fuzzy_up_to: Divergence::with_options(random(7), of("by=fuzzy,pilot=3,mode=threshold"));
    threshold_sampler perceptual_up_to: Perceptual::with_options(sobol(7), of("mode=threshold"));
    threshold_sampler perceptual_in_one_round_up_to: Perceptual::with_options(sobol(7), of("adapt=0.2,rounds=1,mode=threshold"));
    threshold_sampler subdivision_up_to: Subdivision::new(sobol(7), &domain(&[]), of("mode=threshold"));
    threshold_sampler variance_threshold_up_to: VarianceThreshold::with_options(random(7), of("mode=threshold"));
    threshold_sampler variance_threshold_with_a_cap_up_to:
        VarianceThreshold::with_options(random(7), of("min=3,step=5,cap=2,threshold=0.01,mode=threshold"));

    filter dct_filter: DctFilter::new(points(&[]), of(""));
    filter dct_filter_of_logarithms: DctFilter::new(points(&[]), of("scale=log"));
    filter dct_filter_of_all_cosines: DctFilter::new(points(&[]), of("share=1,lambda=0.000001"));
    filter gem_filter: GemFilter::with_options(of(""));
    filter james_stein: JamesStein::with_options(Gaussian::default(), of(""));
    filter james_stein_of_samples: JamesStein::with_options(Gaussian::default(), of("noise=samples"));
    filter james_stein_of_sure: JamesStein::with_options(SureFilter::with_options(of("fast=true")).unwrap(), of("window=3"));
    filter mdas_boxes: MdasBoxes::new(points(&[Lens, Lens]), of(""));
    filter nfor: Nfor::with_options(of("window=4"));
    filter nlm_loop_filter: NlmLoopFilter::with_options(of(""));
    filter nlm_loop_filter_of_samples: NlmLoopFilter::with_options(of("window=3,patch=1,alpha=0.5,variance=samples"));
    filter staged: Staged::new(points(&[]), of(""));
    filter staged_of_wide_boxes: Staged::new(points(&[]), of("width=2.5"));
    filter sure_filter: SureFilter::with_options(of("fast=true"));
    filter tlfr_at_rest: Tlfr::new(points(&[]), of("points=2"));
    filter tlfr: Tlfr::new(points(&[Lens, Lens, Time]), of("points=2"));
    filter tree_mean: TreeMean::new(points(&[]), of(""));
    filter tree_mean_of_contrast: TreeMean::new(points(&[Time]), of("tree=contrast"));
    filter wavelet_cdf97: Wavelet::with_options(of(""));
    filter wavelet_cdf53: Wavelet::with_options(of("basis=cdf53"));
    filter wavelet_haar: Wavelet::with_options(of("basis=haar"));
    filter welch: Welch::with_options(of(""));
    filter welch_of_counts: Welch::with_options(of("radius=3,df=counts,level=0.1,shrink=0.5"));
}
