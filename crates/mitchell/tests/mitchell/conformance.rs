//! Both samplers conform.

use crate::support::*;
use dapple_adaptive::Sequence;
use dapple_conformance as conformance;
use dapple_core::samplers::Uniform;
use dapple_low_discrepancy::Random;
use dapple_mitchell::{MitchellOptions, MitchellPbrtOptions, PbrtTest, PilotPolicy, Stopping};

#[test]
fn mitchell_conforms_in_either_mode_under_every_policy() {
    for policy in POLICIES {
        for (initial, additional, radius) in [(0, 0, 0), (0, 0, 1), (3, 5, 2)] {
            let options = alone(initial, additional, Stopping::Budget, policy).radius(radius);
            conformance::sampler(|| Box::new(mitchell(options, 1)));
            conformance::threshold_sampler(|| Box::new(mitchell(options.mode(Stopping::Threshold), 1)));
        }
    }
}

#[test]
fn pbrt_conforms_in_either_mode_under_every_policy_and_test() {
    for policy in POLICIES {
        for (min, max, test) in [
            (4, 32, PbrtTest::Contrast),
            (2, 2, PbrtTest::Contrast),
            (4, 32, PbrtTest::ShapeId),
            (4, 32, PbrtTest::Shape),
        ] {
            let options = pbrt_options(min, max, Stopping::Budget, policy).test(test);
            conformance::sampler(|| Box::new(pbrt(options, 1)));
            conformance::threshold_sampler(|| Box::new(pbrt(options.mode(Stopping::Threshold), 1)));
        }
    }
}

/// After another sampler's rounds, whose counts are not those of a pilot.
#[test]
fn mitchell_conforms_as_the_second_of_two_samplers() {
    let refining = || mitchell(MitchellOptions::default().policy(PilotPolicy::Refined), 1);
    for policy in POLICIES {
        let options = MitchellOptions::default().policy(policy);
        conformance::sampler(|| {
            Box::new(Sequence::new(Uniform::new(Random::new(1)), 3, mitchell(options, 1)).unwrap())
        });
        conformance::sampler(|| Box::new(Sequence::new(refining(), 5, mitchell(options, 1)).unwrap()));
        let options = MitchellPbrtOptions::default().policy(policy);
        conformance::sampler(|| Box::new(Sequence::new(refining(), 5, pbrt(options, 1)).unwrap()));
    }
}
