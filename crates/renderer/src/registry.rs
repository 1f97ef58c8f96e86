//! Every sampler, point set and filter by name: one line each.

mod parameters;

pub use parameters::{Parameters, RegistryError};

use dapple_core::samplers::{Pilot, Uniform, Variance, VarianceOptions};
use dapple_core::{Filter, PointSet, SampleId, Sampler, Unfiltered};
use dapple_low_discrepancy::{Halton, LowDiscrepancy, Random, Sobol, Stratified};

/// A parameter: its name, its default as it would be written, and one line about it.
pub type Parameter = (&'static str, &'static str, &'static str);

/// One entry: its name, one line about it, its parameters, and how it is made.
pub struct Entry<Make> {
    /// The name on the command line.
    pub name: &'static str,
    /// What it is, in one line.
    pub about: &'static str,
    /// Its parameters.
    pub parameters: &'static [Parameter],
    make: Make,
}

/// What a point set is made from besides its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    /// The seed.
    pub seed: u64,
    /// The mean number of samples per pixel asked for, where it is known: some sets want it beforehand.
    pub spp: Option<u64>,
}

/// Any point set.
pub struct AnyPoints(Box<dyn PointSet>);

impl PointSet for AnyPoints {
    fn describe(&self) -> String {
        self.0.describe()
    }

    #[inline]
    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        self.0.block(id, block)
    }

    fn capacity(&self) -> u64 {
        self.0.capacity()
    }

    fn preferred_count(&self, n: u64) -> u64 {
        self.0.preferred_count(n)
    }
}

type MakePoints = fn(&Parameters, Setting) -> Result<Box<dyn PointSet>, RegistryError>;
type MakeSampler = fn(&Parameters, AnyPoints) -> Result<Box<dyn Sampler>, RegistryError>;
type MakeFilter = fn(&Parameters) -> Result<Box<dyn Filter>, RegistryError>;

/// The samplers.
pub const SAMPLERS: &[Entry<MakeSampler>] = &[
    Entry {
        name: "variance",
        about: "pooled variance of a pilot, Neyman counts on a ladder (the default)",
        parameters: VARIANCE,
        make: variance,
    },
    Entry {
        name: "uniform",
        about: "the same count for every pixel",
        parameters: &[],
        make: |_, points| Ok(Box::new(Uniform::new(points))),
    },
];

/// The point sets.
pub const POINTS: &[Entry<MakePoints>] = &[
    Entry {
        name: "sobol",
        about: "Owen-scrambled Sobol' pairs, any prefix is good (the default)",
        parameters: &[],
        make: |_, s| Ok(Box::new(Sobol::new(s.seed))),
    },
    Entry {
        name: "lowdiscrepancy",
        about: "pbrt-v2's scrambled and shuffled (0,2) points, made for a given count",
        parameters: LOW_DISCREPANCY,
        make: low_discrepancy,
    },
    Entry {
        name: "halton",
        about: "scrambled Halton points",
        parameters: &[],
        make: |_, s| Ok(Box::new(Halton::new(s.seed))),
    },
    Entry { name: "stratified", about: "jittered cells", parameters: STRATIFIED, make: stratified },
    Entry {
        name: "random",
        about: "independent random numbers (PCG), the baseline",
        parameters: &[],
        make: |_, s| Ok(Box::new(Random::new(s.seed))),
    },
];

/// The filters.
pub const FILTERS: &[Entry<MakeFilter>] = &[Entry {
    name: "none",
    about: "each pixel the mean of its own samples",
    parameters: &[],
    make: |_| Ok(Box::new(Unfiltered)),
}];

const VARIANCE: &[Parameter] = &[
    ("pilot", "0", "samples per pixel before counts adapt; 0 is 4, or a quarter of the mean budget if that is more"),
    ("radius", "2", "variance is pooled over 2 radius + 1 pixels squared"),
    ("exponent", "1.3", "errors are taken to fall as n^-exponent; 1 for random points"),
    ("epsilon", "0.01", "errors are relative to mean^2 + epsilon"),
    ("cap", "6", "no pixel gets more than this many times the mean count"),
    ("policy", "keep", "the pilot's fate: keep (slightly biased), discard (unbiased), cross (unbiased, two halves)"),
];
const LOW_DISCREPANCY: &[Parameter] =
    &[("count", "0", "samples per pixel, rounded up to a power of two; 0 takes the mean budget, else 16")];
const STRATIFIED: &[Parameter] =
    &[("strata", "0", "cells along each axis; 0 takes the root of the mean budget, else 4")];

fn variance(p: &Parameters, points: AnyPoints) -> Result<Box<dyn Sampler>, RegistryError> {
    let options = VarianceOptions {
        pilot: p.number("pilot")?,
        radius: p.number("radius")?,
        exponent: p.number("exponent")?,
        epsilon: p.number("epsilon")?,
        cap: p.number("cap")?,
        policy: p.choice("policy", &[Pilot::Keep, Pilot::Discard, Pilot::Cross].map(|o| (o.name(), o)))?,
    };
    Ok(Box::new(Variance::with_options(points, options)?))
}

fn low_discrepancy(p: &Parameters, s: Setting) -> Result<Box<dyn PointSet>, RegistryError> {
    let count = match p.number::<u64>("count")? {
        0 => s.spp.unwrap_or(16),
        count => count,
    };
    let made = LowDiscrepancy::new(s.seed, u32::try_from(count.max(1)).unwrap_or(u32::MAX));
    Ok(Box::new(made.map_err(|e| p.refuse(e.to_string()))?))
}

fn stratified(p: &Parameters, s: Setting) -> Result<Box<dyn PointSet>, RegistryError> {
    let strata = match p.number::<u32>("strata")? {
        0 => s.spp.map_or(4, |n| (n as f64).sqrt().ceil().clamp(1.0, 4096.0) as u32),
        strata => strata,
    };
    let made = Stratified::new(s.seed, strata);
    Ok(Box::new(made.map_err(|e| p.refuse(e.to_string()))?))
}

/// Makes the point set that `words` names: `NAME` or `NAME:key=value,…`.
///
/// # Errors
///
/// For an unknown name or key, which lists what there is, and for a value out of range.
pub fn points(words: &str, setting: Setting) -> Result<AnyPoints, RegistryError> {
    let (entry, parameters) = parameters::find("point set", POINTS, words)?;
    Ok(AnyPoints((entry.make)(&parameters, setting)?))
}

/// Makes the sampler that `words` names, with these points.
///
/// # Errors
///
/// As [`points`].
pub fn sampler(words: &str, points: AnyPoints) -> Result<Box<dyn Sampler>, RegistryError> {
    let (entry, parameters) = parameters::find("sampler", SAMPLERS, words)?;
    (entry.make)(&parameters, points)
}

/// Makes the filter that `words` names.
///
/// # Errors
///
/// As [`points`].
pub fn filter(words: &str) -> Result<Box<dyn Filter>, RegistryError> {
    let (entry, parameters) = parameters::find("filter", FILTERS, words)?;
    (entry.make)(&parameters)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTING: Setting = Setting { seed: 5, spp: Some(16) };

    fn refusal<T>(made: Result<T, RegistryError>) -> String {
        made.err().map(|e| e.to_string()).unwrap_or_default()
    }

    #[test]
    fn every_entry_is_made_by_its_name() {
        for entry in POINTS {
            let points = points(entry.name, SETTING).unwrap_or_else(|e| panic!("{e}"));
            assert!(points.describe().starts_with(entry.name), "{}", points.describe());
            let id = SampleId { pixel: [3, 4], stream: 0, index: 7 };
            assert!(points.block(id, 2).iter().all(|u| (0.0..1.0).contains(u)));
        }
        for entry in SAMPLERS {
            let points = points("random", SETTING).unwrap_or_else(|e| panic!("{e}"));
            let sampler = sampler(entry.name, points).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(sampler.name(), entry.name);
            assert!(sampler.points().describe().starts_with("random"));
        }
        for entry in FILTERS {
            assert_eq!(filter(entry.name).unwrap_or_else(|e| panic!("{e}")).name(), entry.name);
        }
        for names in [POINTS.iter().map(|e| e.name).collect::<Vec<_>>(), SAMPLERS.iter().map(|e| e.name).collect()] {
            assert!(names.iter().enumerate().all(|(i, n)| !names[..i].contains(n)), "{names:?}");
        }
    }

    #[test]
    fn defaults_are_what_they_say() {
        for entry in SAMPLERS {
            let said: Vec<String> = entry.parameters.iter().map(|(k, v, _)| format!("{k}={v}")).collect();
            let words = format!("{}:{}", entry.name, said.join(","));
            let describe = |words: &str| {
                let points = points("sobol", SETTING).unwrap_or_else(|e| panic!("{e}"));
                sampler(words, points).unwrap_or_else(|e| panic!("{e}")).describe()
            };
            assert_eq!(describe(&words), describe(entry.name));
        }
    }

    #[test]
    fn wrong_words_are_refused_with_what_there_is() {
        let points = || points("sobol", SETTING).unwrap_or_else(|e| panic!("{e}"));
        assert!(refusal(super::points("sobel", SETTING)).contains("there are sobol"));
        assert!(refusal(sampler("", points())).contains("variance, uniform"));
        assert!(refusal(filter("nune")).contains("none"));
        assert!(refusal(sampler("uniform:x=1", points())).contains("it takes none"));
        assert!(refusal(sampler("variance:pilots=4", points())).contains("it takes pilot, radius"));
        assert!(refusal(sampler("variance:pilot=4,pilot=4", points())).contains("given twice"));
        assert!(refusal(sampler("variance:pilot", points())).contains("no key=value"));
        assert!(refusal(sampler("variance:pilot=four", points())).contains("a number is wanted"));
        assert!(refusal(sampler("variance:policy=maybe", points())).contains("one of keep, discard, cross"));
        for bad in ["exponent=NaN", "epsilon=-1", "cap=0"] {
            assert_ne!(refusal(sampler(&format!("variance:{bad}"), points())), "", "{bad}");
        }
        assert!(sampler("variance: pilot = 8 , policy=cross ", points()).is_ok(), "blanks do no harm");
    }
}
