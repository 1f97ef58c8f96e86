//! Renders, filters, and measures errors and times.

use crate::{Result, reference, statistics};
use dapple::core::{Film, Frame, Limits, Needs, Render};
use dapple::job::registry::{self, MadeSampler, MethodInputs};
use dapple::metrics::{Pixels, compare};
use dapple::renderer::{World, integrator};
use dapple_scene::{self as scene, bundled};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// The measurements on one scene.
pub(crate) struct Plan {
    pub(crate) scene: &'static str,
    /// The parameter `k` of the clusters.
    pub(crate) k: u32,
    /// Pixels along each side.
    pub(crate) side: u32,
    pub(crate) spp: &'static [u64],
    pub(crate) seeds: u64,
    pub(crate) reference_spp: u64,
}

/// A sampler with its points.
pub(crate) struct Method {
    pub(crate) name: &'static str,
    sampler: &'static str,
    /// Further parameters, if it takes those of clusters.
    clusters: Option<&'static str>,
    pub(crate) points: &'static str,
    /// True for a method that is rendered with half of the seeds and reported unfiltered.
    pub(crate) aside: bool,
}

const fn method(name: &'static str, sampler: &'static str, points: &'static str) -> Method {
    Method { name, sampler, clusters: None, points, aside: false }
}

const fn clusters(name: &'static str, parameters: &'static str, points: &'static str) -> Method {
    Method { name, sampler: "cluster-thesis", clusters: Some(parameters), points, aside: false }
}

/// The methods. Missing rates are those of tables 4-2 and 4-3.
///
/// Adaptive samplers on `lowdiscrepancy` get nets of the mean count, as uniform ones do. The thesis does not state its
/// choice; pbrt-v2 makes a net for each pixel's own count.
pub(crate) const METHODS: [Method; 11] = [
    method("random", "uniform", "random"),
    method("ld", "uniform", "lowdiscrepancy"),
    method("mitchell", "mitchell:mode=budget", "lowdiscrepancy"),
    method("mitchell-4-128", "mitchell:mode=budget,initial=4,additional=124", "lowdiscrepancy"),
    clusters("cluster-random", "", "random"),
    clusters("cluster-ld", "", "lowdiscrepancy"),
    clusters("cluster-4-128", ",min=4,max=128", "lowdiscrepancy"),
    Method { aside: true, ..method("sobol", "uniform", "sobol") },
    Method { aside: true, ..clusters("cluster-sobol", "", "sobol") },
    Method { aside: true, ..method("mitchell-sobol", "mitchell:mode=budget", "sobol") },
    Method { aside: true, ..method("variance-sobol", "variance", "sobol") },
];
pub(crate) const RANDOM: usize = 0;
pub(crate) const LD: usize = 1;
pub(crate) const CLUSTER_RANDOM: usize = 4;
pub(crate) const CLUSTER_LD: usize = 5;
pub(crate) const SOBOL: usize = 7;
pub(crate) const CLUSTER_SOBOL: usize = 8;

impl Method {
    fn request(&self, k: u32) -> String {
        match self.clusters {
            None => self.sampler.to_owned(),
            Some(more) => format!("{}:k={k}{more}", self.sampler),
        }
    }
}

/// Kinds of errors: MSE of 8-bit sRGB values, not rounded, and relMSE.
pub(crate) const METRICS: [&str; 2] = ["8-bit MSE", "relMSE"];
pub(crate) const SRGB: usize = 0;

/// The filters; the last one uses clusters.
pub(crate) const FILTERS: [&str; 3] = ["none", "gaussian", "cluster-gaussian"];
pub(crate) const NONE: usize = 0;
pub(crate) const GAUSSIAN: usize = 1;
pub(crate) const CLUSTER_FILTER: usize = 2;

fn filter_request(filter: usize, k: u32) -> String {
    if filter == CLUSTER_FILTER { format!("{}:k={k}", FILTERS[filter]) } else { FILTERS[filter].to_owned() }
}

/// Wall seconds of one image.
#[derive(Clone, Copy, Default)]
pub(crate) struct Seconds {
    pub(crate) cluster: f64,
    pub(crate) probe: f64,
    pub(crate) plan: f64,
    pub(crate) trace: f64,
    pub(crate) filter: f64,
}

impl Seconds {
    pub(crate) fn before_tracing(&self) -> f64 {
        self.cluster + self.probe + self.plan
    }

    pub(crate) fn total(&self) -> f64 {
        self.before_tracing() + self.trace + self.filter
    }
}

/// The measurements of one image.
pub(crate) struct Run {
    method: usize,
    filter: usize,
    spp: u64,
    /// The errors, one of each kind, without the reference's own error.
    errors: [f64; 2],
    seconds: Seconds,
    lowest: Lowest,
}

/// The pixels with the fewest samples.
#[derive(Clone, Copy)]
pub(crate) struct Lowest {
    /// Their fraction of all pixels.
    pub(crate) pixels: f64,
    /// Their fraction of the 8-bit error of uniform sampling on the same points.
    pub(crate) part: f64,
    /// The 8-bit error in them over that of uniform sampling on the same points in them.
    pub(crate) loss: f64,
}

/// The results on one scene.
pub(crate) struct Results<'a> {
    pub(crate) plan: &'a Plan,
    /// Errors of the reference, one of each kind.
    pub(crate) own: [f64; 2],
    /// Seconds of tracing with first hits recorded over seconds without.
    pub(crate) recording: f64,
    runs: Vec<Run>,
}

impl Results<'_> {
    fn of(&self, method: usize, filter: usize, spp: u64) -> impl Iterator<Item = &Run> {
        self.runs.iter().filter(move |r| (r.method, r.filter, r.spp) == (method, filter, spp))
    }

    /// Errors by seed.
    pub(crate) fn errors(&self, method: usize, filter: usize, spp: u64, metric: usize) -> Vec<f64> {
        self.of(method, filter, spp).map(|r| r.errors[metric]).collect()
    }

    /// Means over the seeds, at each mean count.
    pub(crate) fn curve(&self, method: usize, filter: usize, metric: usize) -> Vec<(u64, f64)> {
        let mean = |&n: &u64| (n, statistics::mean(&self.errors(method, filter, n, metric)).0);
        self.plan.spp.iter().map(mean).collect()
    }

    /// Medians over the seeds, part by part.
    pub(crate) fn seconds(&self, method: usize, filter: usize, spp: u64) -> Seconds {
        let of = |part: fn(&Seconds) -> f64| {
            statistics::median(self.of(method, filter, spp).map(|r| part(&r.seconds)).collect())
        };
        Seconds {
            cluster: of(|s| s.cluster),
            probe: of(|s| s.probe),
            plan: of(|s| s.plan),
            trace: of(|s| s.trace),
            filter: of(|s| s.filter),
        }
    }

    /// The pixels with the fewest samples, by seed, unfiltered.
    pub(crate) fn lowest(&self, method: usize, spp: u64) -> Vec<Lowest> {
        self.of(method, NONE, spp).map(|r| r.lowest).collect()
    }

    /// Returns true for a method that was rendered. A single seed leaves out those aside and the variants.
    pub(crate) fn has(&self, method: usize) -> bool {
        self.runs.iter().any(|r| r.method == method)
    }
}

/// An image's errors, one of each kind.
pub(crate) fn errors(side: u32, image: &[[f32; 3]], reference: &[[f32; 3]]) -> Result<[f64; 2]> {
    let found = compare(Pixels::new([side; 2], image)?, Pixels::new([side; 2], reference)?)?;
    Ok([found.srgb8_mse, found.rel_mse])
}

/// Measures everything on one scene: methods take turns within each seed and count.
pub(crate) fn run<'a>(plan: &'a Plan, cache: &Path) -> Result<Results<'a>> {
    let bundle = bundled::files(plan.scene).ok_or("a bundled scene is missing")?;
    let mut scene = bundle.read()?;
    scene.film.pixel_filter = scene::PixelFilter::default();
    let world = Arc::new(World::with_resolution(&scene, [plan.side; 2])?);
    let reference = reference::of(plan, &world, &bundle, cache)?;
    let recording = recording(plan, &world)?;
    let place = Place { plan, world, reference, recording };
    let mut runs = Vec::new();
    for seed in 1..=plan.seeds {
        for &spp in plan.spp {
            eprintln!("{}, {} pixels squared: seed {seed}, {spp} spp", plan.scene, plan.side);
            let mut uniform = BTreeMap::new();
            // A single seed is for the thesis' sizes, with the published methods only.
            let published = |m: &Method| plan.seeds > 1 || !m.name.ends_with("4-128");
            let rendered = |m: &usize| published(&METHODS[*m]) && (!METHODS[*m].aside || seed <= plan.seeds / 2);
            for method in (0..METHODS.len()).filter(rendered) {
                runs.extend(place.images(method, seed, spp, &mut uniform)?);
            }
        }
    }
    Ok(Results { plan, own: place.reference.own, recording, runs })
}

/// Images of uniform sampling, by their points.
type Uniform = BTreeMap<&'static str, Vec<[f32; 3]>>;

/// A scene with its reference.
struct Place<'a> {
    plan: &'a Plan,
    world: Arc<World>,
    reference: reference::Reference,
    recording: f64,
}

impl Place<'_> {
    /// One film, filtered in each way. Keeps the image of uniform sampling for the methods after it.
    fn images(&self, method: usize, seed: u64, spp: u64, uniform: &mut Uniform) -> Result<Vec<Run>> {
        let mut inputs = MethodInputs::of(self.world.clone());
        let mut filters = Vec::new();
        for filter in 0..FILTERS.len() {
            let made = registry::filter(&filter_request(filter, self.plan.k), &inputs)?;
            inputs.clusters = made.clusters.or(inputs.clusters);
            filters.push(made.filter);
        }
        let needs = filters.iter().fold(Needs::none(), |needs, f| needs.and(f.needs()));
        let Method { points, .. } = METHODS[method];
        let (film, made) = film(self.plan, &self.world, &inputs, &METHODS[method], (seed, spp), needs)?;
        let of_filter = inputs.clusters.filter(|known| made.clusters.as_ref().is_none_or(|c| !Arc::ptr_eq(known, c)));
        let cluster = [made.clusters, of_filter].iter().flatten().fold(0.0, |sum, set| sum + set.seconds());
        if METHODS[method].sampler == "uniform" {
            uniform.insert(points, film.image());
        }
        let lowest = self.lowest(&film, uniform.get(points).ok_or("uniform sampling comes first")?)?;
        let (record, probe) = (film.record(), made.probes.cost().unwrap_or_default().seconds);

        let mut runs = Vec::new();
        for (filter, made) in filters.iter().enumerate() {
            let began = Instant::now();
            let image = made.apply(&film)?;
            let filtering = began.elapsed().as_secs_f64();
            // Clusters made for one filter do not count for the others.
            let asked = METHODS[method].clusters.is_some() || filter == CLUSTER_FILTER;
            let seconds = Seconds {
                cluster: if asked { cluster } else { 0.0 },
                probe,
                plan: (record.plan_seconds() - probe).max(0.0),
                trace: record.trace_seconds() / if filter == CLUSTER_FILTER { 1.0 } else { self.recording },
                filter: if filter == NONE { 0.0 } else { filtering },
            };
            let found = errors(self.plan.side, &image.radiance, &self.reference.pixels)?;
            let errors = [0, 1].map(|i| (found[i] - self.reference.own[i]).max(1e-12));
            runs.push(Run { method, filter, spp, errors, seconds, lowest });
        }
        Ok(runs)
    }

    fn lowest(&self, film: &Film, uniform: &[[f32; 3]]) -> Result<Lowest> {
        let (counts, truth) = (film.counts(), &self.reference.pixels);
        let least = counts.iter().copied().min().unwrap_or(0);
        let error = |image: &[[f32; 3]]| errors(self.plan.side, image, truth).map(|e| e[SRGB].max(1e-12));
        let within = |image: &[[f32; 3]]| {
            let pixels = image.iter().zip(truth).zip(&counts);
            error(&pixels.map(|((&x, &r), &n)| if n == least { x } else { r }).collect::<Vec<_>>())
        };
        let (mine, theirs) = (within(&film.image())?, within(uniform)?);
        let pixels = counts.iter().filter(|&&n| n == least).count() as f64 / counts.len() as f64;
        Ok(Lowest { pixels, part: theirs / error(uniform)?, loss: mine / theirs })
    }
}

fn film(
    plan: &Plan,
    world: &World,
    inputs: &MethodInputs,
    method: &Method,
    (seed, spp): (u64, u64),
    needs: Needs,
) -> Result<(Film, MadeSampler)> {
    let points = registry::points(method.points, registry::Setting { seed, spp: Some(spp) })?;
    let mut made = registry::sampler(&method.request(plan.k), points, inputs)?;
    let frame = Frame::new(plan.side, plan.side)?;
    let limits = Limits::samples(spp * u64::from(plan.side * plan.side));
    let film = Render::new(frame, &limits).needs(needs).run(&mut *integrator(world), &mut *made.sampler)?;
    Ok((film, made))
}

/// Seconds of tracing with first hits recorded over seconds without: the best of five, in turns.
fn recording(plan: &Plan, world: &World) -> Result<f64> {
    let mut best = [f64::INFINITY; 2];
    for seed in 1..=5 {
        for (best, needs) in best.iter_mut().zip([Needs::none().with_first_hits(1), Needs::none()]) {
            let (film, _) = film(plan, world, &MethodInputs::default(), &METHODS[RANDOM], (seed, 16), needs)?;
            *best = best.min(film.record().trace_seconds());
        }
    }
    Ok(best[0] / best[1])
}
