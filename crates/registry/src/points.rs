//! The point sets.

use crate::{Entry, Parameter, Parameters, PointSettings, RegistryError};
use dapple_core::PointSet;
use dapple_core::options::Options as _;
use dapple_low_discrepancy::{
    BlueNoise, BlueNoiseKeys, Diffused, Halton, Lattice, LowDiscrepancy, Mitchell1991, Pmj02, Random, Sobol,
    Stratified, ZSobol,
};

/// A point set of any type.
pub type AnyPoints = Box<dyn PointSet>;

/// The constructor of a point set.
pub type MakePoints = fn(&Parameters, PointSettings) -> Result<AnyPoints, RegistryError>;

/// All point sets of the registry.
pub const POINTS: &[Entry<MakePoints>] = &[
    Entry::new(
        "sobol",
        "Owen-scrambled Sobol' points, well distributed for any count (the default)",
        "Sobol' 1967; directions: Joe and Kuo 2008; scrambling: Owen 1997, by hashing: Burley 2020",
        "white noise: neighbouring pixels have independent errors; less evenly spread if the count is no power of two",
        &[],
        |_, s| Ok(Box::new(Sobol::new(s.seed))),
    ),
    Entry::new(
        "lowdiscrepancy",
        "pbrt-v2's scrambled and shuffled (0,2)-sequences, for a count known in advance",
        "Kollig and Keller, Efficient Multidimensional Sampling, 2002, as in pbrt, version 2",
        "with fewer samples than `count`, no better than random; beyond `count`, a new set starts",
        &[CountOptions::PARAMETERS],
        |p, s| Ok(Box::new(p.made(LowDiscrepancy::new(s.seed, count(p, s)?))?)),
    ),
    Entry::new(
        "halton",
        "scrambled Halton points",
        "Halton, On the Efficiency of Certain Quasi-random Sequences of Points, 1960; scrambling: Owen 1997",
        "computing points takes 9.5 times as long as for sobol; high dimensions are uneven at few samples",
        &[],
        |_, s| Ok(Box::new(Halton::new(s.seed))),
    ),
    Entry::new(
        "stratified",
        "one jittered sample in each cell of a grid",
        "none: one jittered sample per cell, as in textbooks",
        "the count must be known in advance; error falls more slowly than with low-discrepancy sets",
        &[StratifiedOptions::PARAMETERS],
        stratified,
    ),
    Entry::new(
        "random",
        "independent random numbers (PCG), the baseline",
        "O'Neill, PCG: A Family of Simple Fast Space-Efficient Random Number Generators, 2014",
        "samples clump, so error is largest of all sets at equal samples; at equal time, the slower `halton` is worse",
        &[],
        |_, s| Ok(Box::new(Random::new(s.seed))),
    ),
    Entry::new(
        "zsobol",
        "one Sobol' sequence dealt out to pixels along a Morton curve, for screen-space blue noise",
        "Ahmed and Wonka, Screen-Space Blue-Noise Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of \
             Pixels, 2020, as in pbrt, version 4",
        "the count must be known in advance; with adaptive counts the blue-noise property is lost",
        &[CountOptions::PARAMETERS],
        |p, s| Ok(Box::new(p.made(ZSobol::new(s.seed, count(p, s)?))?)),
    ),
    Entry::new(
        "blue-noise",
        "any point set, shifted per pixel so that errors form screen-space blue noise",
        "Georgiev and Fajardo, Blue-Noise Dithered Sampling, 2016; tile: Ulichney 1993; shifts: Cranley and Patterson 1976; \
             optimised keys: after Heitz et al., A Low-Discrepancy Sampler that Distributes Monte Carlo Errors as a Blue Noise \
             in Screen Space, 2019",
        "shifts break stratification: more error per pixel than sobol (not with keys=optimised); no gain at many samples",
        &[&[INNER], BlueNoiseOptions::PARAMETERS],
        blue_noise,
    ),
    Entry::new(
        "pmj02",
        "progressive multi-jittered (0,2) points, shifted per pixel so that errors form screen-space blue noise",
        "Christensen et al., Progressive Multi-Jittered Sample Sequences, 2018, as in pbrt, version 4",
        "shifts break stratification: more error per pixel than sobol; sequences end at 1024 samples",
        &[Pmj02Options::PARAMETERS],
        pmj02,
    ),
    Entry::new(
        "lattice",
        "extensible rank-1 lattices with a random shift per pixel",
        "Korobov 1959; extensible: Hickernell et al. 2000; multiplier: Dapple's search",
        "may alias on edges along the lattice's directions; error is proven to fall faster for periodic functions only",
        &[],
        |_, s| Ok(Box::new(Lattice::new(s.seed))),
    ),
    Entry::new(
        "diffused",
        "positions in the pixel chosen jointly with neighbouring pixels; other dimensions as in sobol",
        "after Mitchell, Generating Antialiased Images at Low Sampling Densities, 1987",
        "helps only at a few samples per pixel, and only for the position in the pixel",
        &[],
        |_, s| Ok(Box::new(Diffused::new(s.seed))),
    ),
    Entry::new(
        "mitchell-1991",
        "positions in the pixel, lens points and times chosen jointly with neighbouring pixels",
        "after Mitchell, Spectrally Optimal Sampling for Distribution Ray Tracing, 1991",
        "a finite pattern: no gain at many samples, where sobol is better",
        &[],
        |_, s| Ok(Box::new(Mitchell1991::new(s.seed))),
    ),
];

dapple_core::options! {
    /// The parameters of `lowdiscrepancy` and `zsobol`.
    struct CountOptions {
        /// Samples per pixel, rounded up to a power of two; 0 = automatic (the mean spp if known, otherwise 16).
        pub count: u64 = 0;
    }
}

/// The relation between the errors of neighbouring pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pixels {
    BlueNoise,
    Independent,
}

dapple_core::choices!(Pixels { BlueNoise = "blue-noise", Independent = "independent" });

dapple_core::options! {
    /// The parameters of `pmj02`.
    struct Pmj02Options {
        /// Errors of neighbouring pixels: blue-noise (points shifted per pixel) or independent (separate points per pixel).
        pub pixels: Pixels = Pixels::BlueNoise => "blue-noise";
    }
}

/// The kind of keys by which the pixels of a tile differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Keys {
    Shifts,
    Optimised,
}

dapple_core::choices!(Keys { Shifts = "shifts", Optimised = "optimised" });

dapple_core::options! {
    /// The parameters of `blue-noise`.
    struct BlueNoiseOptions {
        /// Difference between pixels: shifts (added to points modulo 1), or optimised (XOR keys that keep sobol's strata).
        pub keys: Keys = Keys::Shifts => "shifts";
    }
}

const INNER: Parameter =
    Parameter::new("of", "sobol", "Point set to shift, with at most one parameter, such as stratified:strata=4.");

dapple_core::options! {
    /// The parameters of `stratified`.
    struct StratifiedOptions {
        /// Strata along each axis; 0 = automatic (the square root of the mean spp if known, otherwise 4).
        pub strata: u32 = 0;
    }
}

/// The given count; for 0 the mean budget, or 16 if the budget is unknown.
fn count(p: &Parameters, s: PointSettings) -> Result<u32, RegistryError> {
    let given = p.options::<CountOptions>()?.count;
    let count = if given == 0 { s.spp.unwrap_or(16) } else { given };
    Ok(u32::try_from(count.max(1)).unwrap_or(u32::MAX))
}

fn blue_noise(p: &Parameters, s: PointSettings) -> Result<AnyPoints, RegistryError> {
    let of = p.value("of");
    if p.options::<BlueNoiseOptions>()?.keys == Keys::Optimised {
        return match of {
            "sobol" => Ok(Box::new(BlueNoiseKeys::new(s.seed))),
            of => Err(
                p.refuse(format!("of = \"{of}\" has no optimised keys, which exist for sobol only; use keys=shifts"))
            ),
        };
    }
    let inner = crate::points(of, s)?;
    if inner.couples_pixels() {
        return Err(p.refuse(format!("of = \"{of}\" already distributes errors over pixels; use it directly")));
    }
    Ok(Box::new(BlueNoise::new(s.seed, inner)))
}

fn pmj02(p: &Parameters, s: PointSettings) -> Result<AnyPoints, RegistryError> {
    let points = Pmj02::new(s.seed);
    Ok(match p.options::<Pmj02Options>()?.pixels {
        Pixels::BlueNoise => Box::new(points),
        Pixels::Independent => Box::new(points.with_independent_pixels()),
    })
}

fn stratified(p: &Parameters, s: PointSettings) -> Result<AnyPoints, RegistryError> {
    let strata = match p.options::<StratifiedOptions>()?.strata {
        0 => s.spp.map_or(4, |n| (n as f64).sqrt().ceil().clamp(1.0, 4096.0) as u32),
        strata => strata,
    };
    Ok(Box::new(p.made(Stratified::new(s.seed, strata))?))
}
