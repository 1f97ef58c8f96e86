//! The quality of the samplers, tracked by criterion: the error at an equal budget, and the time to reach a given error.
//!
//! ```sh
//! RAYON_NUM_THREADS=1 cargo bench -p dapple-benches --bench quality -- --save-baseline before
//! RAYON_NUM_THREADS=1 cargo bench -p dapple-benches --bench quality -- --baseline before
//! ```
//!
//! The first method is the default of `dapple render`; all methods use its default light selection.
//!
//! Each iteration renders with its own seed, so that criterion measures the variation of errors and reports only larger
//! changes.
//!
//! `relMSE` is the squared error divided by (squared reference + 0.01), averaged over iterations. The reference has independent
//! points and other seeds. It is rendered when the bench starts.

use criterion::measurement::{Measurement, ValueFormatter, WallTime};
use criterion::{BenchmarkGroup, Criterion, SamplingMode, Throughput};
use dapple_job::{
    BudgetSpec, DEFAULT_FILTER, DEFAULT_SAMPLER, LoadOptions, LoadedScene, PixelFilterSpec, PreparedScene, RenderSpec,
};
use dapple_metrics::{Pixels, compare};
use std::cell::Cell;
use std::time::{Duration, Instant};

const SCENES: [&str; 2] = ["cornell", "teapot"];
/// The sampler and the filter of each method; the default of `dapple render` is first.
const METHODS: [[&str; 2]; 5] = [
    [DEFAULT_SAMPLER, DEFAULT_FILTER],
    ["uniform", "none"],
    ["variance", "none"],
    ["mitchell", "none"],
    ["cluster-thesis", "none"],
];
/// The seed of the reference. The seeds of the benches begin at 1.
const REFERENCE_SEED: u64 = 1 << 32;

/// A measurement of error instead of time. Criterion plans its iterations in nanoseconds; errors are scaled up so that
/// one iteration always suffices.
struct RelMse;

const SCALE: f64 = 1e12;

impl Measurement for RelMse {
    type Intermediate = ();
    type Value = f64;

    fn start(&self) {}

    fn end(&self, (): ()) -> f64 {
        0.0
    }

    fn add(&self, a: &f64, b: &f64) -> f64 {
        a + b
    }

    fn zero(&self) -> f64 {
        0.0
    }

    fn to_f64(&self, value: &f64) -> f64 {
        value * SCALE
    }

    fn formatter(&self) -> &dyn ValueFormatter {
        &RelMse
    }
}

impl ValueFormatter for RelMse {
    fn scale_values(&self, _: f64, values: &mut [f64]) -> &'static str {
        values.iter_mut().for_each(|value| *value *= 1e3 / SCALE);
        "e-3 relMSE"
    }

    fn scale_throughputs(&self, typical: f64, _: &Throughput, values: &mut [f64]) -> &'static str {
        self.scale_values(typical, values)
    }

    fn scale_for_machines(&self, values: &mut [f64]) -> &'static str {
        values.iter_mut().for_each(|value| *value /= SCALE);
        "relMSE"
    }
}

/// A scene with its reference.
struct Course {
    scene: PreparedScene,
    spec: RenderSpec,
    side: u32,
    reference: Vec<[f32; 3]>,
    /// The seed of the next render.
    seed: Cell<u64>,
}

impl Course {
    fn new(name: &str) -> Self {
        // With `--test`, everything runs once and small.
        let (side, spp) = if std::env::args().any(|word| word == "--test") { (16, 64) } else { (64, 2048) };
        let spec = RenderSpec { pixel_filter: PixelFilterSpec::Box, ..RenderSpec::new(name).resolution(side, side) };
        let scene = LoadedScene::read(&spec, &LoadOptions::default()).expect("a bundled scene");
        let scene = scene.build().expect("a sound scene");
        let mut course = Self { scene, spec, side, reference: Vec::new(), seed: Cell::new(REFERENCE_SEED) };
        course.reference = course.render(["uniform", "none"], "random", spp).0;
        course.seed.set(1);
        course
    }

    /// An image, and the seconds for clustering, planning, tracing and filtering.
    fn render(&self, [sampler, filter]: [&str; 2], points: &str, spp: u64) -> (Vec<[f32; 3]>, f64) {
        let seed = self.seed.replace(self.seed.get() + 1);
        let clock = Instant::now();
        let spec = self.spec.clone().sampler(sampler).points(points).filter(filter).seed(seed);
        let spec = spec.budget(BudgetSpec::Samples(spp * u64::from(self.side * self.side)));
        let image = self.scene.job(&spec).and_then(|mut job| job.render()).expect("an image");
        (image.filtered.radiance, clock.elapsed().as_secs_f64())
    }

    /// The relMSE and the seconds of a render.
    fn run(&self, method: [&str; 2], spp: u64) -> [f64; 2] {
        let (image, seconds) = self.render(method, "sobol", spp);
        let pixels = |values| Pixels::new([self.side; 2], values).expect("pixels");
        let found = compare(pixels(&image), pixels(&self.reference)).expect("two images of a size");
        [found.rel_mse, seconds]
    }

    /// The seconds until the error reaches `target`.
    ///
    /// Budgets are doubled until then, up to 2^12 samples per pixel. Between the last two budgets, error and time are
    /// interpolated as powers of the budget.
    fn seconds_to(&self, method: [&str; 2], target: f64) -> f64 {
        let mut last: Option<[f64; 2]> = None;
        for power in 2..=12 {
            let [error, seconds] = self.run(method, 1 << power);
            if error <= target {
                let Some([before, took]) = last else { return seconds };
                let share = (before / target).ln() / (before / error).ln();
                return took * (seconds / took).powf(share);
            }
            last = Some([error, seconds]);
        }
        last.map_or(0.0, |[error, seconds]| seconds * error / target)
    }
}

/// The name of a method: its sampler, and its filter unless it is `none`.
fn name_of([sampler, filter]: [&str; 2]) -> String {
    if filter == "none" { sampler.to_owned() } else { format!("{sampler} + {filter}") }
}

/// Configures ten iterations, regardless of their duration.
fn few<M: Measurement>(group: &mut BenchmarkGroup<'_, M>) {
    let instant = Duration::from_nanos(1);
    group.sample_size(10).sampling_mode(SamplingMode::Flat).warm_up_time(instant).measurement_time(instant);
}

fn main() {
    let courses = SCENES.map(|name| (name, Course::new(name)));
    let mut criterion = Criterion::default().with_measurement(RelMse).without_plots().configure_from_args();
    for (name, course) in &courses {
        let mut group = criterion.benchmark_group(format!("error at 16 spp/{name}"));
        few(&mut group);
        for method in METHODS {
            course.seed.set(1);
            group.bench_function(name_of(method), |b| {
                b.iter_custom(|times| (0..times).map(|_| course.run(method, 16)[0]).sum::<f64>());
            });
        }
    }
    criterion.final_summary();

    let mut criterion: Criterion<WallTime> = Criterion::default().without_plots().configure_from_args();
    for (name, course) in &courses {
        // The error of uniform sampling with 16 samples per pixel.
        course.seed.set(1);
        let target = (0..4).map(|_| course.run(["uniform", "none"], 16)[0]).sum::<f64>() / 4.0;
        let mut group = criterion.benchmark_group(format!("time to uniform's error at 16 spp/{name}"));
        few(&mut group);
        for method in METHODS {
            course.seed.set(1);
            group.bench_function(name_of(method), |b| {
                b.iter_custom(|times| {
                    let seconds = (0..times).map(|_| course.seconds_to(method, target)).sum::<f64>();
                    Duration::from_secs_f64(seconds)
                });
            });
        }
    }
    criterion.final_summary();
}
