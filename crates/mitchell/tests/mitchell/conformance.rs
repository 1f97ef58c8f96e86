//! Both samplers conform.

use dapple_adaptive::Then;
use dapple_conformance as conformance;
use dapple_core::samplers::Uniform;
use dapple_low_discrepancy::{Random, Sobol};
use dapple_mitchell::{Mitchell, MitchellOptions, MitchellPbrt, MitchellPbrtOptions, PbrtTest, PilotPolicy, Stopping};

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

#[test]
fn pbrt_conforms_with_tests_of_shapes() {
    for policy in POLICIES {
        for test in [PbrtTest::ShapeId, PbrtTest::Shape] {
            let options = MitchellPbrtOptions::default().policy(policy).test(test);
            conformance::sampler(|| Box::new(pbrt(options)));
            let options = options.mode(Stopping::Threshold);
            conformance::threshold_sampler(|| Box::new(pbrt(options)));
        }
    }
}

/// After another sampler's rounds, whose counts are not those of a pilot.
#[test]
fn mitchell_conforms_as_the_second_of_two_samplers() {
    let refining = || mitchell(MitchellOptions::default().policy(PilotPolicy::Refined));
    for policy in POLICIES {
        let options = MitchellOptions::default().policy(policy);
        conformance::sampler(|| Box::new(Then::new(Uniform::new(Random::new(1)), 3, mitchell(options)).unwrap()));
        conformance::sampler(|| Box::new(Then::new(refining(), 5, mitchell(options)).unwrap()));
        let options = MitchellPbrtOptions::default().policy(policy);
        conformance::sampler(|| Box::new(Then::new(refining(), 5, pbrt(options)).unwrap()));
    }
}
