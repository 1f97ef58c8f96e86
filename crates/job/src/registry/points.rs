//! The point sets.

use super::{Entry, Parameters, RegistryError, Setting};
use dapple_core::{Options as _, PointSet, SampleId};
use dapple_low_discrepancy::{Halton, LowDiscrepancy, Random, Sobol, Stratified};

/// A point set of any type.
pub struct AnyPoints(Box<dyn PointSet>);

impl AnyPoints {
    /// Wraps a boxed point set.
    pub fn new(points: Box<dyn PointSet>) -> Self {
        Self(points)
    }
}

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

    fn is_independent(&self) -> bool {
        self.0.is_independent()
    }
}

/// The constructor of a point set.
pub type MakePoints = fn(&Parameters, Setting) -> Result<Box<dyn PointSet>, RegistryError>;

/// All point sets of the registry.
pub const POINTS: &[Entry<MakePoints>] = &[
    Entry::new("sobol", "Owen-scrambled Sobol' pairs, any prefix is good (the default)", &[], |_, s| {
        Ok(Box::new(Sobol::new(s.seed)))
    }),
    Entry::new(
        "lowdiscrepancy",
        "pbrt-v2's scrambled and shuffled (0,2) points, made for a given count",
        &[LowDiscrepancyOptions::PARAMETERS],
        low_discrepancy,
    ),
    Entry::new("halton", "scrambled Halton points", &[], |_, s| Ok(Box::new(Halton::new(s.seed)))),
    Entry::new("stratified", "jittered cells", &[StratifiedOptions::PARAMETERS], stratified),
    Entry::new("random", "independent random numbers (PCG), the baseline", &[], |_, s| {
        Ok(Box::new(Random::new(s.seed)))
    }),
];

dapple_core::options! {
    /// The parameters of `lowdiscrepancy`.
    struct LowDiscrepancyOptions {
        /// Samples per pixel, rounded up to a power of two; 0 takes the mean budget, else 16.
        pub count: u64 = 0;
    }
}

dapple_core::options! {
    /// The parameters of `stratified`.
    struct StratifiedOptions {
        /// Cells along each axis; 0 takes the root of the mean budget, else 4.
        pub strata: u32 = 0;
    }
}

fn low_discrepancy(p: &Parameters, s: Setting) -> Result<Box<dyn PointSet>, RegistryError> {
    let count = match p.options::<LowDiscrepancyOptions>()?.count {
        0 => s.spp.unwrap_or(16),
        count => count,
    };
    let made = LowDiscrepancy::new(s.seed, u32::try_from(count.max(1)).unwrap_or(u32::MAX));
    Ok(Box::new(made.map_err(|e| p.refuse(e.to_string()))?))
}

fn stratified(p: &Parameters, s: Setting) -> Result<Box<dyn PointSet>, RegistryError> {
    let strata = match p.options::<StratifiedOptions>()?.strata {
        0 => s.spp.map_or(4, |n| (n as f64).sqrt().ceil().clamp(1.0, 4096.0) as u32),
        strata => strata,
    };
    let made = Stratified::new(s.seed, strata);
    Ok(Box::new(made.map_err(|e| p.refuse(e.to_string()))?))
}
