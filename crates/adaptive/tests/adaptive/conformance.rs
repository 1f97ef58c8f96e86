//! The samplers conform with every policy.

use crate::support::options;
use dapple_adaptive::{
    Adaptive, AdaptiveOptions, Cycles, CyclesOptions, ErrorMap, PilotPolicy, Stopping, VarianceOptions,
};
use dapple_conformance::{sampler, threshold_sampler};
use dapple_core::{Film, Needs};
use dapple_low_discrepancy::{Random, Sobol};

fn adaptive(options: AdaptiveOptions) -> Adaptive<Sobol> {
    Adaptive::with_options(Sobol::new(6), options).unwrap()
}

const POLICIES: [PilotPolicy; 4] =
    [PilotPolicy::Keep, PilotPolicy::Neighbours, PilotPolicy::Discard, PilotPolicy::Cross];

#[test]
fn adaptive_conforms_with_and_without_costs() {
    for policy in POLICIES {
        sampler(|| Box::new(adaptive(options().policy(policy))));
        if policy != PilotPolicy::Cross {
            sampler(|| Box::new(adaptive(AdaptiveOptions::default().policy(policy).cost(1))));
            let options = VarianceOptions::default().policy(policy).cost(1);
            sampler(|| Box::new(Adaptive::variance_with_options(Sobol::new(6), options).unwrap()));
        }
    }
}

#[test]
fn adaptive_conforms_in_rounds_and_by_a_map() {
    let default = options();
    sampler(|| Box::new(adaptive(default.rounds(3).gain(1.0))));
    // Halves that differ: error estimates of the final image, valid and invalid.
    let errors = |film: &Film| {
        Ok((0..film.frame().pixels()).map(|i| film.squared_error(i).map_or(f32::NAN, |e| e[0] as f32)).collect())
    };
    sampler(|| {
        let map = ErrorMap {
            name: "halves".into(),
            needs: Needs::none().with_halves(),
            of: Box::new(errors),
            bytes_per_pixel: 4,
        };
        Box::new(adaptive(default).with_error_map(map).unwrap())
    });
}

#[test]
fn variance_conforms_under_every_policy() {
    for policy in POLICIES {
        for (pilot, exponent) in [(0, 1.3), (5, 1.0)] {
            let options = VarianceOptions::default().policy(policy).pilot(pilot).exponent(exponent);
            sampler(|| Box::new(Adaptive::variance_with_options(Random::new(1), options).unwrap()));
        }
    }
}

#[test]
fn cycles_conforms_with_a_budget_and_with_a_threshold() {
    for options in [CyclesOptions::default(), CyclesOptions::default().threshold(0.01).min(3).step(5)] {
        sampler(|| Box::new(Cycles::with_options(Random::new(1), options).unwrap()));
        let options = options.mode(Stopping::Threshold);
        threshold_sampler(|| Box::new(Cycles::with_options(Random::new(1), options).unwrap()));
    }
}
