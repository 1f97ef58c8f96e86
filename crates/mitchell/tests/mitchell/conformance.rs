//! Both samplers conform.

use dapple_conformance as conformance;
use dapple_low_discrepancy::{Random, Sobol};
use dapple_mitchell::{Mitchell, MitchellOptions, MitchellPbrt, MitchellPbrtOptions, PilotPolicy, Stopping};

const POLICIES: [PilotPolicy; 3] = [PilotPolicy::Keep, PilotPolicy::Refined, PilotPolicy::Discard];

#[test]
fn the_defaults_conform() {
    conformance::sampler(|| Box::new(Mitchell::new(Sobol::new(1))));
    conformance::sampler(|| Box::new(MitchellPbrt::new(Sobol::new(1))));
}

fn mitchell(options: MitchellOptions) -> Mitchell<Random> {
    Mitchell::with_options(Random::new(1), options).unwrap()
}

#[test]
fn mitchell_conforms_in_either_mode_under_every_policy() {
    for policy in POLICIES {
        for (initial, additional, radius) in [(0, 0, 0), (0, 0, 1), (3, 5, 2)] {
            let options =
                MitchellOptions::default().initial(initial).additional(additional).radius(radius).policy(policy);
            conformance::sampler(|| Box::new(mitchell(options)));
            let options = options.mode(Stopping::Threshold);
            conformance::threshold_sampler(|| Box::new(mitchell(options)));
        }
    }
}

fn pbrt(options: MitchellPbrtOptions) -> MitchellPbrt<Random> {
    MitchellPbrt::with_options(Random::new(1), options).unwrap()
}

#[test]
fn pbrt_conforms_in_either_mode_under_every_policy() {
    for policy in POLICIES {
        for (min, max) in [(4, 32), (2, 2)] {
            let options = MitchellPbrtOptions::default().min(min).max(max).policy(policy);
            conformance::sampler(|| Box::new(pbrt(options)));
            let options = options.mode(Stopping::Threshold);
            conformance::threshold_sampler(|| Box::new(pbrt(options)));
        }
    }
}
