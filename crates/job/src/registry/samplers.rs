//! The samplers.

use super::{AnyPoints, CLUSTERING, Entry, Parameter, Parameters, RegistryError, clustering};
use crate::Stage;
use crate::clusters::{WorldTriangles, shoot};
use dapple_adaptive::{
    Adaptive, AdaptiveOptions, CellOptions, Cycles, CyclesOptions, ErrorMap, PoolShape, VarianceOptions,
};
use dapple_cluster_adaptive::{
    AreaVectors, ClusterSize, ClusterThesis, ClusterThesisOptions, PixelArea, Placement, ProbeSource, RateMap,
};
use dapple_core::samplers::Uniform;
use dapple_core::{Film, Frame, PilotPolicy, Sampler, Stopping};
use dapple_denoise::relative_errors;
use dapple_mitchell::{Mitchell, MitchellOptions, MitchellPbrt, MitchellPbrtOptions};

/// How a sampler is made.
pub type MakeSampler = fn(&Parameters, AnyPoints, &Stage) -> Result<Box<dyn Sampler>, RegistryError>;

/// The samplers.
pub const SAMPLERS: &[Entry<MakeSampler>] = &[
    Entry {
        name: "variance",
        about: "pooled variance of a pilot, Neyman counts on a ladder",
        parameters: &[VARIANCE],
        make: |p, points, _| variance(p, points),
    },
    Entry {
        name: "uniform",
        about: "the same count for every pixel",
        parameters: &[],
        make: |_, points, _| Ok(Box::new(Uniform::new(points))),
    },
    Entry {
        name: "cluster",
        about: "counts by error: pooled variance of a pilot, or a filter's error map; cells at hit points (the default)",
        parameters: &[CLUSTER],
        make: cluster,
    },
    Entry {
        name: "mitchell",
        about: "contrast of a pilot, two rates (Mitchell 1987)",
        parameters: &[MITCHELL, TWO_RATES],
        make: |p, points, _| mitchell(p, points),
    },
    Entry {
        name: "mitchell-pbrt",
        about: "pbrt-v2's variant: samples that deviate from the pixel's mean, two rates",
        parameters: &[MITCHELL_PBRT],
        make: |p, points, _| mitchell_pbrt(p, points),
    },
    Entry {
        name: "cycles",
        about: "the stopping rule of Blender's Cycles: pixels whose two halves differ go on",
        parameters: &[CYCLES],
        make: |p, points, _| cycles(p, points),
    },
    Entry {
        name: "cluster-thesis",
        about: "few samples where large clusters are seen, many where small ones are (Lan 2016), unbiased",
        parameters: &[CLUSTER_THESIS, CLUSTERING],
        make: cluster_thesis,
    },
];

const VARIANCE: &[Parameter] = &[
    ("pilot", "0", "samples per pixel before counts adapt; 0 is 4, or a quarter of the mean budget if that is more"),
    ("radius", "2", "variance is pooled over 2 radius + 1 pixels squared"),
    ("exponent", "1.3", "errors are taken to fall as n^-exponent; 1 for random points"),
    ("epsilon", "0.01", "errors are relative to mean^2 + epsilon"),
    ("cap", "6", "no pixel gets more than this many times the mean count"),
    (
        "policy",
        "keep",
        "the pilot's retention: keep (slightly biased), discard (unbiased), cross (unbiased, two halves)",
    ),
];

const CLUSTER: &[Parameter] = &[
    (
        "by",
        "variance",
        "what counts follow: variance (pooled, of the pilot), and the own error of nlm, bilateral or cluster-regression",
    ),
    ("pilot", "0", "samples per pixel before counts adapt; 0 is 4, or a quarter of the mean budget if that is more"),
    ("rounds", "0", "rounds into which the rest is cut, each planned from all before it; 0 is 3, or 1 without keep"),
    (
        "pool",
        "window",
        "variance is pooled over window (neighbours), inside (same cell weighs more) or cell (all of it)",
    ),
    ("radius", "2", "the window is 2 radius + 1 pixels squared"),
    ("prior", "12", "weight of the pool beside a pixel's own degrees of freedom; inf: the pool alone"),
    ("power", "2", "the power of the variance that is pooled; above 1 the noisiest neighbours weigh more"),
    ("geometry", "0", "weight of edges and texture seen in first hits, in degrees of freedom"),
    ("exponent", "1.15", "errors are taken to fall as n^-exponent; 1 for random points"),
    ("epsilon", "0.01", "errors are relative to mean^2 + epsilon"),
    ("cap", "6", "no pixel gets more than this many times the mean count"),
    ("mix", "0.5", "share of a filter's error map in the score"),
    ("gain", "0.98", "uniform counts where no less than this share of their error is promised; 1 adapts always"),
    (
        "policy",
        "keep",
        "the pilot's retention: keep (slightly biased), discard (unbiased), cross (unbiased, two halves)",
    ),
    ("edge", "16", "edge of a cell in pixels, where cells are asked for"),
    ("normals", "10", "degrees within which a cell's normals lie"),
];
const MITCHELL: &[Parameter] = &[
    ("initial", "0", "samples per pixel that decide; 0 with additional=0 is the thesis' table 4-2 for the mean budget"),
    ("additional", "0", "samples that refined pixels get besides"),
    ("red", "0.4", "contrast of red above which a pixel is refined"),
    ("green", "0.3", "contrast of green"),
    ("blue", "0.6", "contrast of blue"),
    ("radius", "1", "contrast is taken over 2 radius + 1 pixels squared"),
];
const TWO_RATES: &[Parameter] = &[
    ("mode", "budget", "budget (highest contrast first, to the last sample) or threshold (the budget is a ceiling)"),
    ("policy", "keep", "the pilot's retention: keep or refined (both biased), discard (unbiased)"),
];
const MITCHELL_PBRT: &[Parameter] = &[
    ("min", "4", "samples per pixel that decide, rounded up to a power of two"),
    ("max", "32", "samples of a refined pixel, rounded up to a power of two"),
    ("threshold", "0.5", "relative deviation in luminance above which a pixel is refined"),
    ("mode", "budget", "budget (largest deviation first, to the last sample) or threshold (the budget is a ceiling)"),
    ("policy", "refined", "the pilot's retention: refined (published, biased), keep (biased), discard (unbiased)"),
];
const CYCLES: &[Parameter] = &[
    ("threshold", "0", "the user's threshold, of which five times counts; 0 is 1 over the mean budget, at least 0.001"),
    (
        "min",
        "0",
        "samples per pixel before any stops; 0 is 16 t^-0.3 for threshold t, with a budget at most a quarter of it",
    ),
    ("step", "16", "samples of an open pixel between two looks"),
    ("mode", "budget", "budget (the threshold falls until it is spent) or threshold (the budget is a ceiling)"),
    ("policy", "keep", "the samples that decide stay in the image (biased), as published; there is no other"),
];
const CLUSTER_THESIS: &[Parameter] = &[
    ("probes", "centre", "probe rays per pixel: centre (one, published), or so many jittered ones"),
    ("size", "box", "a cluster's size: box (projected box, published), triangles, screen (box in perspective), hits"),
    ("pixel", "one", "a pixel's size beside box and triangles: one (published) or footprint"),
    ("map", "root", "from relative size to rate: identity, root or log"),
    ("angle", "0.25", "weight of a large angle between normal and ray"),
    ("distance", "0.25", "weight of distance"),
    (
        "min",
        "0",
        "samples that every pixel gets (beside --time and --error take --min-spp); 0 is the thesis' table 4-3",
    ),
    ("max", "0", "most samples that a pixel gets; 0 as above"),
    ("policy", "a-priori", "counts are planned from geometry alone: unbiased"),
];

fn variance(p: &Parameters, points: AnyPoints) -> Result<Box<dyn Sampler>, RegistryError> {
    let options = VarianceOptions {
        pilot: p.number("pilot")?,
        radius: p.number("radius")?,
        exponent: p.number("exponent")?,
        epsilon: p.number("epsilon")?,
        cap: p.number("cap")?,
        policy: p
            .choice("policy", &[PilotPolicy::Keep, PilotPolicy::Discard, PilotPolicy::Cross].map(|o| (o.name(), o)))?,
    };
    Ok(Box::new(Adaptive::variance_with_options(points, options)?))
}

fn cluster(p: &Parameters, points: AnyPoints, stage: &Stage) -> Result<Box<dyn Sampler>, RegistryError> {
    let options = AdaptiveOptions {
        pilot: p.number("pilot")?,
        rounds: p.number("rounds")?,
        pool: p.choice("pool", &[PoolShape::Window, PoolShape::Inside, PoolShape::Cell].map(|o| (o.name(), o)))?,
        radius: p.number("radius")?,
        prior: p.number("prior")?,
        power: p.number("power")?,
        geometry: p.number("geometry")?,
        exponent: p.number("exponent")?,
        epsilon: p.number("epsilon")?,
        cap: p.number("cap")?,
        mix: p.number("mix")?,
        gain: p.number("gain")?,
        policy: p
            .choice("policy", &[PilotPolicy::Keep, PilotPolicy::Discard, PilotPolicy::Cross].map(|o| (o.name(), o)))?,
        cells: CellOptions { edge: p.number("edge")?, normals: p.number("normals")? },
    };
    let sampler = Adaptive::with_options(points, options).map_err(|e| p.refuse(e.to_string()))?;
    Ok(match error_map(p, stage)? {
        Some(map) => Box::new(sampler.with_error_map(map).map_err(|e| p.refuse(e.to_string()))?),
        None => Box::new(sampler),
    })
}

/// What counts follow besides the pooled variance: the error that a filter with its default parameters says it leaves, the
/// regression's after one pass.
fn error_map(p: &Parameters, stage: &Stage) -> Result<Option<ErrorMap>, RegistryError> {
    let by = ["nlm", "bilateral", "cluster-regression"].map(|name| (name, Some(name)));
    let [nlm, bilateral, regression] = by;
    let Some(name) = p.choice("by", &[("variance", None), nlm, bilateral, regression])? else { return Ok(None) };
    // A plan's filter runs once a round: its first pass shows where errors are, at half of the cost and without clusters.
    let quick = if name == "cluster-regression" { "cluster-regression:passes=1,outside=1" } else { name };
    let filter = super::filter(quick, stage)?;
    let (needs, epsilon) = (filter.needs(), p.number("epsilon")?);
    let square = Frame::new(1024, 1024)?;
    let bytes_per_pixel = (filter.memory(&square, &needs).applying / square.pixels() as u64) as usize;
    let of = move |film: &Film| relative_errors(&filter.apply(film)?, epsilon);
    Ok(Some(ErrorMap { name: name.to_owned(), needs, of: Box::new(of), bytes_per_pixel }))
}

fn mode(p: &Parameters) -> Result<Stopping, RegistryError> {
    p.choice("mode", &[Stopping::Budget, Stopping::Threshold].map(|m| (m.name(), m)))
}

fn policy(p: &Parameters) -> Result<PilotPolicy, RegistryError> {
    p.choice("policy", &[PilotPolicy::Keep, PilotPolicy::Refined, PilotPolicy::Discard].map(|o| (o.name(), o)))
}

fn mitchell(p: &Parameters, points: AnyPoints) -> Result<Box<dyn Sampler>, RegistryError> {
    let options = MitchellOptions {
        initial: p.number("initial")?,
        additional: p.number("additional")?,
        thresholds: [p.number("red")?, p.number("green")?, p.number("blue")?],
        radius: p.number("radius")?,
        mode: mode(p)?,
        policy: policy(p)?,
    };
    Ok(Box::new(Mitchell::with_options(points, options)?))
}

fn mitchell_pbrt(p: &Parameters, points: AnyPoints) -> Result<Box<dyn Sampler>, RegistryError> {
    let options = MitchellPbrtOptions {
        min: p.number("min")?,
        max: p.number("max")?,
        threshold: p.number("threshold")?,
        mode: mode(p)?,
        policy: policy(p)?,
    };
    Ok(Box::new(MitchellPbrt::with_options(points, options)?))
}

fn cycles(p: &Parameters, points: AnyPoints) -> Result<Box<dyn Sampler>, RegistryError> {
    p.choice("policy", &[("keep", ())])?;
    let options = CyclesOptions {
        threshold: p.number("threshold")?,
        min: p.number("min")?,
        step: p.number("step")?,
        mode: mode(p)?,
    };
    Ok(Box::new(Cycles::with_options(points, options)?))
}

/// A cluster's size, as far as it can be chosen before there are clusters.
#[derive(Clone, Copy)]
enum Size {
    Box,
    Triangles,
    Screen,
    Hits,
}

fn cluster_thesis(p: &Parameters, points: AnyPoints, stage: &Stage) -> Result<Box<dyn Sampler>, RegistryError> {
    let placement = match p.value("probes") {
        "centre" => Placement::Centre,
        _ => Placement::Jittered(p.number("probes").map_err(|_| {
            p.refuse(format!("probes={}: centre, or a number of rays per pixel, is wanted", p.value("probes")))
        })?),
    };
    if !(1..=256).contains(&placement.per_pixel()) {
        return Err(p.refuse(format!("probes={placement}: 1 to 256 per pixel, or centre, are wanted")));
    }
    let sizes = [("box", Size::Box), ("triangles", Size::Triangles), ("screen", Size::Screen), ("hits", Size::Hits)];
    let size = p.choice("size", &sizes)?;
    let options = ClusterThesisOptions {
        map: p.choice("map", &[RateMap::Identity, RateMap::Root, RateMap::Log].map(|m| (m.name(), m)))?,
        pixel_area: p.choice("pixel", &[PixelArea::One, PixelArea::Footprint].map(|a| (a.name(), a)))?,
        angle: p.number("angle")?,
        distance: p.number("distance")?,
        min: p.number("min")?,
        max: p.number("max")?,
    };
    p.choice("policy", &[("a-priori", ())])?;
    let params = clustering(p)?;
    options.check().map_err(|e| p.refuse(e.to_string()))?;
    params.check().map_err(|e| p.refuse(e.to_string()))?;

    let clusters = stage.clusters(p.of(), &params)?;
    let world = stage.world(p.of())?;
    let size = match size {
        Size::Box => ClusterSize::ProjectedBox,
        Size::Hits => ClusterSize::Hits,
        Size::Screen => ClusterSize::ScreenBox(world.camera().world_to_clip()),
        Size::Triangles => {
            let triangles = WorldTriangles::of(world);
            let labels = &clusters.labels()[..triangles.indices.len()];
            let vectors = AreaVectors::new(&triangles.as_slices(), labels, clusters.clusters().len());
            ClusterSize::ProjectedTriangles(vectors.map_err(|e| p.refuse(e.to_string()))?)
        }
    };
    let source = ProbeSource {
        labels: clusters.labels().clone(),
        clusters: clusters.clusters().clone(),
        shoot: shoot(world.clone(), clusters),
        placement,
        described: p.described(CLUSTERING),
    };
    let sampler = ClusterThesis::probing(points, source, size, options).map_err(|e| p.refuse(e.to_string()))?;
    stage.keep(sampler.handle());
    Ok(Box::new(sampler))
}
